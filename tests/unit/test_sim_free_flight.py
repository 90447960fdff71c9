"""Free flight against closed forms: signs, frames, trims, conservation laws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.signals.errors import ModelRangeError
from hil.signals.samples import TruthState
from sim.physics.quadrotor import QuadrotorPhysics
from sim.physics.vehicle import Vehicle, load_vehicle, vehicle_names
from sim.scene.scene import Scene, load_scene
from tests.unit.rotations import rotation

TICK_NS = 4_000_000
TICK_S = 0.004
HIGH = (3.0, -2.0, 500.0)
VEHICLES = vehicle_names()
CONTROLS = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))


@pytest.fixture(scope="module")
def airfield() -> Scene:
    return load_scene("airfield")


def airless(vehicle: Vehicle) -> Vehicle:
    """The same vehicle where nothing drags."""
    constants = vehicle.rotor_constants.model_copy(update={"drag_kg_per_rad": 0.0})
    return vehicle.model_copy(
        update={
            "rotor_constants": constants,
            "body_drag_linear_n_per_mps": (0.0, 0.0, 0.0),
            "body_drag_quadratic_n_per_m2ps2": (0.0, 0.0, 0.0),
        }
    )


def spin_rotors(physics: QuadrotorPhysics, control: float) -> None:
    """Start with the rotors already at the speed of `control`."""
    physics.state[13:] = physics.vehicle.speed_radps(control)


def fly(physics: QuadrotorPhysics, controls: tuple[float, ...], ticks: int) -> TruthState:
    truth = physics.advance(0, controls)
    for tick in range(1, ticks + 1):
        truth = physics.advance(tick, controls)
    return truth


def test_free_fall_without_air_is_a_parabola(airfield: Scene) -> None:
    physics = QuadrotorPhysics(airless(load_vehicle("x500")), airfield, TICK_NS, initial_p_WB=HIGH)
    physics.state[7:10] = (2.0, -1.0, 3.0)
    truth = fly(physics, (0.0,) * 4, 500)
    t, g = 2.0, airfield.gravity_mps2
    assert truth.p_WB == pytest.approx((3.0 + 2.0 * t, -2.0 - t, 500.0 + 3.0 * t - 0.5 * g * t * t), abs=1e-10)
    assert truth.v_WB_W == pytest.approx((2.0, -1.0, 3.0 - g * t), abs=1e-10)
    assert truth.a_WB_W == pytest.approx((0.0, 0.0, -g), abs=1e-10)


@pytest.mark.parametrize("name", VEHICLES)
def test_hover_control_holds_the_weight(name: str, airfield: Scene) -> None:
    vehicle = load_vehicle(name)
    physics = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=HIGH)
    spin_rotors(physics, vehicle.hover_control)
    truth = fly(physics, (vehicle.hover_control,) * 4, 250)
    assert truth.v_WB_W == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert truth.p_WB == pytest.approx(HIGH, abs=1e-9)


def test_iris_hovers_where_px4_was_measured_to() -> None:
    assert load_vehicle("iris").hover_control == pytest.approx(0.598, abs=1e-3)


# Rows: rotor. Columns: sign of the first angular acceleration about forward, left, up when only it speeds up.
# Front rotors pitch the nose up (negative about left), right rotors roll to the left (negative about forward),
# counter-clockwise rotors turn the body clockwise seen from above (negative about up).
SIGNS = [(-1, -1, -1), (+1, +1, -1), (+1, -1, +1), (-1, +1, +1)]


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("rotor", range(4))
def test_each_rotor_turns_the_body_the_right_way(name: str, rotor: int, airfield: Scene) -> None:
    vehicle = load_vehicle(name)
    physics = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=HIGH)
    hover = vehicle.hover_control
    spin_rotors(physics, hover)
    physics.advance(0, (hover,) * 4)
    controls = [hover] * 4
    controls[rotor] += 0.05
    alpha = physics.advance(1, controls).alpha_WB_B
    assert tuple(int(math.copysign(1.0, a)) for a in alpha) == SIGNS[rotor]


@pytest.mark.parametrize("name", VEHICLES)
def test_autopilot_table_in_frd(name: str) -> None:
    """Quad-x order: front right, rear left, front left, rear right; in FRD y is right, and CCW rotors yaw it right."""
    rotors = load_vehicle(name).rotors
    places = [(r.position_m[0] > 0, -r.position_m[1] > 0) for r in rotors]
    assert places == [(True, True), (False, False), (True, False), (False, True)]
    assert [r.spin.sign for r in rotors] == [1.0, 1.0, -1.0, -1.0]


def test_pure_yaw_torque_has_the_closed_form(airfield: Scene) -> None:
    """CCW pair up, CW pair down at constant total thrust: dw_z/dt = -m_ratio dT / I_zz, no roll, no pitch."""
    vehicle = airless(load_vehicle("x500"))
    c = vehicle.rotor_constants
    physics = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=HIGH)
    hover_thrust = vehicle.mass_kg * 9.80665 / 4
    up = math.sqrt(1.1 * hover_thrust / c.thrust_coefficient_n_per_radps2) / c.max_speed_radps
    down = math.sqrt(0.9 * hover_thrust / c.thrust_coefficient_n_per_radps2) / c.max_speed_radps
    controls = (up, up, down, down)
    physics.state[13:] = [u * c.max_speed_radps for u in controls]
    truth = fly(physics, controls, 100)
    expected = -c.moment_ratio_m * 0.4 * hover_thrust / vehicle.inertia_kgm2[2]
    assert truth.w_WB_B == pytest.approx((0.0, 0.0, expected * 0.4), abs=1e-9)
    assert truth.v_WB_W == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_rotor_lag_is_exponential_with_its_own_constant_each_way(airfield: Scene) -> None:
    vehicle = load_vehicle("x500")
    c = vehicle.rotor_constants
    physics = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=HIGH)
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


def test_torque_free_tumble_conserves_momentum_and_energy(airfield: Scene) -> None:
    """With two spinning rotor pairs that don't cancel, the body's plus the rotors' angular momentum stays put."""
    vehicle = airless(load_vehicle("x500"))
    thrustless = vehicle.rotor_constants.model_copy(
        update={"thrust_coefficient_n_per_radps2": 1e-30, "inertia_kgm2": 1e-4}
    )
    vehicle = vehicle.model_copy(update={"rotor_constants": thrustless, "inertia_kgm2": (0.02, 0.03, 0.044)})
    physics = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=HIGH)
    physics.state[10:13] = (3.0, -8.0, 2.0)
    physics.state[13:] = (600.0, 500.0, 100.0, 50.0)
    controls = (0.6, 0.5, 0.1, 0.05)
    inertia = np.diag(vehicle.inertia_kgm2)
    spin = 1e-4 * (600.0 + 500.0 - 100.0 - 50.0)

    def momentum(truth: TruthState) -> np.ndarray:
        return rotation(truth.q_WB) @ (inertia @ truth.w_WB_B + [0, 0, spin])

    def energy(truth: TruthState) -> float:
        return 0.5 * float(np.array(truth.w_WB_B) @ inertia @ truth.w_WB_B)

    truth = start = physics.advance(0, controls)
    for tick in range(1, 1251):
        truth = physics.advance(tick, controls)
    # 5 s at 9 rad/s: the integrator's own error, order 4 at 2 ms.
    assert np.linalg.norm(momentum(truth) - momentum(start)) < 1e-7 * np.linalg.norm(momentum(start))
    assert energy(truth) == pytest.approx(energy(start), rel=1e-7)
    assert sum(c * c for c in truth.q_WB) == pytest.approx(1.0, abs=1e-15)


