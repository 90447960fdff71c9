"""Moves of fixed length: exact durations, frames and signs, results, and arguments."""

from __future__ import annotations

from math import cos, degrees, hypot, inf, nan, radians, sin

import pytest

from hil.apps.airsim.flight import timed
from hil.apps.airsim.flight.move import MoveError
from hil.apps.airsim.flight.ned_edge import HOVER_THROTTLE
from hil.apps.airsim.flight.spot import Hover
from hil.apps.airsim.flight.yaw import YawMode
from signals._kernel import roll_pitch_yaw
from sim.physics.vehicle import load_vehicle
from tests.worlds.airsim_flight import AIRFIELD, TICK_NS, Pilot, airborne
from tests.worlds.rotor_models import quadratic

KEEP = YawMode()


def pilot(vehicle: str = "iris", tick_ns: int = TICK_NS, *, simple: bool = False) -> Pilot:
    """Return a pilot 20 m above the ground, hovering; its NED frame begins there. It looks east.

    `simple`: with the quadratic model of the rotors.
    """
    flown = quadratic(vehicle) if simple else load_vehicle(vehicle)
    made = Pilot(airborne(flown, (3.0, -2.0, 20.0), tick_ns=tick_ns))
    made.wait(0.5)
    return made


@pytest.mark.parametrize("tick_ns", [TICK_NS, 3_003_003, 2_500_000, 1_000_000])
@pytest.mark.parametrize("duration_s", [0.02, 0.05, 0.1, 0.10000000149011612, 1.0, 1.01])
def test_a_duration_is_exact_to_20_ms(tick_ns: int, duration_s: float) -> None:
    flown = pilot(tick_ns=tick_ns)
    result, took_s = flown.do(timed.move_by_velocity((1.0, 0.0, 0.0), duration_s, 0, KEEP))
    periods = -(-round(duration_s * 1e6) // 20_000)
    assert result is True
    assert periods * 0.02 - 1e-9 <= took_s < periods * 0.02 + tick_ns * 1e-9 - 1e-12


def test_moves_follow_each_other_without_a_gap() -> None:
    flown = pilot()
    begin_s = flown.t_s
    for _ in range(50):
        flown.do(timed.move_by_velocity((1.0, 0.0, 0.0), 0.1, 0, KEEP))
    assert flown.t_s - begin_s == pytest.approx(5.0, abs=1e-9)


def test_no_duration_sends_nothing() -> None:
    flown = pilot()
    for duration_s in (0.0, -1.0):
        assert flown.do(timed.move_by_velocity((9.0, 0.0, 0.0), duration_s, 0, KEEP))[0] is True
        assert flown.do(timed.move_by_velocity_z((9.0, 0.0), -5.0, duration_s, 0, KEEP))[0] is False  # as in AirSim
    assert hypot(*flown.wait(0.5).v_mps) < 0.01


def test_velocity_is_in_ned() -> None:
    flown = pilot()
    flown.do(timed.move_by_velocity((3.0, -2.0, -1.0), 3.0, 0, KEEP))
    assert flown.ned.v_mps == pytest.approx((3.0, -2.0, -1.0), abs=0.02)
    assert degrees(flown.ned.yaw_rad) == pytest.approx(90.0, abs=0.5)  # as it was


def test_velocity_with_height() -> None:
    flown = pilot()
    flown.do(timed.move_by_velocity_z((0.0, 4.0), -6.0, 5.0, 0, KEEP))
    assert flown.ned.p_m[2] == pytest.approx(-6.0, abs=0.02)
    assert flown.ned.v_mps == pytest.approx((0.0, 4.0, 0.0), abs=0.02)


def test_body_frame_velocity_is_along_the_heading_at_the_start() -> None:
    flown = pilot()
    turning = YawMode(is_rate=True, yaw_or_rate=45.0)
    flown.do(timed.move_by_velocity((2.0, 1.0, 0.5), 3.0, 0, turning, body=True))
    assert flown.ned.v_mps == pytest.approx((-1.0, 2.0, 0.5), abs=0.05)  # ahead is east, right is south
    flown = pilot()
    flown.do(timed.move_by_velocity_z((0.0, -2.0), 3.0, 4.0, 0, KEEP, body=True))
    assert flown.ned.v_mps == pytest.approx((2.0, 0.0, 0.0), abs=0.03)
    assert flown.ned.p_m[2] == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize(
    ("mode", "drivetrain", "expected_deg"),
    [
        (YawMode(is_rate=False, yaw_or_rate=-30.0), 0, -30.0),
        (YawMode(is_rate=False, yaw_or_rate=400.0), 0, 40.0),
        (YawMode(is_rate=False, yaw_or_rate=0.0), 1, 135.0),  # the course of (-3, 3)
        (YawMode(is_rate=False, yaw_or_rate=90.0), 1, -135.0),
        (YawMode(is_rate=True, yaw_or_rate=-20.0), 0, 90.0 - 4.0 * 20.0),
    ],
)
def test_yaw_modes(mode: YawMode, drivetrain: int, expected_deg: float) -> None:
    flown = pilot()
    flown.do(timed.move_by_velocity((-3.0, 3.0, 0.0), 4.0, drivetrain, mode))
    assert degrees(flown.ned.yaw_rad) == pytest.approx(expected_deg, abs=3.0)


def test_a_slow_course_does_not_turn_the_nose() -> None:
    flown = pilot()
    flown.do(timed.move_by_velocity((-0.2, 0.0, 0.0), 2.0, 1, YawMode(False, 0.0)))
    assert degrees(flown.ned.yaw_rad) == pytest.approx(90.0, abs=0.5)


def test_attitudes_are_in_frd() -> None:
    """Roll to the right, pitch nose up, heading clockwise."""
    for move in (
        timed.move_by_attitude(2.0, roll=0.2, pitch=-0.1, yaw=radians(60.0), z=0.0),
        timed.move_by_attitude(2.0, roll=0.2, pitch=-0.1, yaw=radians(60.0), throttle=HOVER_THROTTLE),
    ):
        flown = pilot()
        flown.do(move)
        assert roll_pitch_yaw(flown.ned.q) == pytest.approx((0.2, -0.1, radians(60.0)), abs=0.01)
        yaw = flown.ned.yaw_rad
        north, east, _ = flown.ned.v_mps
        assert north * cos(yaw) + east * sin(yaw) > 0.3  # nose down: forward
        assert east * cos(yaw) - north * sin(yaw) > 0.3  # to the right
    for move in (
        timed.move_by_attitude(2.0, roll=0.1, pitch=0.1, yaw_rate=0.3, z=0.0),
        timed.move_by_attitude(2.0, roll=0.1, pitch=0.1, yaw_rate=0.3, throttle=HOVER_THROTTLE),
    ):
        flown = pilot()
        flown.do(move)
        assert roll_pitch_yaw(flown.ned.q)[:2] == pytest.approx((0.1, 0.1), abs=0.01)
        assert flown.ned.w_radps[2] == pytest.approx(0.3, abs=0.01)


def test_body_rates_are_in_frd() -> None:
    for move in (
        timed.move_by_attitude(0.6, roll_rate=0.3, pitch_rate=-0.2, yaw_rate=0.4, z=0.0),
        timed.move_by_attitude(0.6, roll_rate=0.3, pitch_rate=-0.2, yaw_rate=0.4, throttle=HOVER_THROTTLE),
    ):
        flown = pilot()
        flown.do(move)
        assert flown.ned.w_radps == pytest.approx((0.3, -0.2, 0.4), abs=0.02)


@pytest.mark.parametrize("simple", [False, True])
@pytest.mark.parametrize("vehicle", ["iris", "x500", "racer", "octa_x"])
def test_the_throttle_of_airsim_hovers_any_vehicle(vehicle: str, simple: bool) -> None:
    flown = pilot(vehicle, simple=simple)
    flown.do(timed.move_by_attitude(1.0, roll_rate=0.0, pitch_rate=0.0, yaw_rate=0.0, throttle=HOVER_THROTTLE))
    assert flown.ned.v_mps[2] == pytest.approx(0.0, abs=0.02)
    flown.do(timed.move_by_attitude(1.0, roll_rate=0.0, pitch_rate=0.0, yaw_rate=0.0, throttle=1.1 * HOVER_THROTTLE))
    # A climb costs thrust: most of the octocopter's large propellers of little pitch.
    assert flown.ned.v_mps[2] == pytest.approx(-0.1 * AIRFIELD.gravity_mps2, rel=0.15 if simple else 0.25)


@pytest.mark.parametrize("vehicle", ["iris", "x500", "racer"])
def test_motor_pwms(vehicle: str) -> None:
    flown = pilot(vehicle)
    flown.do(timed.move_by_motor_pwms((HOVER_THROTTLE,) * 4, 0.5))
    assert flown.ned.v_mps == pytest.approx((0.0, 0.0, 0.0), abs=0.03)
    more, less = HOVER_THROTTLE + 0.005, HOVER_THROTTLE - 0.005
    for pwms, roll, pitch in (
        ((less, more, more, less), 1, 0),  # left: rolls right
        ((more, less, more, less), 0, 1),  # front: nose up
    ):
        flown = pilot(vehicle)
        flown.do(timed.move_by_motor_pwms(pwms, 0.2))
        rates = flown.ned.w_radps
        assert rates[0] * roll + rates[1] * pitch > 0.01
        assert abs(rates[0] * pitch) + abs(rates[1] * roll) < 0.2 * (rates[0] * roll + rates[1] * pitch)
    flown = pilot(vehicle)
    flown.do(timed.move_by_motor_pwms((more, more, less, less), 0.2))  # the counter-clockwise ones: turns right
    assert flown.ned.w_radps[2] > 0.0005


def test_motor_pwms_need_four_rotors() -> None:
    flown = pilot("hexa_x")
    with pytest.raises(MoveError, match="needs a vehicle with four rotors"):
        flown.do(timed.move_by_motor_pwms((0.6,) * 4, 0.5))
    assert hypot(*flown.wait(1.0).v_mps) < 0.01


def test_rotating_by_a_rate_stays_in_place() -> None:
    flown = pilot()
    result, took_s = flown.do(timed.rotate_by_yaw_rate(-40.0, 2.0))
    assert result is True
    assert took_s == pytest.approx(2.0)
    assert degrees(flown.ned.yaw_rad) == pytest.approx(90.0 - 80.0, abs=4.0)
    assert flown.ned.p_m == pytest.approx((0.0, 0.0, 0.0), abs=0.02)


def test_hover_begins_60_ms_after_the_last_command() -> None:
    flown = pilot()
    flown.do(timed.move_by_velocity((5.0, 0.0, 0.0), 2.0, 0, KEEP))
    last = flown.ned
    place = flown.wait(0.06)  # the last command was sent 20 ms before the end
    assert place.v_mps[0] > 0.8 * last.v_mps[0]
    flown.wait(8.0)
    assert flown.ned.p_m[0] == pytest.approx(last.p_m[0] + 0.25, abs=0.1)  # where the hovering began
    assert hypot(*flown.ned.v_mps) < 0.01


def test_hover_stays_where_it_was_called() -> None:
    flown = pilot()
    flown.do(timed.move_by_velocity((3.0, 0.0, 0.0), 2.0, 0, KEEP))
    called = flown.ned.p_m
    result, took_s = flown.do(Hover())
    assert result is True
    assert took_s <= 0.02 + 1e-9
    assert flown.wait(6.0).p_m == pytest.approx(called, abs=0.02)


NUMBERS = [nan, inf, -inf]


@pytest.mark.parametrize("bad", NUMBERS)
@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("vx", lambda x: timed.move_by_velocity((x, 0.0, 0.0), 1.0, 0, KEEP)),
        ("vz", lambda x: timed.move_by_velocity((0.0, 0.0, x), 1.0, 0, KEEP)),
        ("yaw_or_rate", lambda x: timed.move_by_velocity((0.0, 0.0, 0.0), 1.0, 0, YawMode(True, x))),
        ("z", lambda x: timed.move_by_velocity_z((0.0, 0.0), x, 1.0, 0, KEEP)),
        ("vy", lambda x: timed.move_by_velocity((0.0, x, 0.0), 1.0, 0, KEEP, body=True)),
        ("vx", lambda x: timed.move_by_velocity_z((x, 0.0), 0.0, 1.0, 0, KEEP, body=True)),
        ("rear_left_pwm", lambda x: timed.move_by_motor_pwms((0.1, x, 0.1, 0.1), 1.0)),
        ("roll", lambda x: timed.move_by_attitude(1.0, roll=x, pitch=0.0, yaw=0.0, z=0.0)),
        ("pitch", lambda x: timed.move_by_attitude(1.0, roll=0.0, pitch=x, yaw=0.0, throttle=0.5)),
        ("yaw_rate", lambda x: timed.move_by_attitude(1.0, roll=0.0, pitch=0.0, yaw_rate=x, z=0.0)),
        ("throttle", lambda x: timed.move_by_attitude(1.0, roll=0.0, pitch=0.0, yaw_rate=0.0, throttle=x)),
        ("roll_rate", lambda x: timed.move_by_attitude(1.0, roll_rate=x, pitch_rate=0.0, yaw_rate=0.0, z=0.0)),
        ("throttle", lambda x: timed.move_by_attitude(1.0, roll_rate=0.0, pitch_rate=0.0, yaw_rate=0.0, throttle=x)),
        ("yaw_rate", lambda x: timed.rotate_by_yaw_rate(x, 1.0)),
    ],
)
def test_a_number_that_is_not_finite_is_named(name: str, make: object, bad: float) -> None:
    with pytest.raises(MoveError, match=f"{name} is (nan|inf|-inf); it has to be finite"):
        make(bad)  # type: ignore[operator]


def test_wrong_durations_and_drivetrains_are_named() -> None:
    with pytest.raises(MoveError, match="duration is nan"):
        timed.move_by_velocity((0.0, 0.0, 0.0), nan, 0, KEEP)
    with pytest.raises(MoveError, match=r"drivetrain is 2; it is 0 .* or 1"):
        timed.move_by_velocity((0.0, 0.0, 0.0), 1.0, 2, KEEP)
