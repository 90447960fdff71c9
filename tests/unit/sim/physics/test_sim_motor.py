"""Motors against closed forms: steady states, a rotor that coasts, the battery's current; what follows from them."""

from __future__ import annotations

import math
from typing import Any

import pydantic
import pytest

from hil.config.multirotor_facts import multirotor_facts
from sim.physics import multirotor
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault, misfits
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.forces.motor import lag_s, steady_duty, steady_speed_radps
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.worlds.motors import SLOW_FLYER, with_motors

TICK_NS = 4_000_000
DT = 0.004
STILL = Effects(ground_effect=False, descent_loss=False, air_density=False)


def in_the_air(vehicle: Vehicle, *, speed: float | None = None, **options: Any) -> VehiclePhysics:
    options = {"effects": STILL} | options
    physics = VehiclePhysics(
        vehicle, load_scene("airfield"), TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, 1000.0)), **options
    )
    physics.state[13:] = vehicle.hover_speeds_radps()[0] if speed is None else speed
    physics.advance(0, (0.0,) * 4)
    return physics


def plain(**changes: Any) -> Vehicle:
    """Return the x500 with motors and a torque that the flow does not change."""
    return with_motors("x500", model="quadratic", **changes)


@pytest.mark.parametrize("braking", [True, False])
@pytest.mark.parametrize("duty", [0.05, 0.3, 0.6, 1.0])
def test_steady_speed_of_the_kernel(duty: float, *, braking: bool) -> None:
    vehicle = plain(active_braking=braking)
    c, motor = vehicle.rotor_constants, vehicle.rotor_constants.motor
    assert motor is not None
    expected = steady_speed_radps(c, motor, duty)
    assert steady_duty(c, motor, expected) == pytest.approx(duty, rel=1e-12)
    assert multirotor.speed_radps(vehicle, duty) == expected
    physics = in_the_air(vehicle, speed=0.9 * expected)
    for tick in range(1, 500):
        truth = physics.advance(tick, (duty,) * 4)
    assert truth.rotor_speed_radps == pytest.approx((expected,) * 4, rel=1e-9)


def test_constants_that_follow_from_the_motor() -> None:
    vehicle = plain()
    c, motor = vehicle.rotor_constants, vehicle.rotor_constants.motor
    assert motor is not None
    hover, most = vehicle.hover_speeds_radps()[0], c.max_speed_radps
    assert steady_duty(c, motor, most) == pytest.approx(1.0, rel=1e-12)
    # The curve of relative thrust goes through hover, and is near the motor's elsewhere.
    u, f = multirotor.hover_control(vehicle), c.thrust_model_factor
    assert f * u * u + (1.0 - f) * u == pytest.approx((hover / most) ** 2, rel=1e-9)
    for duty in (0.2, 0.4, 0.8):
        share = (steady_speed_radps(c, motor, duty) / most) ** 2
        assert f * duty * duty + (1.0 - f) * duty == pytest.approx(share, abs=0.06)
    # A small step of the speed decays with the time constant.
    physics = in_the_air(vehicle, speed=hover * 1.001)
    for tick in range(1, 6):
        truth = physics.advance(tick, (u,) * 4)
    left = (truth.rotor_speed_radps[0] / hover - 1.0) / 0.001
    assert left == pytest.approx(math.exp(-5 * DT / c.time_constant_up_s), rel=2e-3)
    assert c.time_constant_up_s == c.time_constant_down_s == lag_s(c, motor, hover)
    # A file that has been read once reads the same again.
    assert Vehicle.model_validate(vehicle.model_dump()) == vehicle


