"""The moving setpoint: it stays near the plan, within its limits, and arrives."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_bridge.mock_pixhawk.flight.trajectory import Limits, Trajectory, max_speed_mps

LIMITS = Limits(
    speed_up_mps=3.0,
    speed_down_mps=1.5,
    accel_mps2=3.0,
    jerk_mps3=4.0,
    accel_lateral_mps2=1.0,
    corner_deviation_m=0.12,
)
DT = 0.02
RECTANGLE = [(0.0, 0.0, -10.0), (40.0, 0.0, -10.0), (40.0, 25.0, -10.0), (0.0, 25.0, -10.0), (0.0, 0.0, -10.0)]

_points = st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-30, -1)), min_size=2, max_size=7)


def flown(trajectory, *, stretch=1.0, limit_s=600.0):
    """Return positions, speeds and accelerations along the whole path."""
    rows = []
    for _ in range(int(limit_s / DT)):
        trajectory.advance(DT, stretch)
        rows.append((*trajectory.position, *trajectory.velocity(), trajectory.v, trajectory.a))
        if trajectory.done:
            return np.array(rows)
    raise AssertionError(f"not there after {limit_s} s: {trajectory.s} of {trajectory.length}")


def distance_to_polyline(p, points):
    best = math.inf
    for a, b in itertools.pairwise(np.array(points)):
        d = b - a
        t = np.clip((p - a) @ d / max(d @ d, 1e-12), 0.0, 1.0)
        best = min(best, float(np.linalg.norm(p - (a + t * d))))
    return best


def test_the_rectangle_is_flown_at_speed_and_cornered_within_the_deviation():
    rows = flown(Trajectory(RECTANGLE, [3.0] * 4, LIMITS))
    off = [distance_to_polyline(p, RECTANGLE) for p in rows[:, :3]]
    # A rounded 90 degree corner leaves the legs by r (1 - cos 45 deg), which is the deviation asked for.
    assert max(off) == pytest.approx(LIMITS.corner_deviation_m, rel=0.02)
    assert np.max(rows[:, 6]) <= 3.06
    assert np.median(rows[:, 6]) > 2.9
    assert np.allclose(rows[-1, :3], RECTANGLE[-1])


def test_every_waypoint_is_passed_in_order_within_the_deviation():
    trajectory = Trajectory(RECTANGLE, [3.0] * 4, LIMITS)
    assert trajectory.waypoint_s == sorted(trajectory.waypoint_s)
    at = dict.fromkeys(range(5))
    while not trajectory.done:
        trajectory.advance(DT, 1.0)
        for k, s in enumerate(trajectory.waypoint_s):
            if trajectory.s >= s and at[k] is None:
                at[k] = math.dist(trajectory.position, RECTANGLE[k])
    assert all(d is not None and d < 0.25 for d in at.values())


@settings(max_examples=40, derandomize=True)
@given(_points, st.floats(0.5, 12.0))
def test_limits_hold_on_any_path(points, speed):
    trajectory = Trajectory(points, [speed] * (len(points) - 1), LIMITS)
    rows = flown(trajectory, limit_s=3000.0)
    v, a = rows[:, 6], rows[:, 7]
    assert np.max(np.abs(a)) <= LIMITS.accel_mps2 + 1e-9
    assert np.max(np.abs(np.diff(a, prepend=0.0))) <= LIMITS.jerk_mps3 * DT + LIMITS.accel_mps2 * 1e-9 + 1e-9 or (
        # only the final step to the end may drop the remaining speed
        np.argmax(np.abs(np.diff(a))) == len(a) - 2
    )
    vertical = rows[:, 5]
    assert np.min(vertical) >= -LIMITS.speed_up_mps - 0.05
    assert np.max(vertical) <= LIMITS.speed_down_mps + 0.05
    assert np.max(np.hypot(rows[:, 3], rows[:, 4])) <= speed * 1.02 + 0.01
    assert v[-1] < 0.25
    assert np.allclose(rows[-1, :3], points[-1], atol=1e-2)


@settings(max_examples=40, derandomize=True)
@given(_points)
def test_the_path_never_leaves_the_legs_by_more_than_the_deviation(points):
    rows = flown(Trajectory(points, [5.0] * (len(points) - 1), LIMITS), limit_s=3000.0)
    for p in rows[::5, :3]:
        assert distance_to_polyline(p, points) <= LIMITS.corner_deviation_m + 1e-3


def test_velocity_is_the_derivative_of_position_also_in_corners():
    rows = flown(Trajectory(RECTANGLE, [3.0] * 4, LIMITS))
    numeric = np.diff(rows[:, :3], axis=0) / DT
    mean = 0.5 * (rows[1:, 3:6] + rows[:-1, 3:6])
    # The last step jumps to the end.
    assert np.max(np.abs(numeric - mean)[:-1]) < 0.04
    assert np.max(np.abs(numeric[-1])) < 0.2


def test_a_reversal_is_flown_by_nearly_stopping():
    points = [(0.0, 0.0, -5.0), (20.0, 0.0, -5.0), (1.0, 0.0, -5.0)]
    rows = flown(Trajectory(points, [5.0, 5.0], LIMITS))
    turn = np.argmax(rows[:, 0])
    assert rows[turn, 6] < 0.4
    assert np.max(rows[:, 0]) == pytest.approx(20.0, abs=0.02)


def test_coinciding_points_and_empty_paths_are_done_at_once():
    trajectory = Trajectory([(1.0, 2.0, -3.0)] * 3, [5.0, 5.0], LIMITS)
    trajectory.advance(DT, 1.0)
    assert trajectory.done
    assert trajectory.position == (1.0, 2.0, -3.0)
    assert trajectory.velocity() == (0.0, 0.0, 0.0)


def test_a_vehicle_that_lags_behind_stops_the_setpoint():
    trajectory = Trajectory(RECTANGLE, [3.0] * 4, LIMITS)
    for _ in range(200):
        trajectory.advance(DT, 1.0)
    for _ in range(200):
        trajectory.advance(DT, 0.0)
    assert trajectory.v == pytest.approx(0.0, abs=1e-2)
    assert not trajectory.done


@given(st.floats(0.0, 200.0), st.floats(0.0, 5.0))
def test_the_braking_law_is_no_faster_than_constant_deceleration(distance, then):
    v = max_speed_mps(distance, then, 3.0, 4.0)
    assert then <= v <= math.sqrt(then * then + 2.0 * 3.0 * distance) + 1e-9


def test_an_almost_straight_corner_keeps_the_speed_of_the_legs():
    """Its arc is tens of metres long and as level as the legs, wherever its bend points."""
    for bend_m in ((0.02, -0.03), (-0.02, 0.03), (0.0, 0.04), (0.0, -0.04)):
        points = [(0.0, 0.0, -8.0), (0.0 + bend_m[0], 32.0, -8.0 + bend_m[1]), (0.0, 92.0, -8.0)]
        flight = flown(Trajectory(points, [3.0, 3.0], LIMITS))
        cruise = flight[(flight[:, 1] > 10.0) & (flight[:, 1] < 80.0), 6]
        assert cruise == pytest.approx(3.0, abs=0.01)
