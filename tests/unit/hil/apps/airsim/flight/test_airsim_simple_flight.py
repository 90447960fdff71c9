"""simple_flight: API control, arming, one move at a time, remote control, gains, and the same bits twice."""

from __future__ import annotations

import hashlib
import random
from math import degrees, dist, hypot, inf, nan, pi
from typing import Any

import pytest

from hil.apps.airsim.flight.gains import DEFAULT_KP, with_gains
from hil.apps.airsim.flight.move import MoveError
from hil.apps.airsim.flight.path import PathOptions, TakeOff, go_home, move_on_path, move_to_position, move_to_z
from hil.apps.airsim.flight.remote import Manual, RcData, Receiver
from hil.apps.airsim.flight.spot import Hover, Land, RotateToYaw
from hil.apps.airsim.flight.timed import (
    move_by_attitude,
    move_by_motor_pwms,
    move_by_velocity,
    rotate_by_yaw_rate,
)
from hil.apps.airsim.flight.yaw import YawMode
from hil.run.stepped.ideal_controller import Gains
from signals._kernel import roll_pitch_yaw
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.wind import Turbulence, Wind
from tests.worlds.airsim_flight import AIRFIELD, TICK_NS, Pilot, airborne

KEEP = YawMode()


def pilot() -> Pilot:
    """Return a pilot 20 m above the ground, hovering; its NED frame begins there. It looks east."""
    made = Pilot(airborne(load_vehicle("iris"), (0.0, 0.0, 20.0)))
    made.wait(0.5)
    return made


def test_a_new_move_cancels_the_running_one() -> None:
    flown = pilot()
    results: list[tuple[str, bool | MoveError]] = []
    flown.flight.start(move_to_position((100.0, 0.0, 0.0), PathOptions(5.0)), lambda r: results.append(("first", r)))
    flown.wait(2.0)
    assert results == []
    assert flown.flight.busy
    flown.flight.start(move_by_velocity((0.0, 2.0, 0.0), 1.0, 0, KEEP), lambda r: results.append(("second", r)))
    assert results == [("first", False)]
    flown.wait(1.0)
    assert results == [("first", False), ("second", True)]
    assert not flown.flight.busy


def test_a_cancelled_move_is_false_and_the_vehicle_stops() -> None:
    flown = pilot()
    results: list[bool | MoveError] = []
    flown.flight.start(move_to_position((100.0, 0.0, 0.0), PathOptions(5.0)), results.append)
    flown.wait(3.0)
    flown.flight.cancel()
    assert results == [False]
    place = flown.ned.p_m
    assert dist(flown.wait(6.0).p_m, place) < 1.0
    assert hypot(*flown.ned.v_mps) < 0.01
    flown.flight.cancel()
    assert results == [False]


def test_a_move_near_its_end_that_is_cancelled_stops_where_it_is() -> None:
    flown = pilot()
    flown.flight.start(move_to_position((8.0, 0.0, 0.0), PathOptions(2.0)), lambda _: None)
    flown.wait(2.5)  # on the last leg, sent to the end itself
    flown.flight.cancel()
    assert flown.wait(5.0).p_m[0] < 6.0


def test_a_move_without_api_control_is_an_error() -> None:
    flown = pilot()
    flown.flight.enable_api_control(False)
    with pytest.raises(MoveError, match=r"call enableApiControl\(True\) first"):
        flown.flight.start(Hover(), lambda _: None)


def test_without_api_control_the_vehicle_falls_and_with_it_hovers() -> None:
    flown = pilot()
    results: list[bool | MoveError] = []
    flown.flight.start(move_to_position((100.0, 0.0, 0.0), PathOptions(5.0)), results.append)
    flown.flight.enable_api_control(False)
    assert results == [False]
    assert flown.wait(0.5).v_mps[2] > 3.0
    flown.flight.enable_api_control(True)
    flown.wait(5.0)
    assert hypot(*flown.ned.v_mps) < 0.01
    place = flown.ned.p_m
    flown.flight.enable_api_control(True)  # again: nothing changes
    assert dist(flown.wait(1.0).p_m, place) < 0.01


def test_arming() -> None:
    flown = Pilot()
    flight = flown.flight
    flown.wait(0.5)
    assert min(flown.truth.rotor_speed_radps) > 10.0
    assert flight.landed
    assert flight.arm(True) is True
    assert flight.arm(False) is True
    assert flight.arm(False) is False  # as in AirSim
    flown.wait(0.5)
    assert max(flown.truth.rotor_speed_radps) < 0.01
    flight.enable_api_control(False)
    assert flight.arm(True) is False
    flight.enable_api_control(True)
    assert flown.do(TakeOff(20.0))[0] is True  # a move arms, as in AirSim
    assert flight.armed