@pytest.mark.parametrize("name", ["x500", "y6", "iris"])
@pytest.mark.parametrize("model", ["blade_element", "wind_tunnel"])
def test_hover_command_at_the_site(name: str, model: str) -> None:
    """With thin air the rotors turn faster for the same thrust, against the same torque."""
    vehicle = with_motors(name, model=model)
    scene = load_scene("airfield")
    ratio = multirotor.density_ratio(vehicle, scene.site, Effects())
    assert ratio == pytest.approx(0.954, abs=1e-3)
    control = multirotor.hover_control(vehicle, ratio)
    aloft = {"effects": Effects(ground_effect=False), "start": FlightStart(p_WB=(0.0, 0.0, 1.0))}
    physics = VehiclePhysics(vehicle, scene, TICK_NS, **aloft)
    physics.state[13:] = vehicle.hover_speeds_radps(ratio)[0]
    physics.advance(0, (control,))
    for tick in range(1, 50):
        truth = physics.advance(tick, (control,) * len(vehicle.rotors))
    # Coaxial pairs: the torque of the lower rotor, in the wake of the upper one, differs from that of a rotor alone.
    assert abs(truth.a_WB_W[2]) < (0.002 if name != "y6" else 1.2)
    facts = multirotor_facts(vehicle, ratio)
    u, f = facts.hover_control, facts.thrust_model_factor
    assert facts.full_effect[3].sum() * (f * u * u + (1.0 - f) * u) == pytest.approx(
        vehicle.mass_kg * 9.80665, rel=1e-6
    )


@pytest.mark.parametrize(("model", "faster"), [("blade_element", 1.01), ("wind_tunnel", 1.03)])
def test_the_flow_takes_load_from_the_rotors(model: str, faster: float) -> None:
    """At an advance ratio of 0.45 a rotor turns faster with the same duty cycle; in still air it holds its speed."""
    vehicle = with_motors("x500", model=model)
    c, control = vehicle.rotor_constants, (multirotor.hover_control(vehicle),) * 4
    hover = vehicle.hover_speeds_radps()[0]
    climb_mps = 0.45 * hover * c.radius_m / math.pi
    physics = in_the_air(vehicle)
    for tick in range(1, 30):
        physics.place(p_WB=(0.0, 0.0, 1000.0), v_WB_W=(0.0, 0.0, climb_mps), rotor_speed_radps=physics.state[13:])
        truth = physics.advance(tick, control)
    speed = truth.rotor_speed_radps[0]
    assert speed > faster * hover
    if model == "wind_tunnel":  # the duty cycle that holds this speed against the torque at this advance ratio
        (b0, b1, b2), J = SLOW_FLYER["power_coefficients"], math.pi * climb_mps / (speed * c.radius_m)
        loaded = c.model_copy(update={"moment_ratio_m": c.moment_ratio_m * (b0 + b1 * J + b2 * J * J) / b0})
        assert c.motor is not None
        assert steady_duty(loaded, c.motor, speed) == pytest.approx(control[0], rel=3e-3)
    physics.place(p_WB=(0.0, 0.0, 1000.0), rotor_speed_radps=(hover,) * 4)
    assert physics.advance(30, control).rotor_speed_radps == pytest.approx((hover,) * 4, rel=1e-6)


def test_a_rotor_without_current_coasts() -> None:
    """J dO/dt = -m k O^2: O = O_0 / (1 + m k O_0 t / J), without friction."""
    vehicle = plain(no_load_current_a=0.0)
    c = vehicle.rotor_constants
    fault = RotorFault(kind="desync", rotor=1, at_s=0.0, for_s=0.1)
    physics = in_the_air(vehicle, speed=800.0, disturbances=Disturbances(faults=[fault]))
    rate = c.moment_ratio_m * c.thrust_coefficient_n_per_radps2 * 800.0 / c.inertia_kgm2
    for tick in range(1, 26):
        truth = physics.advance(tick, (1.0,) * 4)
        assert truth.rotor_speed_radps[1] == pytest.approx(800.0 / (1.0 + rate * tick * DT), rel=1e-9)
        assert truth.rotor_speed_radps[0] > 800.0
    assert [event.text for event in physics.take_events()] == [
        "rotor 1: the speed controller loses the rotor",
        "rotor 1: the speed controller has found the rotor",
    ]
    lowest = truth.rotor_speed_radps[1]
    for tick in range(26, 60):
        truth = physics.advance(tick, (1.0,) * 4)
    assert truth.rotor_speed_radps[1] > lowest + 100.0


