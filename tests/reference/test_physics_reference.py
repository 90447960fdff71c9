"""Free flight against the CasADi model solved by CVODES: size and order of the error, with every effect active."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.physics.multirotor_reference import Inputs, attitude_error_rad, fly
from sim.physics import multirotor
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.integration import Integration
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.wind import GustEvent, Turbulence, Wind
from tests.worlds.tilted_rotors import tilted

Float64 = NDArray[np.float64]
TICK_NS = 4_000_000
by_model = pytest.mark.parametrize("model", ["blade_element", "quadratic"])
ON = {"ground_effect": True, "descent_loss": True}


def shipped(name: str, model: str) -> Vehicle:
    """Return a shipped vehicle with one of the two models of its rotors."""
    return load_vehicle(name).model_copy(update={"rotor_model": model})


def hard_commands(vehicle: Vehicle, seconds: float, tick_ns: int = TICK_NS) -> Float64:
    """Return commands that climb, roll, pitch and yaw at about 1 Hz."""
    t = np.arange(round(seconds * 1e9 / tick_ns)) * (tick_ns / 1e9)
    axes = np.stack(
        [0.035 * np.sin(6.9 * t), 0.03 * np.sin(8.2 * t + 1), 0.05 * np.sin(2.5 * t)],
        axis=1,
    )
    signs = np.sign(np.round(multirotor.effectiveness(vehicle)[3:], 9))
    return multirotor.hover_control(vehicle) * (1 + 0.12 * np.sin(5.7 * t)[:, None] + axes @ signs)


def slow_motors(vehicle: Vehicle) -> Vehicle:
    """Return a vehicle with a motor lag of 50 ms, for which no step up to 100 ms is shortened."""
    lags = {"time_constant_up_s": 0.05, "time_constant_down_s": 0.05}
    return vehicle.model_copy(update={"rotor_constants": vehicle.rotor_constants.model_copy(update=lags)})


class Flown:
    """A flight of the kernel, with the inputs to repeat it in the reference."""

    def __init__(
        self,
        vehicle: Vehicle,
        commands: Float64,
        *,
        tick_ns: int = TICK_NS,
        start: dict[int, float] | None = None,
        height_m: float = 300.0,
        **options: Any,
    ) -> None:
        scene = load_scene("airfield")
        physics = VehiclePhysics(vehicle, scene, tick_ns, **options, start=FlightStart(p_WB=(0.0, 0.0, height_m)))
        physics.state[13:] = multirotor.speed_radps(vehicle, multirotor.hover_control(vehicle))
        for place, value in (start or {}).items():
            physics.state[place] = value
        physics.advance(0, commands[0].tolist())
        states, winds, scales = [physics.state.copy()], [physics.wind_W_mps], []
        for tick, controls in enumerate(commands.tolist(), start=1):
            truth = physics.advance(tick, controls)
            assert not truth.in_contact
            states.append(physics.state.copy())
            winds.append(physics.wind_W_mps)
            if physics.battery is not None and vehicle.battery is not None:
                scales.append(physics.battery.voltage_v / vehicle.battery.nominal_voltage_v)
        self.vehicle, self.commands, self.tick_ns = vehicle, commands, tick_ns
        self.states, self.wind = np.array(states), np.array(winds)
        self.scale = np.array(scales) if scales else None

    def errors(self, *, effects: dict[str, bool] | None = None, **inputs: Any) -> tuple[float, float, float]:
        """Return the greatest position [m], attitude [rad] and relative rotor speed error."""
        given = Inputs(
            self.commands,
            wind_W=self.wind,
            speed_scale=self.scale,
            effects=ON if effects is None else effects,
            site=load_scene("airfield").site if self.vehicle.rotor_model == "blade_element" else None,
            **inputs,
        )
        exact = fly(self.vehicle, self.states[0], given, tick_s=self.tick_ns / 1e9)
        position = float(np.max(np.linalg.norm(self.states[:, :3] - exact[:, :3], axis=1)))
        attitude = max(attitude_error_rad(a, b) for a, b in zip(self.states[:, 3:7], exact[:, 3:7], strict=True))
        return position, attitude, float(np.max(np.abs(self.states[:, 13:] / exact[:, 13:] - 1.0)))


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n in ("x500", "y6") else pytest.mark.slow) for n in multirotor_names()],
)
@by_model
def test_five_hard_seconds_stay_a_thousandth_of_the_limit(name: str, model: str) -> None:
    """The limit is 1e-6 m and 1e-6 rad."""
    vehicle = shipped(name, model)
    position, attitude, rotors = Flown(vehicle, hard_commands(vehicle, 5.0)).errors()
    assert position < 2e-9
    assert attitude < 2e-9
    assert rotors < 1e-11


@pytest.mark.parametrize("name", ["hexa_x", "y6"])
@by_model
def test_tilted_rotors_with_every_effect(name: str, model: str) -> None:
    """Each part of the general branch: axis in every force, imbalance in the rotor's plane, wake of the upper rotor."""
    vehicle = tilted(shipped(name, model), 25.0)
    constants = vehicle.rotor_constants.model_copy(update={"axial_drag_kg_per_rad": 2e-4, "inertia_kgm2": 1e-3})
    vehicle = vehicle.model_copy(update={"rotor_constants": constants})
    commands = hard_commands(vehicle, 0.8)
    faults = [
        RotorFault(kind="efficiency", rotor=1, at_s=0.1, factor=0.8),
        RotorFault(kind="lost_blade", rotor=2, at_s=0.3, imbalance_gcm=20.0),
    ]
    start = {7: 3.0, 8: -2.0, 9: -4.0, 10: 1.5, 11: -1.0, 12: 2.0}
    flown = Flown(vehicle, commands, start=start, height_m=4.0, disturbances=Disturbances(faults=faults))
    left, whirl = np.ones((200, 6)), np.zeros((200, 6))
    left[25:, 1], left[75:, 2], whirl[75:, 2] = 0.8, 0.5, 20e-5
    position, attitude, _ = flown.errors(thrust_left=left, imbalance_kgm=whirl)
    assert position < 1e-8
    assert attitude < 1e-7
    for missing in ({"descent_loss": True}, {"ground_effect": True}):
        if model == "blade_element" and "ground_effect" in missing:
            continue  # the descent is part of the inflow
        assert flown.errors(thrust_left=left, imbalance_kgm=whirl, effects=missing)[0] > 1e-6


