"""Ideal controller in the real physics: accuracy, wind, limits, and the same bits twice."""

from __future__ import annotations

import hashlib
from math import cos, dist, inf, nan, sin, sqrt

import numpy as np
import pytest

from hil.run.stepped.ideal_controller import Gains, IdealController
from hil.run.stepped.setpoint import IDLE, Setpoint
from signals._kernel import roll_pitch_yaw
from signals.rotation import yaw_of
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Box
from sim.scene.wind import Turbulence, Wind
from tests.worlds.airsim_flight import (
    AIRFIELD,
    GRAVITY_MPS2,
    TICK_NS,
    Flown,
    airborne,
    calm,
    tilt_rad,
    with_boxes,
)
from tests.worlds.rotor_models import quadratic

NAMES = multirotor_names()
PLACE = (0.0, 0.0, 50.0)
HOLD = Setpoint(p_xy_m=(0.0, 0.0), z_m=50.0, yaw_rad=0.0)


def flown(
    name: str = "iris",
    *,
    wind_W: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tick_ns: int = TICK_NS,
    simple: bool = False,
) -> Flown:
    """`simple`: with the quadratic model of the rotors, whose thrust does not change with the flow."""
    vehicle = quadratic(name) if simple else load_vehicle(name)
    return Flown(airborne(vehicle, PLACE, tick_ns=tick_ns, disturbances=calm(wind_W)))


@pytest.mark.parametrize(
    ("name", "tick_ns"),
    [
        *((name, TICK_NS) for name in NAMES),
        *(
            pytest.param(name, tick_ns, marks=[] if name == "iris" else pytest.mark.slow)
            for name in NAMES
            for tick_ns in (3_003_003, 2_500_000, 1_000_000)
        ),
    ],
)
def test_hovers_within_a_centimetre(name: str, tick_ns: int) -> None:
    flight = flown(name, tick_ns=tick_ns)
    flight.fly(HOLD, 3.0)
    assert max(dist(truth.p_WB, PLACE) for truth in flight.log) < 0.01
    assert dist(flight.truth.p_WB, PLACE) < 1e-4
    assert max(tilt_rad(truth) for truth in flight.log) < 0.001


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("speed_mps", [1.0, pytest.param(8.0, marks=pytest.mark.slow), 12.0])
def test_velocity_steps_are_well_damped(name: str, speed_mps: float) -> None:
    flight = flown(name)
    flight.fly(Setpoint(v_xy_mps=(0.6 * speed_mps, -0.8 * speed_mps), z_m=50.0, yaw_rad=1.0), 5.0)
    speeds = [0.6 * truth.v_WB_W[0] - 0.8 * truth.v_WB_W[1] for truth in flight.log]
    assert max(speeds) < 1.01 * speed_mps
    assert speeds[-1] == pytest.approx(speed_mps, abs=0.005 * speed_mps)
    assert max(abs(truth.p_WB[2] - 50.0) for truth in flight.log) < 0.05
    across = [0.8 * truth.p_WB[0] + 0.6 * truth.p_WB[1] for truth in flight.log]
    assert max(map(abs, across)) < 0.1
    reached = next(i for i, speed in enumerate(speeds) if speed > 0.9 * speed_mps) * TICK_NS * 1e-9
    assert reached < 0.9 + speed_mps / 6.0  # 6 m/s2 and the time of the loops


@pytest.mark.parametrize("name", NAMES)
def test_a_far_position_is_reached_without_overshoot(name: str) -> None:
    flight = flown(name)
    flight.fly(Setpoint(p_xy_m=(30.0, -40.0), z_m=60.0, yaw_rad=0.0, speed_limit_mps=10.0), 11.0)
    assert dist(flight.truth.p_WB, (30.0, -40.0, 60.0)) < 0.01
    assert max(truth.p_WB[0] for truth in flight.log) < 30.01
    assert max(truth.p_WB[2] for truth in flight.log) < 60.01
    assert max(sqrt(sum(v * v for v in truth.v_WB_W)) for truth in flight.log) < 10.2
    # The way is straight: 5 units up and east for every unit of the other axes' proportion.
    line = np.array([30.0, -40.0, 10.0]) / sqrt(2600.0)
    way = np.array([truth.p_WB for truth in flight.log]) - PLACE
    assert np.abs(np.cross(way, line)).max() < 0.5