def test_a_later_fault_replaces_a_desync() -> None:
    faults = [
        RotorFault(kind="desync", rotor=1, at_s=0.0, for_s=0.1),
        RotorFault(kind="stuck", rotor=1, at_s=0.04, speed_radps=50.0),
    ]
    physics = in_the_air(plain(), disturbances=Disturbances(faults=faults))
    for tick in range(1, 200):
        truth = physics.advance(tick, (0.5,) * 4)
    assert truth.rotor_speed_radps[1] == pytest.approx(50.0, rel=1e-3)
    assert [event.t_ns for event in physics.take_events()] == [0, 40_000_000]
    physics.restart(0)
    assert physics.advance(1, (0.5,) * 4).rotor_speed_radps[1] < physics.truth.rotor_speed_radps[0]


def test_a_desync_needs_a_motor_that_can_lose_its_rotor() -> None:
    fault = RotorFault(kind="desync", rotor=1, at_s=1.0)
    [(index, key, message)] = misfits([fault], load_vehicle("x500"))
    assert (index, key) == (0, "kind")
    assert message.startswith("is desync, and x500 has no rotor_constants.motor that could lose its rotor")
    assert message.endswith("Give it a motor, or use stuck with speed_radps: 0")
    assert misfits([fault], plain()) == []
    with pytest.raises(pydantic.ValidationError, match="for_s has no meaning for the kind 'stuck'"):
        RotorFault.model_validate({"kind": "stuck", "rotor": 1, "at_s": 1.0, "for_s": 1.0})


def test_voltage_and_charge_of_the_motors() -> None:
    """V = E - R_b (4 u I + P_0 / V) at the tick's start; the charge over it is that of a steady current."""
    vehicle = plain()
    battery, motor, c = vehicle.battery, vehicle.rotor_constants.motor, vehicle.rotor_constants
    assert battery is not None
    assert motor is not None
    physics = in_the_air(vehicle, effects=STILL.model_copy(update={"battery": True}))
    assert physics.battery is not None
    open_v = physics.battery.voltage_v + battery.resistance_ohm * battery.auxiliary_w / physics.battery.voltage_v
    duty = 0.7
    for tick in range(1, 400):
        speed, charge = physics.truth.rotor_speed_radps[0], physics.battery.charge
        physics.advance(tick, (duty,) * 4)
    K, volts = 1.0 / motor.speed_per_volt_radps, physics.battery.voltage_v
    current = 4.0 * duty * (duty * volts - K * speed) / motor.resistance_ohm + battery.auxiliary_w / volts
    assert physics.battery.current_a == pytest.approx(current, rel=1e-5)
    assert volts == pytest.approx(open_v - battery.resistance_ohm * current, abs=0.03)  # E has fallen with the charge
    assert (charge - physics.battery.charge) * 3600.0 * battery.capacity_ah == pytest.approx(current * DT, rel=1e-5)
    # Input power = shaft power + losses in the winding and of friction.
    torque = c.moment_ratio_m * c.thrust_coefficient_n_per_radps2 * speed * speed
    amperes = (duty * volts - K * speed) / motor.resistance_ohm
    friction = K * motor.no_load_current_a * speed / (speed + 20.0)
    losses = amperes * amperes * motor.resistance_ohm + friction * speed
    assert duty * volts * amperes == pytest.approx(torque * speed + losses, rel=1e-4)


@pytest.mark.parametrize("braking", [True, False])
def test_only_active_braking_feeds_the_battery(*, braking: bool) -> None:
    vehicle = plain(active_braking=braking)
    physics = in_the_air(vehicle, speed=900.0, effects=STILL.model_copy(update={"battery": True}))
    truth = physics.advance(1, (0.3,) * 4)
    assert physics.battery is not None
    assert (physics.battery.current_a < 0.0) == braking
    coasting = in_the_air(plain(active_braking=False), speed=900.0).advance(1, (0.3,) * 4)
    if braking:
        assert truth.rotor_speed_radps[0] < coasting.rotor_speed_radps[0] - 20.0


