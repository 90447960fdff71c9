"""Speeds that allow stopping in time, the retreat rule, and motion-corrected sweeps."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.worlds.scripted_bench import CLIENT

from hil_companion.errors import OptionError  # isort: skip
from hil_companion.explore.senses import BlindSpot  # isort: skip
from hil_companion.explore.planning.plan_map import Clearances, clearances_for  # isort: skip
from hil_companion.explore.senses import Nearby, SweepReader  # isort: skip
from hil_companion.explore.planning.plan_map import PlanMap  # isort: skip
from hil_companion.explore.steering import RetreatRule  # isort: skip
from hil_companion.explore.planning.flight_settings import FlightSettings  # isort: skip
from hil_companion.explore.steering import Steering, free_ahead_m  # isort: skip
from hil_companion.frame import Sample  # isort: skip

assert CLIENT
FLIGHT = FlightSettings()
CLEARANCES = clearances_for(FLIGHT, 0.0, 0.25)


def open_map(*, unknown_from_x: float = math.inf, wall_x: float = math.inf) -> PlanMap:
    """Return a map of 40 by 40 m about the origin, unknown beyond one x, with a wall at another."""
    x = (np.arange(160) + 0.5) * 0.25 - 20.0
    unknown = np.broadcast_to(x > unknown_from_x, (160, 160)).copy()
    distance = np.broadcast_to(np.minimum(np.abs(wall_x - x), 50.0), (160, 160)).astype(np.float32).copy()
    return PlanMap(distance, unknown, np.ones((80, 80)), (-20.0, -20.0), 0.25, 2, np.zeros((0, 4)))


def nearby(*points: tuple[float, float]) -> Nearby:
    return Nearby(0, np.array(points, float).reshape(-1, 2), 1000, np.zeros((0, 3)))


@given(st.floats(0.0, 10.0))
def test_the_speed_that_stops_does(speed_mps: float) -> None:
    assert FLIGHT.speed_that_stops_mps(FLIGHT.stopping_m(speed_mps)) == pytest.approx(speed_mps, abs=1e-9)


def steady(steering: Steering, place: PlanMap, near: Nearby, path: Any, p: Any, v: Any) -> float:
    """Return the commanded speed after it has settled."""
    for _ in range(60):
        v_W = steering.follow(
            place, CLEARANCES, near, np.asarray(path, float), np.asarray(p, float), np.asarray(v), 0.1
        )
    return float(np.hypot(*v_W))


def test_cruising_in_the_open_and_slower_towards_unseen_cells() -> None:
    path = [(0.0, 0.0), (19.0, 0.0)]
    assert steady(Steering(FLIGHT), open_map(), nearby(), path, (0.0, 0.0), (3.0, 0.0)) == pytest.approx(3.0)
    for seen_m in (1.5, 3.0, 4.0):
        place = open_map(unknown_from_x=seen_m)
        speed = steady(Steering(FLIGHT), place, nearby((0.5, 3.0)), path, (0.0, 0.0), (0.5, 0.0))
        assert 0.0 < FLIGHT.stopping_m(speed) <= seen_m
        assert speed < 3.0


def test_it_stops_before_what_the_sweep_shows_on_its_way_though_the_map_does_not() -> None:
    for away_m in (2.0, 4.0):
        near = nearby((away_m, 0.0), (away_m, 0.1))
        speed = steady(Steering(FLIGHT), open_map(), near, [(0.0, 0.0), (19.0, 0.0)], (0.0, 0.0), (2.0, 0.0))
        assert FLIGHT.stopping_m(speed) <= away_m - CLEARANCES.red_m + 0.05
    assert free_ahead_m(nearby((5.0, 0.0)), np.zeros(2), np.array([1.0, 0.0]), 1.0) == pytest.approx(4.0)
    assert free_ahead_m(nearby((5.0, 0.6)), np.zeros(2), np.array([1.0, 0.0]), 1.0) == pytest.approx(4.2)
    assert free_ahead_m(nearby((-5.0, 0.0)), np.zeros(2), np.array([1.0, 0.0]), 1.0) > 10.0


def test_slow_beside_walls_and_before_corners() -> None:
    beside = open_map(wall_x=CLEARANCES.hard_m)
    speed = steady(Steering(FLIGHT), beside, nearby(), [(0.0, 0.0), (0.0, 19.0)], (0.0, 0.0), (0.0, 1.0))
    assert speed == pytest.approx(FLIGHT.slow_mps, abs=0.25)
    sharp = [(0.0, 0.0), (2.0, 0.0), (2.0, 19.0)]
    blunt = [(0.0, 0.0), (2.0, 0.0), (19.0, 2.0)]
    slow = steady(Steering(FLIGHT), open_map(), nearby(), sharp, (0.0, 0.0), (1.0, 0.0))
    assert slow < 2.6 < steady(Steering(FLIGHT), open_map(), nearby(), blunt, (0.0, 0.0), (1.0, 0.0))


def test_an_uncertain_pose_lowers_the_speed() -> None:
    steering, path = Steering(FLIGHT), np.array([(0.0, 0.0), (19.0, 0.0)])
    for _ in range(60):
        v_W = steering.follow(open_map(), CLEARANCES, nearby(), path, np.zeros(2), np.zeros(2), 0.1, max_mps=1.2)
    assert float(np.hypot(*v_W)) == pytest.approx(1.2)


def test_commands_never_jump() -> None:
    steering = Steering(FLIGHT)
    before = np.zeros(2)
    path = np.array([(0.0, 0.0), (19.0, 0.0)])
    for k in range(30):
        end = path if k < 15 else path * -1.0
        v_W = steering.follow(open_map(), CLEARANCES, nearby(), end, np.zeros(2), before, 0.1)
        assert float(np.hypot(*(v_W - before))) <= 0.1 * FLIGHT.accel_mps2 + 1e-9
        before = v_W.copy()


def test_it_slows_down_to_the_goal() -> None:
    for left_m in (0.3, 1.0, 3.0):
        speed = steady(Steering(FLIGHT), open_map(), nearby(), [(0.0, 0.0), (left_m, 0.0)], (0.0, 0.0), (0.0, 0.0))
        assert speed > 0.05
        assert FLIGHT.stopping_m(speed) <= left_m + 0.1


def test_the_retreat_is_straight_away_until_out_of_the_band() -> None:
    rule = RetreatRule()
    limits = Clearances(1.0, 1.3, 1.4, 3.0)
    towards = (0.6, 0.8)
    assert rule.apply(limits, 1.35, towards, (0.0, 0.0), math.inf).v_W is None
    away = rule.apply(limits, 1.2, towards, (0.0, 0.0), math.inf)
    assert away.band == "orange"
    assert away.v_W is not None
    assert math.atan2(away.v_W[1], away.v_W[0]) == pytest.approx(math.atan2(-0.8, -0.6))
    assert rule.apply(limits, 1.35, towards, (0.0, 0.0), math.inf).v_W is not None  # hysteresis
    assert rule.apply(limits, 1.5, towards, (0.0, 0.0), math.inf).band == "clear"
    red = rule.apply(limits, 0.9, towards, (0.6, 0.8), math.inf)
    assert red.band == "red"
    assert red.v_W == (0.0, 0.0)
    back = rule.apply(limits, 0.9, towards, (0.0, 0.0), math.inf)
    assert back.v_W is not None
    assert back.v_W[0] * 0.6 + back.v_W[1] * 0.8 == pytest.approx(-0.6)
    assert rule.apply(limits, 1.1, towards, (0.0, 0.0), 1.1).v_W is None  # a wall on either side
    assert rule.apply(limits, math.nan, towards, (0.0, 0.0), math.inf).band == "clear"


def estimate(**changes: Any) -> Any:
    plain = {"t_ns": 100, "p_W": np.zeros(3), "v_W": np.zeros(3), "yaw_rad": 0.0, "roll": 0.0, "pitch": 0.0}
    return SimpleNamespace(**(plain | changes))


def sweep(points: Any, offset_ns: Any = 0, t_ns: int = 100) -> Sample:
    points = np.asarray(points, np.float32).reshape(-1, 3)
    offsets = np.broadcast_to(np.asarray(offset_ns, np.int32), (len(points),))
    return Sample("lidar", 0, t_ns, t_ns, {}, {"points_L": points, "time_offset_ns": offsets})


def test_a_sweep_is_levelled_turned_and_moved_to_now() -> None:
    reader = SweepReader({"p_BC": [0.0, 0.0, 0.1], "q_BC": [1.0, 0.0, 0.0, 0.0]}, 1.0)
    pitch = 0.3  # nose down: points ahead at the vehicle's height lie above the body's plane
    point = [10.0 * math.cos(pitch), 0.0, 10.0 * math.sin(pitch) - 0.1]
    at = estimate(pitch=pitch, yaw_rad=0.5 * math.pi, p_W=np.array([1.0, 2.0, 10.0]))
    near = reader.read(sweep([point]), at, 0.0, 10.0)
    np.testing.assert_allclose(near.level_W, [[1.0, 12.0]], atol=1e-5)
    moving = estimate(t_ns=200_000_000, v_W=np.array([3.0, 0.0, 0.0]))
    near = reader.read(sweep([[10.0, 0.0, 0.0]], offset_ns=-50_000_000, t_ns=150_000_000), moving, 0.0, 0.0)
    np.testing.assert_allclose(near.level_W, [[10.0 - 0.3, 0.0]], atol=1e-5)
    turning = reader.read(sweep([[10.0, 0.0, 0.0]], offset_ns=-100_000_000), estimate(t_ns=100), 1.0, 0.0)
    np.testing.assert_allclose(turning.level_W, [[10.0 * math.cos(0.1), -10.0 * math.sin(0.1)]], atol=1e-4)


def test_points_that_are_no_numbers_or_at_other_heights_do_not_count() -> None:
    reader = SweepReader(None, 1.0)
    near = reader.read(sweep([[math.nan, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 0.0, -3.0]]), estimate(), 0.0, 0.0)
    assert near.usable == 2
    assert near.nearest(0.0, 0.0)[0] == pytest.approx(5.0)
    assert reader.read(sweep(np.full((4, 3), math.nan)), estimate(), 0.0, 0.0).usable == 0


@pytest.mark.parametrize("wrong", [{"speed_mps": 0.0}, {"speed_mps": math.nan}, {"height_m": "x"}, {"slow_mps": 9.0}])
def test_settings_that_cannot_be_flown(wrong: dict[str, Any]) -> None:
    with pytest.raises(OptionError, match="explore"):
        FlightSettings(**wrong)


def test_objects_below_the_field_of_view_are_kept_for_a_while() -> None:
    eye, spot, ground = np.array([0.0, 0.0, 2.1]), BlindSpot(), [(8.0, y, 0.0) for y in np.linspace(-4.0, 4.0, 40)]
    head = np.array([(2.4, 0.0, 1.5), (2.4, 0.02, 1.55), (2.4, 0.0, 2.5)])
    assert not len(spot.remembered(0, eye, np.array([*head, *ground]), head))
    # 1.4 m nearer, its top is at least 14 degrees below the LiDAR, whose lowest ring points 14.7 degrees down.
    eye = np.array([1.4, 0.0, 2.1])
    seen = spot.remembered(500_000_000, eye, np.array(ground), np.zeros((0, 3)))
    np.testing.assert_allclose(seen, [(2.4, 0.0)], atol=0.11)
    assert not len(spot.remembered(2_600_000_000, eye, np.array(ground), np.zeros((0, 3))))