@by_model
def test_a_vanishing_tilt_is_the_upright_flight(model: str) -> None:
    """The general branch and the upright one agree to rounding."""
    vehicle = shipped("hexa_x", model)
    commands = hard_commands(vehicle, 2.0)
    upright, almost = Flown(vehicle, commands), Flown(tilted(vehicle, 1e-13), commands)
    assert np.abs(upright.states - almost.states).max() < 1e-9
    assert tilted(vehicle, 1e-13).rotors[0].axis != (0.0, 0.0, 1.0)


SWITCHES = ("all stop for 0.1 s", "one stops for 0.1 s", "all switch at 2.5 Hz", "random")


def switched_commands(vehicle: Vehicle, case: str) -> Float64:
    """Rotors that stop and start again in a descent: their speed crosses the vortex ring state within a step."""
    t, rotors = np.arange(1250) * 0.004, len(vehicle.rotors)
    commands = np.full((len(t), rotors), multirotor.hover_control(vehicle))
    if case == "all stop for 0.1 s":
        commands[(t >= 1.0) & (t < 1.1)] = 0.0
    elif case == "one stops for 0.1 s":
        commands[(t >= 1.0) & (t < 1.1), 0] = 0.0
    elif case == "all switch at 2.5 Hz":
        commands[:] = (np.floor(5.0 * t) % 2)[:, None] * 2.0 * multirotor.hover_control(vehicle)
    else:
        random = np.random.default_rng(3).integers(0, 2, (50, rotors))
        commands = np.repeat(random, 25, axis=0) * (2.0 * multirotor.hover_control(vehicle))
    return np.clip(commands, 0.0, 1.0)