def test_a_pack_that_cannot_deliver_the_current() -> None:
    vehicle = plain()
    assert vehicle.battery is not None
    weak = vehicle.model_copy(update={"battery": vehicle.battery.model_copy(update={"auxiliary_w": 9000.0})})
    with pytest.raises(Exception, match="the pack cannot deliver the power"):
        in_the_air(weak, effects=Effects(battery=True)).advance(1, (0.5,) * 4)


def test_a_placed_vehicle_has_the_bits_of_a_new_one() -> None:
    vehicle = with_motors("x500")
    flown, fresh = in_the_air(vehicle), in_the_air(vehicle, speed=500.0)
    for tick in range(1, 20):
        flown.advance(tick, (0.4, 0.9, 0.1, 0.6))
    flown.place(p_WB=(0.0, 0.0, 1000.0), rotor_speed_radps=(500.0,) * 4)
    for tick in range(1, 20):
        a, b = flown.advance(19 + tick, (0.6,) * 4), fresh.advance(tick, (0.6,) * 4)
        assert a.rotor_speed_radps == b.rotor_speed_radps
        assert a.p_WB == b.p_WB


def test_dead_time_of_a_part_of_a_tick() -> None:
    """A delay of half a tick is the flight at half the tick, for speeds and charge."""
    vehicle = plain()
    late = vehicle.model_copy(
        update={"rotor_constants": vehicle.rotor_constants.model_copy(update={"dead_time_s": 0.002})}
    )
    physics = in_the_air(late, speed=600.0)
    fine = VehiclePhysics(
        vehicle, load_scene("airfield"), 2_000_000, effects=STILL, start=FlightStart(p_WB=(0.0, 0.0, 1000.0))
    )
    fine.state[13:] = 600.0
    fine.advance(0, (0.0,) * 4)
    then = 0.0
    for tick, duty in enumerate((0.9, 0.2, 0.6), start=1):
        truth = physics.advance(tick, (duty,) * 4)
        fine.advance(2 * tick - 1, (then,) * 4)
        half = fine.advance(2 * tick, (duty,) * 4)
        assert truth.rotor_speed_radps == pytest.approx(half.rotor_speed_radps, rel=1e-10)
        then = duty


def test_take_off_from_the_ground_and_rest() -> None:
    """On the ground the speeds advance in the contact steps, near those of free flight."""
    vehicle = with_motors("x500")
    physics = VehiclePhysics(vehicle, load_scene("airfield"), TICK_NS)
    control = 0.8 * multirotor.hover_control(vehicle)
    physics.advance(0, (0.0,) * 4)
    assert physics.truth.rotor_speed_radps == (0.0,) * 4
    for tick in range(1, 250):
        truth = physics.advance(tick, (control,) * 4)
    assert truth.in_contact
    assert truth.rotor_speed_radps[0] == pytest.approx(multirotor.speed_radps(vehicle, control), rel=0.03)
    for tick in range(250, 500):
        truth = physics.advance(tick, (1.2 * multirotor.hover_control(vehicle),) * 4)
    assert truth.p_WB[2] > 1.0


@pytest.mark.parametrize(
    ("motor", "said"),
    [
        ({"nominal_voltage_v": 11.1}, r"nominal_voltage_v is 11\.1 and battery\.nominal_voltage_v 14\.8"),
        ({"kv_rpm_per_v": 0.5}, "kv_rpm_per_v"),
        ({"resistance_ohm": 0.0}, "resistance_ohm"),
        ({"kv_rpm_per_v": 30.0}, "inertia_kgm2 2.64986e-05 is too small for the motor, which needs at least"),
        ({"poles": 14}, "poles"),
    ],
)
def test_wrong_motors_are_refused(motor: dict[str, float], said: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=said):
        plain(**motor)
