"""The vehicle that stands in for a quadrotor with its autopilot, and a short flight with the bench's own LiDAR."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.config import load_bench
from hil.config.schema import Goal
from hil.goal.closed_loop import START_Z_M, ClosedLoop, Follower, attitude
from hil.view_command import load_frames
from sim.sensors.rotation import rotate_into_world
from tests.unit.companion_bench import CLIENT
from tests.unit.test_goal_judgement import SCENE

from hil_companion.explore.true_pose import TruePose  # isort: skip

assert CLIENT
DT_S = 0.004
COARSE = {"kind": "spinning", "elevation_deg": [-15, -5, -3, -1, 1, 3], "firing_ns": 0, "columns": 450}


def test_it_follows_velocities_with_a_lag_and_moves_as_it_accelerates() -> None:
    vehicle = Follower(np.zeros(3))
    before, reached_s = vehicle.v.copy(), None
    for k in range(600):
        p = vehicle.p.copy()
        vehicle.step((3.0, 0.0, 0.0), 1.0, DT_S)
        np.testing.assert_allclose(vehicle.v - before, vehicle.a * DT_S, atol=1e-12)
        np.testing.assert_allclose(vehicle.p - p, vehicle.v * DT_S, atol=1e-12)
        before = vehicle.v.copy()
        if reached_s is None and vehicle.v[0] > 0.9 * 3.0:
            reached_s = k * DT_S
    assert reached_s is not None
    assert 0.5 < reached_s < 1.5
    assert vehicle.v == pytest.approx([3.0, 0.0, 0.0], abs=1e-3)
    assert vehicle.yaw == pytest.approx(1.0, abs=1e-2)


def test_it_tilts_as_its_acceleration_asks_for() -> None:
    for a, yaw in (((0.0, 0.0, 0.0), 0.7), ((3.0, -2.0, 1.0), -2.0), ((-4.0, 0.0, 0.0), 3.1)):
        q = attitude(np.array(a), yaw)
        force = np.array([a[0], a[1], a[2] + 9.80665])
        np.testing.assert_allclose(rotate_into_world(q, (0.0, 0.0, 1.0)), force / np.linalg.norm(force), atol=1e-9)
        x, y, _ = rotate_into_world(q, (1.0, 0.0, 0.0))
        assert math.remainder(math.atan2(y, x) - yaw, 2.0 * math.pi) == pytest.approx(0.0, abs=0.1)


def test_its_rates_turn_it_from_one_attitude_to_the_next() -> None:
    vehicle = Follower(np.zeros(3))
    for _ in range(80):
        before = vehicle.q
        vehicle.step((3.0, 2.0, 1.0), 1.5, DT_S)
        half = [0.5 * DT_S * rate for rate in vehicle.w]
        turned = np.array(before) + _times(before, (0.0, *half))  # to the first order
        np.testing.assert_allclose(turned / np.linalg.norm(turned), vehicle.q, atol=2e-5)


def _times(a: Any, b: Any) -> np.ndarray:
    w, v = a[0] * b[0] - np.dot(a[1:], b[1:]), a[0] * np.array(b[1:]) + b[0] * np.array(a[1:]) + np.cross(a[1:], b[1:])
    return np.array([w, *v])


def test_a_short_flight_round_a_hall_is_judged(tmp_path: Path) -> None:
    (tmp_path / "two_boxes.yaml").write_text(SCENE)
    scene, _, frames = load_frames(str(tmp_path / "two_boxes.yaml"), None)
    vehicle = load_bench(None, settings=["mission=null"]).vehicle

    def flown(change: Any) -> Any:
        loop = ClosedLoop(
            scene,
            frames,
            vehicle,
            Goal(p_W=(15.0, -1.0, 4.0)),
            lambda told: TruePose(told["lidar"], 4.0, half_m=60.0),
            frame_hz=10,
            sensors={"lidar": {"preset": "vlp16", "rate_hz": 10.0, "pattern": COARSE}},
            flight={"hover_s": 0.2},
            change=change,
        )
        return loop.fly(60.0).result, loop.measurement.judged()[1], loop.vehicle.p

    result, reasons, _ = flown(None)
    assert reasons == []
    assert result.outcome == "goal"
    assert 0.98 < result.path_ratio < 1.35

    def lost(truth: Any, name: str, sample: Any) -> Any:
        return None if name == "lidar" and truth.t_ns > 4_000_000_000 else sample

    result, reasons, p = flown(lost)
    assert result.outcome == "lidar_lost"
    assert "the client ended as 'lidar_lost'" in reasons[0]
    assert result.clearance_m > 0.5
    assert p[2] > START_Z_M + 1.0
    frames.close()