SWITCHED = list(itertools.product(("x500", "iris", "x8", "tilted hexa"), SWITCHES))


@pytest.mark.parametrize(
    ("name", "case"),
    # `make test` runs each vehicle with one case.
    [pytest.param(*both, marks=[] if i % 5 == 0 else pytest.mark.slow) for i, both in enumerate(SWITCHED)],
)
@by_model
def test_rotors_that_stop_and_start_in_a_descent(name: str, case: str, model: str) -> None:
    vehicle = tilted(shipped("hexa_x", model), 20.0) if name == "tilted hexa" else shipped(name, model)
    position, attitude, _ = Flown(vehicle, switched_commands(vehicle, case)).errors()
    # Tumbling magnifies what is left of the vortex ring state: to 4e-7 m in the worst of the flights by blade elements.
    limit = 2e-8 if model == "quadratic" else 1e-6
    assert position < limit
    assert attitude < limit


@by_model
def test_classical_method_is_of_order_four(model: str) -> None:
    vehicle = shipped("x500", model)
    commands = hard_commands(vehicle, 2.0, 8_000_000)
    errors = []
    for step_ms in (8, 4, 2, 1):
        flown = Flown(vehicle, commands, tick_ns=8_000_000, integration=Integration("classical", step_ms * 1_000_000))
        errors.append(flown.errors()[0])
    slope = np.polyfit(np.log([8, 4, 2, 1]), np.log(errors), 1)[0]
    assert slope == pytest.approx(4.0, abs=0.2), errors


@by_model
def test_default_method_is_of_order_eight(model: str) -> None:
    """Measured far above its usual step of 4 ms, where its error is below that of the reference."""
    vehicle = slow_motors(shipped("x500", model))
    commands = hard_commands(vehicle, 0.128, 64_000_000)
    errors = []
    for step_ms in (64, 32):
        errors.append(
            Flown(vehicle, commands, tick_ns=64_000_000, integration=Integration(step_ns=step_ms * 1_000_000)).errors()[
                0
            ]
        )
    coarse, fine = errors
    assert math.log2(coarse / fine) > 7.0, errors
    assert fine < 1e-6


@by_model
def test_ground_effect_near_the_ground(model: str) -> None:
    vehicle = shipped("x500", model)
    thin = load_scene("airfield").site.density_ratio if model == "blade_element" else 1.0
    hover = multirotor.hover_control(vehicle, thin)
    commands = np.tile(hover * np.array([0.992, 0.990, 0.991, 0.991]), (100, 1))
    # The feet are 0.23 m below.
    flown = Flown(vehicle, commands, height_m=0.3)
    assert flown.states[:, 2].max() < 0.31
    position, attitude, _ = flown.errors()
    assert position < 1e-10
    assert attitude < 1e-10
    without, _, _ = flown.errors(effects={"descent_loss": True})
    assert without > 1e-3  # the effect is active


def test_descent_through_the_vortex_ring_state() -> None:
    vehicle = shipped("x500", "quadratic")
    commands = np.full((250, 4), 0.8 * multirotor.hover_control(vehicle))
    flown = Flown(vehicle, commands, start={9: -5.0, 7: 1.0})
    position, _, _ = flown.errors()
    assert position < 1e-9
    without, _, _ = flown.errors(effects={"ground_effect": True})
    assert without > 0.3


