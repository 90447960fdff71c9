"""Moves along a path: distance from the path, arrival, lookahead, heading, time limits, arguments."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, degrees, dist, hypot, inf, nan, pi, sin, sqrt

import numpy as np
import pytest

from hil.apps.airsim.flight.move import MoveError
from hil.apps.airsim.flight.path import (
    PathOptions,
    TakeOff,
    go_home,
    move_on_path,
    move_to_position,
    move_to_z,
)
from hil.apps.airsim.flight.spot import Land, RotateToYaw
from hil.apps.airsim.flight.timed import move_by_velocity
from hil.apps.airsim.flight.yaw import YawMode
from signals.samples import Vec3
from sim.physics.vehicle import load_vehicle
from tests.worlds.airsim_flight import Pilot, airborne, calm

FORWARD, ALONG = 1, YawMode(is_rate=False, yaw_or_rate=0.0)
SQUARE = [(20.0, 0.0, 0.0), (20.0, 20.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, 0.0)]


def pilot(vehicle: str = "iris", wind_W: Vec3 = (0.0, 0.0, 0.0)) -> Pilot:
    """Return a pilot 50 m above the ground, hovering; its NED frame begins there. It looks east."""
    made = Pilot(airborne(load_vehicle(vehicle), (3.0, -2.0, 50.0), disturbances=calm(wind_W)))
    made.wait(1.0)
    made.log.clear()
    return made


def from_path(points: Sequence[Vec3], p: Vec3) -> float:
    """Return the distance of a point from a polyline."""
    best = inf
    for a, b in zip(np.array(points), np.array(points)[1:], strict=False):
        along = float(np.clip(np.dot(p - a, b - a) / np.dot(b - a, b - a), 0.0, 1.0))
        best = min(best, float(np.linalg.norm(p - (a + along * (b - a)))))
    return best


def farthest(flown: Pilot, points: Sequence[Vec3]) -> float:
    """Return the greatest distance of the flight from a path."""
    return max(from_path(points, state.p_m) for state in flown.log[::5])


@pytest.mark.parametrize("vehicle", ["iris", "x500", "hexa_x", "octa_x", "y6", "x8", "racer"])
def test_a_square_at_5_mps_is_followed_within_half_a_metre(vehicle: str) -> None:
    flown = pilot(vehicle)
    result, took_s = flown.do(move_on_path(SQUARE, PathOptions(5.0, drivetrain=FORWARD, yaw_mode=ALONG)))
    assert result is True
    assert farthest(flown, [(0.0, 0.0, 0.0), *SQUARE]) < 0.5
    assert 16.0 < took_s < 23.0
    for corner in SQUARE:
        assert min(dist(state.p_m, corner) for state in flown.log) < 0.5
    assert max(hypot(*state.v_mps) for state in flown.log) == pytest.approx(5.0, abs=0.1)


def test_a_square_in_wind_is_followed_within_half_a_metre() -> None:
    flown = pilot(wind_W=(6.0, -4.0, 0.0))
    assert flown.do(move_on_path(SQUARE, PathOptions(5.0)))[0] is True
    assert farthest(flown, [(0.0, 0.0, 0.0), *SQUARE]) < 0.5


@pytest.mark.parametrize("speed_mps", [1.0, 5.0, 8.0, 12.0])
@pytest.mark.parametrize("target", [(40.0, 0.0, 0.0), (15.0, -20.0, -12.0), (0.0, 0.0, -15.0), (1.0, 1.0, 0.0)])
def test_arrives_on_a_straight_line(speed_mps: float, target: Vec3) -> None:
    flown = pilot()
    result, took_s = flown.do(move_to_position(target, PathOptions(speed_mps)))
    assert result is True
    assert dist(flown.ned.p_m, target) <= 0.1
    assert hypot(*flown.ned.v_mps) <= 0.5
    assert farthest(flown, [(0.0, 0.0, 0.0), target]) < 0.5
    way_m = hypot(*target)
    assert way_m / speed_mps - 0.5 < took_s < way_m / speed_mps + speed_mps / 2.5 + 4.0
    after = flown.wait(3.0)
    assert dist(after.p_m, target) < 0.02
    past = max(np.dot(state.p_m, target) / way_m for state in flown.log) - way_m
    assert past < 0.02


def test_corners_of_many_kinds() -> None:
    """Reversal, hairpin, shallow corner, doubled point, climb."""
    path = [
        (20.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 0.0), (20.0, 4.0, 0.0), (40.0, 10.0, 0.0), (40.0, 10.0, -10.0),
        (20.0, 30.0, -10.0),
    ]  # fmt: skip
    flown = pilot()
    assert flown.do(move_on_path(path, PathOptions(6.0)))[0] is True
    assert farthest(flown, [(0.0, 0.0, 0.0), *dict.fromkeys(path)]) < 0.6
    for corner in path:
        assert min(dist(state.p_m, corner) for state in flown.log) < 0.6


@pytest.mark.parametrize("speed_mps", [2.0, 8.0])
def test_there_and_back_on_one_line(speed_mps: float) -> None:
    flown = pilot(wind_W=(2.0, 3.0, 0.0))
    result, took_s = flown.do(move_on_path([(15.0, 12.0, -3.0), (0.0, 0.0, 0.0)], PathOptions(speed_mps)))
    assert result is True
    assert min(dist(state.p_m, (15.0, 12.0, -3.0)) for state in flown.log) < 0.5
    assert took_s > 38.5 / speed_mps


def test_a_circle_of_short_legs_is_followed() -> None:
    radius_m = 10.0
    circle = [
        (radius_m * sin(angle), radius_m * (1.0 - cos(angle)), 0.0) for angle in np.arange(1, 121) * (2.0 * pi / 120.0)
    ]
    flown = pilot()
    assert flown.do(move_on_path(circle, PathOptions(4.0)))[0] is True
    centre = (0.0, radius_m)
    distances = [dist(state.p_m[:2], centre) for state in flown.log]
    assert max(abs(distance - radius_m) for distance in distances) < 0.6
    assert flown.ned.p_m == pytest.approx((0.0, 0.0, 0.0), abs=0.15)


def test_a_path_of_ten_thousand_points_ends_like_a_straight_line() -> None:
    flown = pilot()
    assert flown.do(move_on_path([(0.002 * i, 0.0, 0.0) for i in range(10_001)], PathOptions(5.0)))[0] is True
    assert flown.ned.p_m == pytest.approx((20.0, 0.0, 0.0), abs=0.06)
    flown.wait(2.0)
    assert max(state.p_m[0] for state in flown.log) < 20.02
    assert max(abs(state.p_m[1]) for state in flown.log) < 0.01


def test_a_lookahead_of_ones_own_cuts_the_corner() -> None:
    cuts = []
    for lookahead_m in (1.0, 4.0, 10.0):
        flown = pilot()
        options = PathOptions(3.0, lookahead_m=lookahead_m, adaptive_lookahead=0.0)
        assert flown.do(move_on_path(SQUARE[:2], options))[0] is True
        cuts.append(min(dist(state.p_m, SQUARE[0]) for state in flown.log))
    assert 0.05 < cuts[0] < cuts[1] < cuts[2]
    assert cuts[2] > 2.0


def test_adaptive_lookahead_returns_to_the_path_more_gently() -> None:
    """A vehicle that is pushed off its path comes back at a smaller angle."""
    angles = []
    for adaptive in (0.0, 3.0):
        flown = pilot()
        flown.flight.start(
            move_on_path([(60.0, 0.0, 0.0)], PathOptions(4.0, lookahead_m=3.0, adaptive_lookahead=adaptive)),
            lambda _: None,
        )
        flown.wait(2.0)
        x, y, z = flown.truth.p_WB
        flown.truth = flown.physics.place((x + 5.0, y, z), flown.truth.q_WB, flown.truth.v_WB_W)
        flown.log.clear()
        flown.wait(1.2)
        angles.append(max(degrees(atan2(-state.v_mps[1], state.v_mps[0])) for state in flown.log))
    assert angles[0] > angles[1] + 10.0 > 15.0


def test_the_nose_points_along_the_path() -> None:
    flown = pilot()
    flown.flight.start(move_on_path(SQUARE, PathOptions(3.0, drivetrain=FORWARD, yaw_mode=ALONG)), lambda _: None)
    flown.wait(4.0)
    assert degrees(flown.ned.yaw_rad) == pytest.approx(0.0, abs=3.0)
    flown.wait(8.0)
    assert degrees(flown.ned.yaw_rad) == pytest.approx(90.0, abs=5.0)


def test_height_and_home() -> None:
    flown = pilot()
    flown.do(move_by_velocity((3.0, 2.0, 0.0), 1.0, 0, YawMode()))
    flown.wait(5.0)
    x, y, _ = flown.ned.p_m
    assert flown.do(move_to_z(-7.0, PathOptions(3.0)))[0] is True
    assert flown.ned.p_m == pytest.approx((x, y, -7.0), abs=0.12)
    result, took_s = flown.do(go_home(3e38))
    assert result is True
    assert flown.ned.p_m == pytest.approx((0.0, 0.0, 0.0), abs=0.12)
    assert took_s == pytest.approx(sqrt(x * x + y * y + 49.0) / 0.5, rel=0.1)


def test_a_time_limit_ends_the_move_with_false() -> None:
    flown = pilot()
    result, took_s = flown.do(move_to_position((100.0, 0.0, 0.0), PathOptions(5.0, timeout_s=2.0)))
    assert result is False
    assert took_s == pytest.approx(2.0)
    place = flown.ned.p_m
    assert dist(flown.wait(8.0).p_m, place) < 1.0


def test_no_points_and_the_present_place() -> None:
    flown = pilot()
    assert flown.do(move_on_path([], PathOptions(5.0)))[0] is True
    result, took_s = flown.do(move_to_position(flown.ned.p_m, PathOptions(5.0)))
    assert result is True
    assert took_s < 0.05


def test_takes_off_and_lands() -> None:
    flown = Pilot()
    flown.wait(0.3)
    assert flown.flight.landed
    result, took_s = flown.do(TakeOff(20.0))
    assert result is True
    assert 3.9 < took_s < 5.5
    assert not flown.flight.landed
    assert flown.wait(2.0).p_m == pytest.approx((0.0, 0.0, -2.0), abs=0.02)
    assert max(hypot(*state.v_mps) for state in flown.log) < 0.6
    result, took_s = flown.do(Land(60.0))
    assert result is True
    assert 9.0 < took_s < 12.0  # 2 m at 0.2 m/s
    assert flown.flight.landed
    flown.wait(2.0)
    assert flown.ned.p_m == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert hypot(*flown.ned.v_mps) < 1e-3
    assert flown.do(Land(60.0)) == (True, pytest.approx(0.0, abs=0.005))  # on the ground already
    assert flown.do(TakeOff(20.0))[0] is True


def test_a_landing_that_takes_too_long_is_false() -> None:
    flown = pilot()
    result, took_s = flown.do(Land(5.0))
    assert result is False
    assert took_s == pytest.approx(5.0)
    assert flown.ned.v_mps[2] == pytest.approx(0.2, abs=0.01)


def test_no_take_off_from_a_moving_vehicle() -> None:
    flown = pilot()
    flown.do(move_by_velocity((2.0, 0.0, 0.0), 1.5, 0, YawMode()))
    with pytest.raises(MoveError, match=r"takeoff because vehicle is already moving with velocity [12]\."):
        flown.do(TakeOff(20.0))
    assert not flown.flight.busy


@pytest.mark.parametrize("yaw_deg", [0.0, -135.0, 179.0, -180.0, 540.0, 90.0])
def test_rotates_to_a_heading(yaw_deg: float) -> None:
    flown = pilot()
    result, took_s = flown.do(RotateToYaw(yaw_deg, 3e38, 5.0))
    assert result is True
    error_deg = (degrees(flown.ned.yaw_rad) - yaw_deg + 180.0) % 360.0 - 180.0
    assert abs(error_deg) < 1.0
    assert took_s < 4.0
    assert abs(flown.ned.w_radps[2]) <= 0.01
    assert hypot(*flown.ned.p_m) < 0.02


def test_a_rotation_has_a_time_limit_and_a_margin() -> None:
    flown = pilot()
    assert flown.do(RotateToYaw(-90.0, 0.3, 5.0)) == (False, pytest.approx(0.3, abs=0.02))
    flown = pilot()
    wide, _ = flown.do(RotateToYaw(120.0, 3e38, 45.0))  # 30 degrees away: within the margin, and it stands
    assert wide is True
    assert degrees(flown.ned.yaw_rad) == pytest.approx(90.0, abs=0.5)
    assert flown.do(RotateToYaw(0.0, 0.0, 5.0)) == (True, pytest.approx(0.0, abs=0.021))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"velocity_mps": nan}, "velocity is nan; it has to be finite"),
        ({"velocity_mps": 0.0}, "velocity is 0; it has to be above 0 m/s"),
        ({"velocity_mps": -3.0}, "velocity is -3; it has to be above"),
        ({"timeout_s": nan}, "timeout_sec is nan"),
        ({"lookahead_m": inf}, "lookahead is inf"),
        ({"lookahead_m": 0.0}, "lookahead distance cannot be 0"),
        ({"lookahead_m": 0.3}, "lookahead value 0.3 is smaller than drone's distance accuracy 0.5"),
        ({"lookahead_m": 0.6, "velocity_mps": 40.0}, "lookahead value 0.6 is too small for velocity 40"),
        ({"adaptive_lookahead": nan}, "adaptive_lookahead is nan"),
        ({"drivetrain": 1}, "Yaw cannot be specified as rate if drivetrain is ForwardOnly"),
        ({"yaw_mode": YawMode(False, nan)}, "yaw_or_rate is nan"),
    ],
)
def test_wrong_options_are_named(change: dict[str, object], message: str) -> None:
    with pytest.raises(MoveError, match=message):
        move_to_position((1.0, 2.0, 3.0), PathOptions(5.0)._replace(**change))  # type: ignore[arg-type]


def test_a_wrong_point_is_named() -> None:
    with pytest.raises(MoveError, match=r"a point of the path is \(1.0, nan, 0.0\)"):
        move_on_path([(0.0, 0.0, 0.0), (1.0, nan, 0.0)], PathOptions(5.0))
    with pytest.raises(MoveError, match="yaw is inf"):
        RotateToYaw(inf, 1.0, 5.0)
    with pytest.raises(MoveError, match="timeout_sec is nan"):
        Land(nan)
