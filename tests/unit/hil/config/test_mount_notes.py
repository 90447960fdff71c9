"""A sensor that its mount puts below the ground all over the mission is told before the flight."""

from __future__ import annotations

import pytest

from hil.config import load_bench
from hil.config.checks.flight_notes import flight_notes

CAMERA = "sensors.cam={kind: camera, resolution: [32, 24], fov_deg: 90, rate_hz: 1, mount_m: %s}"


@pytest.mark.parametrize(
    ("mount_m", "is_told"), [([0, 0, -9], True), ([2, 2, -2.5], True), ([0, 0, -1.5], False), ([0.1, 0, 0], False)]
)
def test_a_camera_below_the_ground_is_told(mount_m: list[float], is_told: bool) -> None:
    bench = load_bench(mission="rigs/missions/short.waypoints", settings=[CAMERA % mount_m])
    told = "sensors.cam.mount_m: puts it inside 'ground' at every waypoint"
    assert flight_notes(bench) == ([told] if is_told else [])