@pytest.mark.parametrize("name", NAMES)
def test_a_wind_of_10_mps_is_rejected(name: str) -> None:
    flight = flown(name, wind_W=(8.0, -6.0, 0.0))
    flight.fly(HOLD, 6.0)
    assert max(dist(truth.p_WB, PLACE) for truth in flight.log) < 0.2  # the wind is there from the first tick
    assert dist(flight.truth.p_WB, PLACE) < 0.001
    # 15 m/s through the air: at 20 m/s some of the rotors, tilted into the wind, no longer have the thrust.
    flight.fly(Setpoint(v_xy_mps=(-4.0, 3.0), z_m=50.0, yaw_rad=0.0), 5.0)
    assert flight.truth.v_WB_W[0] == pytest.approx(-4.0, abs=0.1)
    assert flight.truth.p_WB[2] == pytest.approx(50.0, abs=0.05)
    simple = flown(name, wind_W=(8.0, -6.0, 0.0), simple=True)
    simple.fly(Setpoint(v_xy_mps=(-8.0, 6.0), z_m=50.0, yaw_rad=0.0), 5.0)
    assert simple.truth.v_WB_W[0] == pytest.approx(-8.0, abs=0.1)
    assert simple.truth.p_WB[2] == pytest.approx(50.0, abs=0.05)


def test_turbulence_and_a_weak_rotor_move_the_vehicle_by_centimetres() -> None:
    turbulence = Wind(steady_W_mps=(5.0, 0.0, 0.0), turbulence=Turbulence(level="moderate"))
    weak = RotorFault(kind="efficiency", rotor=1, at_s=1.0, factor=0.8)
    disturbances = Disturbances(wind=turbulence, seed=4, faults=(weak,))
    flight = Flown(airborne(load_vehicle("x500"), PLACE, disturbances=disturbances))
    flight.fly(HOLD, 10.0)
    assert max(dist(truth.p_WB, PLACE) for truth in flight.log) < 0.1


def test_an_octocopter_flies_on_without_a_rotor() -> None:
    stuck = RotorFault(kind="stuck", rotor=2, at_s=1.0)
    flight = Flown(airborne(load_vehicle("octa_x"), PLACE, disturbances=Disturbances(faults=(stuck,))))
    flight.fly(HOLD, 6.0)
    assert max(dist(truth.p_WB, PLACE) for truth in flight.log) < 0.2
    assert dist(flight.truth.p_WB, PLACE) < 0.001


