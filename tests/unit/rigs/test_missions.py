"""The shipped missions."""

from __future__ import annotations

from hil.config import load_bench
from hil.config.missions.path import planned_path, waypoint_legs
from hil.config.schema import Limits


def test_the_short_mission_is_flown_to_its_corners() -> None:
    """PX4 turns within the acceptance radius: with 2 m it was 1.05 to 1.36 m off these legs of 8 and 6 m, in 6 flights.

    With 0.65 m it was 0.41 to 0.65 m off, in 10 flights, five of them on a busy machine.
    """
    bench = load_bench(None, settings=["mission=rigs/missions/short.waypoints"])
    assert bench.mission is not None
    for leg in waypoint_legs(planned_path(bench.mission, bench.scene)):
        assert leg.acceptance_radius_m <= 0.65 < Limits().max_cross_track_m