@by_model
def test_wind_that_changes_within_the_tick(model: str) -> None:
    vehicle = shipped("iris", model)
    wind = Wind(
        steady_W_mps=(3.0, -2.0, 0.3),
        turbulence=Turbulence(level="moderate"),
        gusts=(GustEvent(at_s=0.3, velocity_W_mps=(6.0, 4.0, -1.0), rise_s=0.5, hold_s=0.2, fall_s=0.3),),
    )
    flown = Flown(vehicle, hard_commands(vehicle, 2.0), disturbances=Disturbances(wind, seed=4))
    assert np.ptp(flown.wind, axis=0).min() > 0.5
    position, attitude, _ = flown.errors()
    assert position < 1e-9
    assert attitude < 1e-9


@by_model
def test_sagging_battery(model: str) -> None:
    vehicle = shipped("x500", model)
    flown = Flown(vehicle, hard_commands(vehicle, 2.0), effects=Effects(battery=True))
    assert flown.scale is not None
    assert np.ptp(flown.scale) > 0.02
    position, _, rotors = flown.errors()
    assert position < 1e-9
    assert rotors < 1e-11


@by_model
def test_rotor_faults(model: str) -> None:
    vehicle = shipped("x500", model)
    commands = hard_commands(vehicle, 0.6)
    faults = [
        RotorFault(kind="efficiency", rotor=1, at_s=0.1, factor=0.8),
        RotorFault(kind="lost_blade", rotor=2, at_s=0.3, imbalance_gcm=20.0),
    ]
    flown = Flown(vehicle, commands, disturbances=Disturbances(faults=faults))
    left, whirl = np.ones((150, 4)), np.zeros((150, 4))
    left[25:, 1], left[75:, 2], whirl[75:, 2] = 0.8, 0.5, 20e-5
    position, attitude, _ = flown.errors(thrust_left=left, imbalance_kgm=whirl)
    assert position < 1e-8
    assert attitude < 1e-7
    still, _, _ = flown.errors(thrust_left=left)
    assert still > 1e-5  # the whirl is active


def test_every_part_of_the_equations_matters() -> None:
    """A vehicle with linear, quadratic, axial and rotor drag, spin-up unlike spin-down, thrust part linear."""
    vehicle = shipped("x500", "quadratic")
    constants = vehicle.rotor_constants.model_copy(
        update={"axial_drag_kg_per_rad": 2e-4, "thrust_model_factor": 0.4, "inertia_kgm2": 1e-4}
    )
    vehicle = vehicle.model_copy(update={"rotor_constants": constants, "body_drag_linear_n_per_mps": (0.1, 0.12, 0.15)})
    flown = Flown(vehicle, hard_commands(vehicle, 1.0), start={7: 9.0, 8: 4.0, 9: -3.0, 10: 2.5, 11: -1.5, 12: 1.0})
    position, attitude, _ = flown.errors()
    assert position < 1e-10
    assert attitude < 1e-10


@pytest.mark.parametrize(
    ("spin", "seconds"), [(20.0, 600.0), (60.0, 200.0), pytest.param(20.0, 3600.0, marks=pytest.mark.slow)]
)
def test_long_tumbling_keeps_energy_and_momentum(spin: float, seconds: float) -> None:
    from hil.apps.bench_suite.physics.flight_cases import ThisProject, spin_drift, tumble

    flight = tumble(seconds, spin)
    drift = spin_drift(flight, ThisProject(4.0).fly(flight, record=False)[-1])
    assert drift["norm"] < 1e-14
    assert drift["energy"] < 1e-11
    assert drift["momentum"] < 1e-11


@by_model
def test_stiff_vehicles_stay_exact(model: str) -> None:
    """2 g in a gale and a motor lag of 1 ms: the step rule shortens the steps by itself."""
    vehicle = shipped("x500", model).model_copy(update={"mass_kg": 0.002})
    for wind in itertools.product((0.0, 25.0), (0.0, -25.0)):
        flown = Flown(
            vehicle,
            np.zeros((100, 4)),
            start={13: 300.0, 14: 300.0, 15: 300.0, 16: 300.0},
            disturbances=Disturbances(Wind(steady_W_mps=(*wind, 0.0))),
        )
        assert flown.errors()[0] < 1e-6