def test_a_sagging_battery_costs_no_accuracy() -> None:
    flight = Flown(airborne(load_vehicle("x500"), PLACE, effects=Effects(battery=True)))
    flight.fly(Setpoint(v_xy_mps=(8.0, 0.0), z_m=50.0, yaw_rad=0.0), 10.0)
    assert flight.physics.battery is not None
    assert flight.physics.battery.voltage_v < 16.5
    assert flight.truth.v_WB_W[0] == pytest.approx(8.0, abs=0.01)
    assert flight.truth.p_WB[2] == pytest.approx(50.0, abs=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_heading_and_yaw_rate(name: str) -> None:
    flight = flown(name)
    flight.fly(HOLD._replace(yaw_rad=3.0), 6.0)
    yaws = [yaw_of(truth.q_WB) for truth in flight.log]
    assert yaws[-1] == pytest.approx(3.0, abs=1e-3)
    assert max(yaws) < 3.1
    assert max(dist(truth.p_WB, PLACE) for truth in flight.log) < 0.02
    turning = HOLD._replace(yaw_rad=None, yaw_rate_radps=-0.5)
    flight.fly(turning, 3.0)
    assert flight.truth.w_WB_B[2] == pytest.approx(-0.5, abs=0.005)
    flight.fly(turning._replace(yaw_rate_radps=0.0), 2.0)
    held = yaw_of(flight.truth.q_WB)
    flight.fly(turning._replace(yaw_rate_radps=0.0), 3.0)
    assert yaw_of(flight.truth.q_WB) == pytest.approx(held, abs=0.002)


@pytest.mark.parametrize("name", NAMES)
def test_attitude_with_height(name: str) -> None:
    flight = flown(name)
    flight.fly(Setpoint(roll_pitch_rad=(0.3, -0.2), z_m=50.0, yaw_rad=0.4), 2.5)
    assert roll_pitch_yaw(flight.truth.q_WB) == pytest.approx((0.3, -0.2, 0.4), abs=0.005)
    assert max(abs(truth.p_WB[2] - 50.0) for truth in flight.log) < 0.05
    assert max(roll_pitch_yaw(truth.q_WB)[0] for truth in flight.log) < 0.33  # 10 % overshoot


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("simple", [False, True])
def test_body_rates_with_thrust(name: str, simple: bool) -> None:
    flight = flown(name, simple=simple)
    flight.fly(Setpoint(roll_pitch_rate_radps=(1.0, -0.5), thrust_ratio=1.0, yaw_rate_radps=0.2), 0.6)
    # The moments of the hubs grow with the speed that the tilt brings, and the rate lags behind by 3 %.
    assert flight.truth.w_WB_B == pytest.approx((1.0, -0.5, 0.2), abs=0.02 if simple else 0.03)
    assert max(truth.w_WB_B[0] for truth in flight.log) < 1.1


def test_a_thrust_of_one_weight_keeps_the_vertical_speed() -> None:
    flight = flown()
    flight.fly(Setpoint(roll_pitch_rad=(0.0, 0.0), thrust_ratio=1.0, yaw_rad=0.0), 1.0)
    assert flight.truth.v_WB_W[2] == pytest.approx(0.0, abs=0.01)
    flight.fly(Setpoint(roll_pitch_rad=(0.0, 0.0), thrust_ratio=1.2, yaw_rad=0.0), 0.5)
    assert flight.truth.v_WB_W[2] == pytest.approx(0.1 * GRAVITY_MPS2, rel=0.1)


@pytest.mark.parametrize("name", NAMES)
def test_commands_beyond_the_limits_stay_stable(name: str) -> None:
    for setpoint in (
        Setpoint(v_xy_mps=(40.0, 0.0), z_m=50.0, yaw_rad=0.0),
        Setpoint(v_xy_mps=(0.0, 0.0), vz_mps=30.0, yaw_rad=2.0),
        Setpoint(v_xy_mps=(0.0, 20.0), vz_mps=-8.0, yaw_rate_radps=5.0),
    ):
        flight = flown(name)
        flight.fly(setpoint, 3.0)
        assert max(tilt_rad(truth) for truth in flight.log) < 1.1  # 63 degrees
        flight.fly(HOLD, 14.0)
        assert dist(flight.truth.p_WB, PLACE) < 0.02


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("q", "w"), [((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((0.6, 0.0, 0.8, 0.0), (8.0, 6.0, 9.0))])
def test_recovers_from_any_attitude(name: str, q: tuple[float, ...], w: tuple[float, ...]) -> None:
    physics = airborne(load_vehicle(name), PLACE)
    physics.state[3:7], physics.state[10:13] = q, w
    flight = Flown(physics)
    flight.fly(HOLD, 10.0)
    assert min(truth.p_WB[2] for truth in flight.log) > 35.0
    assert dist(flight.truth.p_WB, PLACE) < 0.02


@pytest.mark.parametrize(("name", "simple"), [*((name, False) for name in NAMES), ("x500", True)])
@pytest.mark.parametrize("period_s", [0.052, 0.3])
def test_random_horizontal_speeds_keep_the_height(name: str, simple: bool, period_s: float) -> None:
    flight, speeds = flown(name, simple=simple), np.random.default_rng(3)
    for vx, vy in speeds.uniform(-5.0, 5.0, (round(20.0 / period_s), 2)):
        flight.fly(Setpoint(v_xy_mps=(vx, vy), vz_mps=0.0, yaw_rate_radps=0.0), period_s)
    heights = [truth.p_WB[2] for truth in flight.log]
    # The x500 has least thrust to spare: its rotors run at full speed while it tilts to and fro.
    assert max(abs(height - 50.0) for height in heights) < (0.4 if name == "x500" and not simple else 0.15)
    assert abs(heights[-1] - heights[len(heights) // 2]) / 10.0 < 0.01  # m/s
    assert max(tilt_rad(truth) for truth in flight.log) > 0.3


@pytest.mark.parametrize("amplitude_mps", [1.0, 5.0])
@pytest.mark.parametrize("half_ticks", [62, 25, 12, 6])  # 2, 5, 10 and 20 Hz
def test_a_speed_to_and_fro_keeps_the_height(half_ticks: int, amplitude_mps: float) -> None:
    flight = flown()
    for i in range(1000 // half_ticks):
        speed = amplitude_mps if i % 2 else -amplitude_mps
        flight.fly(Setpoint(v_xy_mps=(speed, 0.0), vz_mps=0.0, yaw_rate_radps=0.0), half_ticks * TICK_NS * 1e-9)
    assert max(abs(truth.p_WB[2] - 50.0) for truth in flight.log) < 0.02


def test_a_stopped_climb_holds_the_height_and_the_ground_ends_it() -> None:
    flight = flown(wind_W=(0.0, 0.0, 2.0))
    flight.fly(Setpoint(v_xy_mps=(0.0, 0.0), vz_mps=2.0, yaw_rad=0.0), 2.0)
    flight.fly(Setpoint(v_xy_mps=(0.0, 0.0), vz_mps=0.0, yaw_rad=0.0), 2.0)
    height_m = flight.truth.p_WB[2]
    flight.fly(Setpoint(v_xy_mps=(3.0, 0.0), vz_mps=0.0, yaw_rad=0.0), 5.0)
    assert flight.truth.p_WB[2] == pytest.approx(height_m, abs=0.005)
    flight = Flown(VehiclePhysics(load_vehicle("iris"), AIRFIELD, TICK_NS))
    z_m = flight.truth.p_WB[2]
    flight.fly(Setpoint(v_xy_mps=(0.0, 0.0), vz_mps=0.0, yaw_rad=0.0), 2.0)
    assert max(truth.p_WB[2] for truth in flight.log) < z_m + 0.05


def test_takes_off_from_the_ground_and_lands_on_it() -> None:
    flight = Flown(VehiclePhysics(load_vehicle("iris"), AIRFIELD, TICK_NS))
    z_m = flight.truth.p_WB[2]
    flight.fly(IDLE, 0.5)
    assert flight.truth.p_WB[2] == pytest.approx(z_m, abs=1e-4)
    flight.fly(Setpoint(p_xy_m=(0.0, 0.0), z_m=z_m + 2.0, yaw_rad=0.0, speed_limit_mps=0.5), 6.0)
    assert dist(flight.truth.p_WB, (0.0, 0.0, z_m + 2.0)) < 0.01
    assert not flight.controller.landed
    flight.fly(Setpoint(v_xy_mps=(0.0, 0.0), vz_mps=-0.5, yaw_rad=0.0), 5.5)
    assert flight.controller.landed
    assert flight.truth.p_WB == pytest.approx((0.0, 0.0, z_m), abs=0.005)
    assert max(flight.truth.rotor_speed_radps) < 100.0


def test_a_landing_with_speed_does_not_tip_over() -> None:
    for name in ("iris", "racer", "y6"):
        flight = Flown(airborne(load_vehicle(name), (0.0, 0.0, 2.0)))
        flight.fly(Setpoint(v_xy_mps=(2.0, 0.0), vz_mps=-1.0, yaw_rad=0.0), 4.0)
        assert flight.controller.landed
        assert tilt_rad(flight.truth) < 0.02


def test_a_vehicle_on_a_wall_falls_off_and_flies_on() -> None:
    wall = Box(name="wall", center_m=(12.0, 0.0, 20.0), size_m=(1.0, 40.0, 40.0))
    flight = Flown(airborne(load_vehicle("iris"), (0.0, 0.0, 30.0), scene=with_boxes(wall)))
    flight.fly(Setpoint(v_xy_mps=(8.0, 0.0), z_m=30.0, yaw_rad=0.0), 3.0)
    assert any(truth.in_contact for truth in flight.log)
    flight.fly(Setpoint(p_xy_m=(0.0, 0.0), z_m=30.0, yaw_rad=0.0), 10.0)
    assert dist(flight.truth.p_WB, (0.0, 0.0, 30.0)) < 0.02


def test_a_gain_scales_its_loop() -> None:
    lags = []
    for factor in (0.5, 1.0, 2.0):
        flight = flown()
        flight.controller.set_gains(Gains(position=(factor,) * 3))
        flight.fly(HOLD._replace(p_xy_m=(0.1, 0.0)), 0.8)
        lags.append(0.1 - flight.truth.p_WB[0])
    assert lags[0] > 1.4 * lags[1] > 1.4 * 1.4 * lags[2]
    with pytest.raises(ValueError, match="factor of the rate gain is 21; it goes from 0 to 20"):
        flight.controller.set_gains(Gains(rate=(21.0, 1.0, 1.0)))


@pytest.mark.parametrize("name", ["iris", "octa_x"])
@pytest.mark.parametrize("loop", Gains._fields)
@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_every_loop_has_margin(name: str, loop: str, factor: float) -> None:
    flight = flown(name)
    flight.controller.set_gains(Gains(**{loop: (factor,) * 3}))
    flight.fly(Setpoint(v_xy_mps=(5.0, 0.0), z_m=50.0, yaw_rad=1.0), 4.0)
    assert max(truth.v_WB_W[0] for truth in flight.log) < 5.5
    flight.fly(Setpoint(p_xy_m=(20.0, 0.0), z_m=50.0, yaw_rad=1.0), 8.0)
    assert dist(flight.truth.p_WB, (20.0, 0.0, 50.0)) < 0.01
    assert max(map(abs, flight.truth.w_WB_B)) < 0.01


@pytest.mark.parametrize(
    ("setpoint", "message"),
    [
        (Setpoint(), "exactly one of p_xy_m"),
        (HOLD._replace(v_xy_mps=(0.0, 0.0)), "exactly one of p_xy_m"),
        (HOLD._replace(z_m=None), "exactly one of z_m"),
        (HOLD._replace(yaw_rate_radps=0.0), "exactly one of yaw_rad"),
        (HOLD._replace(p_xy_m=(nan, 0.0)), "p_xy_m of a set-point is .*finite"),
        (HOLD._replace(yaw_rad=inf), "yaw_rad of a set-point is inf"),
        (HOLD._replace(speed_limit_mps=0.0), "speed_limit_mps of a set-point is 0"),
        (HOLD._replace(rotors=(0.5,) * 4), "no other values"),
        (Setpoint(rotors=(0.5, nan, 0.5, 0.5)), "rotors of a set-point"),
    ],
)
def test_wrong_setpoints_are_named(setpoint: Setpoint, message: str) -> None:
    flight = flown()
    with pytest.raises(ValueError, match=message):
        flight.controller.controls(flight.truth, setpoint)


def test_rotor_commands_pass_unchanged_and_limited() -> None:
    flight = flown()
    assert list(flight.controller.controls(flight.truth, Setpoint(rotors=(0.1, 1.5, -1.0, 0.4, 9.0)))) == [
        0.1,
        1.0,
        0.0,
        0.4,
    ]


def digest(name: str) -> str:
    """Return the digest of all states and commands of a flight with every mode."""
    physics = VehiclePhysics(
        load_vehicle(name), AIRFIELD, TICK_NS, start=FlightStart(), disturbances=calm((3.0, 1.0, 0.0))
    )
    flight = Flown(physics)
    for setpoint, seconds in (
        (Setpoint(p_xy_m=(3.0, 1.0), z_m=5.0, yaw_rad=1.0), 3.0),
        (Setpoint(v_xy_mps=(5.0, -2.0), vz_mps=1.0, yaw_rate_radps=0.5), 1.0),
        (Setpoint(roll_pitch_rad=(0.2, 0.1), z_m=8.0, yaw_rad=0.0), 1.0),
        (Setpoint(roll_pitch_rate_radps=(0.5, 0.2), thrust_ratio=1.1, yaw_rate_radps=0.1), 0.5),
        (Setpoint(v_xy_mps=(0.0, 0.0), vz_mps=-3.0, yaw_rate_radps=0.0), 4.0),
    ):
        flight.fly(setpoint, seconds)
    return hashlib.sha256(repr(flight.log).encode()).hexdigest()


def test_the_same_flight_has_the_same_bits() -> None:
    assert digest("hexa_x") == digest("hexa_x")


def test_a_reset_controller_flies_as_a_new_one() -> None:
    flight = flown()
    old, thin = flight.controller, flight.physics.density_ratio
    old_commands = []
    flight.fly(Setpoint(v_xy_mps=(5.0, 0.0), z_m=52.0, yaw_rad=1.0), 1.0)
    old.reset()
    new = IdealController(flight.physics.vehicle, TICK_NS, GRAVITY_MPS2, density_ratio=thin)
    old_commands = [list(old.controls(flight.truth, HOLD)) for _ in range(3)]
    assert old_commands == [list(new.controls(flight.truth, HOLD)) for _ in range(3)]


def test_roll_is_to_the_right_and_pitch_nose_down() -> None:
    for roll_pitch, expected in (((0.2, 0.0), (0.0, -1.0)), ((0.0, 0.2), (1.0, 0.0))):
        flight = flown()
        flight.fly(Setpoint(roll_pitch_rad=roll_pitch, z_m=50.0, yaw_rad=0.5), 1.5)
        yaw = yaw_of(flight.truth.q_WB)
        x, y = flight.truth.v_WB_W[:2]
        ahead, left = x * cos(yaw) + y * sin(yaw), y * cos(yaw) - x * sin(yaw)
        assert ahead * expected[0] + left * expected[1] > 0.9 * sqrt(x * x + y * y) > 0.5