def test_wind_is_air_that_moves(airfield: Scene) -> None:
    """Galilean invariance: hovering in wind w equals flying at -w in still air."""
    vehicle = load_vehicle("x500")
    windy = airfield.model_copy(update={"wind_W_mps": (4.0, -3.0, 1.0)})
    a = QuadrotorPhysics(vehicle, windy, TICK_NS, initial_p_WB=HIGH)
    b = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=HIGH)
    b.state[7:10] = (-4.0, 3.0, -1.0)
    controls = (0.7, 0.72, 0.75, 0.77)
    for physics in (a, b):
        physics.state[10:13] = (0.3, -0.2, 0.5)
    in_wind, in_still_air = fly(a, controls, 100), fly(b, controls, 100)
    assert in_wind.q_WB == pytest.approx(in_still_air.q_WB, abs=1e-11)
    moved = [v - w for v, w in zip(in_wind.v_WB_W, (4.0, -3.0, 1.0), strict=True)]
    assert moved == pytest.approx(in_still_air.v_WB_W, abs=1e-11)


def test_drag_opposes_motion_and_stops_a_fall(airfield: Scene) -> None:
    vehicle = load_vehicle("x500")
    physics = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=(0.0, 0.0, 3000.0))
    truth = fly(physics, (0.0,) * 4, 10_000)
    terminal = math.sqrt(vehicle.mass_kg * 9.80665 / vehicle.body_drag_quadratic_n_per_m2ps2[2])
    assert truth.v_WB_W[2] == pytest.approx(-terminal, rel=1e-4)