def test_disarming_in_the_air_cancels_the_move_and_stops_the_rotors() -> None:
    flown = pilot()
    results: list[bool | MoveError] = []
    flown.flight.start(go_home(inf), results.append)
    flown.flight.arm(False)
    assert results == [False]
    flown.wait(0.5)
    assert flown.ned.v_mps[2] > 3.0
    assert max(flown.truth.rotor_speed_radps) < 1.0
    flown.flight.arm(True)
    flown.wait(6.0)
    assert hypot(*flown.ned.v_mps) < 0.01


def test_a_reset_asks_for_api_control_and_arming_again() -> None:
    flown = pilot()
    results: list[bool | MoveError] = []
    flown.flight.start(go_home(inf), results.append)
    flown.flight.reset()
    assert results == [False]
    assert not flown.flight.api_control
    assert not flown.flight.armed


def test_a_vehicle_that_is_put_elsewhere_hovers_there() -> None:
    flown = pilot()
    flown.truth = flown.physics.place((30.0, 10.0, 40.0), (0.8, 0.0, 0.0, 0.6))
    flown.flight.moved()
    flown.wait(5.0)
    assert flown.truth.p_WB == pytest.approx((30.0, 10.0, 40.0), abs=0.02)
    assert hypot(*flown.ned.v_mps) < 0.01


def rc(**sticks: float) -> RcData:
    return RcData(is_valid=True, **sticks)  # type: ignore[arg-type]


def test_the_sticks_command_attitude_without_api_control() -> None:
    flown = pilot()
    flown.flight.enable_api_control(False)
    flown.flight.set_rc(rc(roll=0.5, pitch=0.5, throttle=0.65))
    flown.wait(1.0)
    roll, pitch, _ = roll_pitch_yaw(flown.ned.q)
    assert degrees(roll) == pytest.approx(0.5 * 180.0 / 5.5, abs=0.5)
    assert degrees(pitch) == pytest.approx(-0.5 * 180.0 / 5.5, abs=0.5)  # forward
    flown.flight.set_rc(rc(yaw=0.1, throttle=0.6))
    flown.wait(1.0)
    assert flown.ned.w_radps[2] == pytest.approx(0.1 * pi, abs=0.01)
    flown.flight.set_rc(RcData(roll=0.3, throttle=0.6, rates=True, is_valid=True))
    flown.wait(0.5)
    assert flown.ned.w_radps[0] == pytest.approx(0.3 * pi / 5.5, abs=0.01)


def test_with_api_control_the_sticks_do_nothing() -> None:
    flown = pilot()
    flown.flight.set_rc(rc(roll=1.0, throttle=1.0))
    assert hypot(*flown.wait(1.0).v_mps) < 0.001
    with pytest.raises(MoveError, match="roll is nan"):
        flown.flight.set_rc(rc(roll=nan))


def test_manual_flight_follows_fresh_sticks() -> None:
    flown = pilot()
    manual = Manual(flown.flight.receiver, (1e5, 1e5), -1e4, 8.0, 0, KEEP)
    results: list[bool | MoveError] = []
    flown.flight.start(manual, results.append)
    assert hypot(*flown.wait(1.0).p_m) < 0.01  # no remote control: hovers
    flown.flight.set_rc(rc(pitch=0.3))
    flown.wait(2.0)
    assert flown.ned.v_mps == pytest.approx((0.0, 3.0, 0.0), abs=0.05)  # 0.3 * 1e5 / 1e4, ahead: east
    flown.flight.set_rc(rc(roll=0.2, throttle=0.5))
    flown.wait(2.0)
    assert flown.ned.v_mps[0] == pytest.approx(-2.0, abs=0.05)  # right: south
    assert flown.ned.v_mps[2] < -0.5  # 0.5 m above wherever it is: climbs
    flown.flight.set_rc(RcData(1, pitch=1.0, is_valid=True))  # old
    flown.wait(2.0)
    assert hypot(*flown.ned.v_mps) < 0.7
    assert results == []
    flown.wait(1.0)
    assert results == [True]
    with pytest.raises(MoveError, match="z_min is inf"):
        Manual(flown.flight.receiver, (1.0, 1.0), inf, 1.0, 0, KEEP)
    assert flown.do(Manual(flown.flight.receiver, (1.0, 1.0), 0.0, 0.0, 0, KEEP))[0] is True


