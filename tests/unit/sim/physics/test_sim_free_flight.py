"""Free flight: signs, frames, trims, lags and limits. Its accuracy is in tests/reference/test_physics_reference.py."""

from __future__ import annotations

import math

import pytest

from signals.errors import ModelRangeError
from signals.samples import TruthState
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Scene
from tests.worlds.rotation_matrices import rotation
from tests.worlds.rotor_models import quadratic

TICK_NS = 4_000_000
TICK_S = 0.004
HIGH = (3.0, -2.0, 500.0)
VEHICLES = multirotor_names()


def spin_rotors(physics: VehiclePhysics, control: float) -> None:
    """Start with the rotors already at the speed of `control`."""
    physics.state[13:] = multirotor.speed_radps(physics.vehicle, control)


def fly(physics: VehiclePhysics, controls: tuple[float, ...], ticks: int) -> TruthState:
    truth = physics.advance(0, controls)
    for tick in range(1, ticks + 1):
        truth = physics.advance(tick, controls)
    return truth


@pytest.mark.parametrize("name", VEHICLES)
def test_hover_control_holds_the_weight(name: str, airfield: Scene) -> None:
    for vehicle, thin in ((quadratic(name), 1.0), (load_vehicle(name), airfield.site.density_ratio)):
        hover = multirotor.hover_control(vehicle, thin)
        low = airfield.model_copy(update={"site": airfield.site.model_copy(update={"altitude_m": 488.0 - HIGH[2]})})
        physics = VehiclePhysics(vehicle, low, TICK_NS, start=FlightStart(p_WB=HIGH))
        spin_rotors(physics, hover)
        truth = fly(physics, (hover,) * len(vehicle.rotors), 250)
        # By momentum theory the torques of a coaxial pair are only about equal, and a y6 begins to yaw.
        within = 1e-4 if name == "y6" and vehicle.rotor_model == "blade_element" else 1e-9
        assert truth.v_WB_W == pytest.approx((0.0, 0.0, 0.0), abs=within)
        assert truth.p_WB == pytest.approx(HIGH, abs=within)


def test_iris_hovers_where_px4_was_measured_to() -> None:
    assert multirotor.hover_control(load_vehicle("iris")) == pytest.approx(0.598, abs=1e-3)


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("rotor", range(8))
def test_each_rotor_turns_the_body_the_right_way(name: str, rotor: int, airfield: Scene) -> None:
    """Speed up one rotor: front rotors pitch the nose up (negative about left), right rotors roll to the left (negative
    about forward), counter-clockwise rotors turn the body clockwise seen from above (negative about up)."""
    vehicle = load_vehicle(name)
    if rotor >= len(vehicle.rotors):
        pytest.skip("no such rotor")
    x, y, _ = vehicle.rotors[rotor].position_m
    expected = [0.0 if value == 0.0 else math.copysign(1.0, value) for value in (y, -x)]
    physics = VehiclePhysics(vehicle, airfield, TICK_NS, start=FlightStart(p_WB=HIGH))
    hover = multirotor.hover_control(vehicle)
    spin_rotors(physics, hover)
    controls = [hover] * len(vehicle.rotors)
    physics.advance(0, controls)
    controls[rotor] += 0.05
    alpha = physics.advance(1, controls).alpha_WB_B
    signs = [0.0 if abs(a) < 1e-3 else math.copysign(1.0, a) for a in alpha]
    assert signs == [*expected, -vehicle.rotors[rotor].spin.sign]


@pytest.mark.parametrize("name", ["x500", "iris", "racer"])
def test_autopilot_table_in_frd(name: str) -> None:
    """Quad-x order: front right, rear left, front left, rear right; in FRD y is right, and CCW rotors yaw it right."""
    rotors = load_vehicle(name).rotors
    places = [(r.position_m[0] > 0, -r.position_m[1] > 0) for r in rotors]
    assert places == [(True, True), (False, False), (True, False), (False, True)]
    assert [r.spin.sign for r in rotors] == [1.0, 1.0, -1.0, -1.0]


def test_rotor_lag_is_exponential_with_its_own_constant_each_way(airfield: Scene) -> None:
    vehicle = load_vehicle("x500")
    c = vehicle.rotor_constants
    physics = VehiclePhysics(vehicle, airfield, TICK_NS, start=FlightStart(p_WB=HIGH))
    spin_rotors(physics, 0.5)
    truth = fly(physics, (0.8, 0.2, 0.5, 2.0), 5)
    t = 5 * TICK_S
    expected = [
        800.0 - 300.0 * math.exp(-t / c.time_constant_up_s),
        200.0 + 300.0 * math.exp(-t / c.time_constant_down_s),
        500.0,
        1000.0 - 500.0 * math.exp(-t / c.time_constant_up_s),  # saturates at full command
    ]
    assert truth.rotor_speed_radps == pytest.approx(expected, rel=1e-13)


def test_mean_accelerations_are_exact_differences(airfield: Scene) -> None:
    physics = VehiclePhysics(load_vehicle("iris"), airfield, TICK_NS, start=FlightStart(p_WB=HIGH))
    controls = (0.7, 0.6, 0.5, 0.65)
    before = physics.advance(0, controls)
    after = physics.advance(1, controls)
    for k in range(3):
        assert after.a_WB_W[k] == (after.v_WB_W[k] - before.v_WB_W[k]) / TICK_S
        assert after.alpha_WB_B[k] == (after.w_WB_B[k] - before.w_WB_B[k]) / TICK_S


def test_initial_yaw_turns_counter_clockwise_from_east(airfield: Scene) -> None:
    physics = VehiclePhysics(load_vehicle("x500"), airfield, TICK_NS, start=FlightStart(yaw_rad=math.pi / 2))
    forward = rotation(physics.advance(0, (0.0,) * 4).q_WB)[:, 0]
    assert forward == pytest.approx((0.0, 1.0, 0.0), abs=1e-15)


@pytest.mark.parametrize(
    ("place", "value", "variable"),
    [(7, 300.0, "speed_mps"), (10, 250.0, "body_rate_radps"), (0, 6e4, "distance_from_site_m"), (8, math.nan, "state")],
)
def test_leaving_the_range_is_named(place: int, value: float, variable: str, airfield: Scene) -> None:
    physics = VehiclePhysics(load_vehicle("x500"), airfield, TICK_NS, start=FlightStart(p_WB=HIGH))
    physics.state[place] = value
    physics.advance(0, (0.0,) * 4)
    with pytest.raises(ModelRangeError) as caught:
        physics.advance(1, (0.0,) * 4)
    assert caught.value.tick == 1
    assert caught.value.variable.startswith(variable)


def test_commands_are_checked(airfield: Scene) -> None:
    physics = VehiclePhysics(load_vehicle("x500"), airfield, TICK_NS)
    physics.advance(0, (0.0,) * 4)
    with pytest.raises(ModelRangeError, match=r"controls\[2\]"):
        physics.advance(1, (0.0, 0.0, math.nan, 0.0))
    with pytest.raises(ValueError, match="fewer controls"):
        physics.advance(2, (0.0,) * 3)
    with pytest.raises(ValueError, match="order"):
        physics.advance(7, (0.0,) * 4)