def test_mean_accelerations_are_exact_differences(airfield: Scene) -> None:
    physics = QuadrotorPhysics(load_vehicle("iris"), airfield, TICK_NS, initial_p_WB=HIGH)
    controls = (0.7, 0.6, 0.5, 0.65)
    before = physics.advance(0, controls)
    after = physics.advance(1, controls)
    for k in range(3):
        assert after.a_WB_W[k] == (after.v_WB_W[k] - before.v_WB_W[k]) / TICK_S
        assert after.alpha_WB_B[k] == (after.w_WB_B[k] - before.w_WB_B[k]) / TICK_S


def test_initial_yaw_turns_counter_clockwise_from_east(airfield: Scene) -> None:
    physics = QuadrotorPhysics(load_vehicle("x500"), airfield, TICK_NS, initial_yaw_rad=math.pi / 2)
    forward = rotation(physics.advance(0, (0.0,) * 4).q_WB)[:, 0]
    assert forward == pytest.approx((0.0, 1.0, 0.0), abs=1e-15)


@pytest.mark.parametrize(
    ("place", "value", "variable"),
    [(7, 300.0, "speed_mps"), (10, 250.0, "body_rate_radps"), (0, 6e4, "distance_from_site_m"), (8, math.nan, "state")],
)
def test_leaving_the_range_is_named(place: int, value: float, variable: str, airfield: Scene) -> None:
    physics = QuadrotorPhysics(load_vehicle("x500"), airfield, TICK_NS, initial_p_WB=HIGH)
    physics.state[place] = value
    physics.advance(0, (0.0,) * 4)
    with pytest.raises(ModelRangeError) as caught:
        physics.advance(1, (0.0,) * 4)
    assert caught.value.tick == 1
    assert caught.value.variable.startswith(variable)


def test_commands_are_checked(airfield: Scene) -> None:
    physics = QuadrotorPhysics(load_vehicle("x500"), airfield, TICK_NS)
    physics.advance(0, (0.0,) * 4)
    with pytest.raises(ModelRangeError, match=r"controls\[2\]"):
        physics.advance(1, (0.0, 0.0, math.nan, 0.0))
    with pytest.raises(ValueError, match="fewer controls"):
        physics.advance(2, (0.0,) * 3)
    with pytest.raises(ValueError, match="order"):
        physics.advance(7, (0.0,) * 4)