def test_gains_are_factors_of_airsims_defaults() -> None:
    none = (0.0, 0.0, 0.0)
    assert with_gains(Gains(), "rate", (0.5, 0.25, 0.125), none, none) == (Gains(rate=(2.0, 1.0, 0.5)), False)
    gains, ignored = with_gains(Gains(), "velocity", (0.4, 0.2, 1.0), (0.0, 0.0, 2.0), none)
    assert gains.velocity == (1.0, 2.0, 0.5)  # x of NED is y of W
    assert not ignored
    assert with_gains(Gains(), "position", DEFAULT_KP["position"], none, (0.1, 0.0, 0.0)) == (Gains(), True)
    for loop, kp, message in (
        ("rate", (nan, 0.25, 0.25), "kp is .*three finite numbers"),
        ("attitude", (2.5, 2.5), "kp is .*three finite numbers"),
        ("attitude", (-1.0, 2.5, 2.5), "kp is -1; the attitude controller takes 0 to 50"),
        ("velocity", (0.2, 0.2, 41.0), "kp is 41; the velocity controller takes 0 to 40"),
    ):
        with pytest.raises(MoveError, match=message):
            with_gains(Gains(), loop, kp, none, none)


def test_a_higher_position_gain_reaches_the_place_sooner() -> None:
    times = []
    for kp in (0.125, 0.25, 0.375):
        flown = pilot()
        assert not flown.flight.set_gains("position", (kp,) * 3, (0.0,) * 3, (0.0,) * 3)
        times.append(flown.do(move_to_position((0.4, 0.0, 0.0), PathOptions(2.0)))[1])
    assert times[0] > 1.2 * times[1] > 1.1 * 1.2 * times[2]


@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))])
def test_numbers_of_any_size_are_flown_without_a_failure(seed: int) -> None:
    draw = random.Random(seed)

    def some(count: int) -> Any:
        return tuple(draw.choice((3e38, -3e38, 1e20, 1e-300, 0.0, 1e6, -1e9, 1e3)) for _ in range(count))

    def mode() -> YawMode:
        return YawMode(draw.random() < 0.5, *some(1))

    flown = pilot()
    receiver = Receiver()
    for _ in range(15):
        for make in (
            lambda: move_by_velocity(some(3), 0.2, draw.choice((0, 1)), mode()),
            lambda: move_by_attitude(0.2, **dict(zip(("roll", "pitch", "yaw", "z"), some(4), strict=True))),
            lambda: rotate_by_yaw_rate(*some(1), 0.2),
            lambda: RotateToYaw(*some(1), 0.2, *some(1)),
            lambda: move_by_motor_pwms(some(4), 0.1),
            lambda: move_on_path([some(3), some(3)], PathOptions(3e38, 0.2, 0, mode(), 3e38, *some(1))),
            lambda: Manual(receiver, some(2), *some(1), 0.2, 0, mode()),
        ):
            receiver.data = RcData(0, *some(4), is_valid=True)
            flown.do(make())
            assert all(0.0 <= u <= 1.0 for u in flown.flight.controls(flown.truth))
            if flown.ned.p_m[2] > -5.0:
                flown = pilot()


def digest() -> str:
    """Return the digest of a flight with every kind of move, in turbulence."""
    wind = Wind(steady_W_mps=(3.0, 1.0, 0.0), turbulence=Turbulence(level="light"))
    physics = VehiclePhysics(
        load_vehicle("iris"), AIRFIELD, TICK_NS, start=FlightStart(), disturbances=Disturbances(wind=wind, seed=5)
    )
    flown = Pilot(physics)
    for move in (
        TakeOff(20.0),
        move_on_path(
            [(3.0, 0.0, -4.0), (3.0, 4.0, -4.0)], PathOptions(3.0, drivetrain=1, yaw_mode=YawMode(False, 0.0))
        ),
        RotateToYaw(20.0, 10.0, 5.0),
        move_by_velocity((2.0, 1.0, -0.5), 1.0, 0, YawMode(False, 45.0)),
        move_by_attitude(0.5, roll=0.1, pitch=0.05, yaw=0.3, z=-5.0),
        rotate_by_yaw_rate(50.0, 0.5),
        move_by_motor_pwms((0.6, 0.6, 0.6, 0.6), 0.2),
        Hover(),
        move_to_z(-1.0, PathOptions(2.0)),
        Land(20.0),
    ):
        flown.do(move)
    return hashlib.sha256(repr(flown.log).encode()).hexdigest()


def test_the_same_moves_give_the_same_bits() -> None:
    assert digest() == digest()
