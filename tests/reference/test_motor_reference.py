"""Rotors with motors, and rotors by wind-tunnel coefficients, against the CasADi model solved by CVODES."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.physics import multirotor
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault
from sim.physics.forces.force import Effects
from sim.physics.integration import Integration
from sim.physics.vehicle import Vehicle, load_vehicle
from tests.reference.test_physics_reference import Flown, hard_commands
from tests.worlds.motors import with_motors, with_tunnel
from tests.worlds.tilted_rotors import tilted

Float64 = NDArray[np.float64]
MODELS = ("blade_element", "quadratic", "wind_tunnel")
slow = pytest.mark.slow


def random_commands(vehicle: Vehicle, seconds: float, seed: int, *, hold: int = 25, most: float = 2.0) -> Float64:
    """Return commands that jump every `hold` ticks, a third of them to 0: rotors stop and start."""
    rng = np.random.default_rng(seed)
    holds, rotors = -(-round(seconds * 250) // hold), len(vehicle.rotors)
    values = rng.uniform(0.0, most, (holds, rotors)) * (rng.uniform(size=(holds, rotors)) > 1 / 3)
    each = np.repeat(values * multirotor.hover_control(vehicle), hold, axis=0)
    return np.clip(each, 0.0, 1.0)[: round(seconds * 250)]


@pytest.mark.parametrize("braking", [True, False])
@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("x500", "blade_element"),
        ("x500", "quadratic"),
        ("x500", "wind_tunnel"),
        pytest.param("x8", "blade_element", marks=slow),
        pytest.param("y6", "wind_tunnel", marks=slow),
        pytest.param("racer", "blade_element", marks=slow),
        pytest.param("iris", "quadratic", marks=slow),
    ],
)
def test_hard_seconds_with_motors(name: str, model: str, *, braking: bool) -> None:
    vehicle = with_motors(name, model=model, active_braking=braking)
    position, attitude, rotors = Flown(vehicle, hard_commands(vehicle, 3.0)).errors()
    assert position < 2e-9
    assert attitude < 2e-9
    assert rotors < 1e-9


@pytest.mark.parametrize("braking", [True, False])
@pytest.mark.parametrize(
    ("name", "model", "seed"),
    [
        ("x500", "blade_element", 1),
        ("x500", "wind_tunnel", 2),
        ("x500", "quadratic", 3),
        pytest.param("x8", "blade_element", 4, marks=slow),
        pytest.param("iris", "blade_element", 5, marks=slow),
        pytest.param("racer", "wind_tunnel", 6, marks=slow),
        pytest.param("tilted hexa", "blade_element", 7, marks=slow),
    ],
)
def test_random_commands_stop_and_start_motors(name: str, model: str, seed: int, *, braking: bool) -> None:
    """The limit is 1e-6 m over 10 s: rotors stop, turn as windmills in the fall, and start again."""
    vehicle = tilted(load_vehicle("hexa_x"), 20.0) if name == "tilted hexa" else load_vehicle(name)
    vehicle = with_motors(vehicle, model=model, active_braking=braking)
    seconds = 10.0 if name == "x500" else 5.0
    position, attitude, _ = Flown(vehicle, random_commands(vehicle, seconds, seed), height_m=3000.0).errors()
    assert position < 1e-6
    assert attitude < 1e-6


@pytest.mark.parametrize("model", MODELS)
def test_rotors_from_rest_to_full_duty(model: str) -> None:
    """The reference divides by the speed, so that it starts at a thousandth of a rad/s."""
    vehicle = with_motors("x500", model=model)
    start = dict.fromkeys(range(13, 17), 1e-3)
    commands = np.ones((100, 4))
    position, attitude, _ = Flown(vehicle, commands, start=start).errors()
    assert position < 1e-8
    assert attitude < 1e-8


def test_sagging_battery_with_motors() -> None:
    vehicle = with_motors("x500")
    flown = Flown(vehicle, hard_commands(vehicle, 2.0), effects=Effects(battery=True))
    assert flown.scale is not None
    assert np.ptp(flown.scale) > 0.01
    position, _, rotors = flown.errors()
    assert position < 1e-9
    assert rotors < 1e-9


def test_faults_of_rotors_with_motors() -> None:
    """A blade lost on one rotor, its phase integrated, and another rotor that its controller loses for 0.2 s."""
    vehicle = with_motors("x500")
    faults = [
        RotorFault(kind="lost_blade", rotor=2, at_s=0.1, imbalance_gcm=20.0),
        RotorFault(kind="desync", rotor=1, at_s=0.2, for_s=0.2),
    ]
    flown = Flown(vehicle, hard_commands(vehicle, 0.6), disturbances=Disturbances(faults=faults))
    left, whirl, driven = np.ones((150, 4)), np.zeros((150, 4)), np.ones((150, 4), dtype=bool)
    left[25:, 2], whirl[25:, 2], driven[50:100, 1] = 0.5, 20e-5, False
    position, attitude, _ = flown.errors(thrust_left=left, imbalance_kgm=whirl, driven=driven)
    assert position < 1e-8
    assert attitude < 1e-7
    assert flown.errors(thrust_left=left, imbalance_kgm=whirl)[0] > 1e-3  # the fault is active
    assert flown.errors(thrust_left=left, driven=driven)[0] > 1e-5


def test_motors_in_every_other_effect() -> None:
    vehicle = with_motors(tilted(load_vehicle("y6"), 25.0))
    start = {7: 3.0, 8: -2.0, 9: -4.0, 10: 1.5, 11: -1.0, 12: 2.0}
    position, attitude, _ = Flown(vehicle, hard_commands(vehicle, 1.0), start=start, height_m=6.0).errors()
    assert position < 1e-8
    assert attitude < 1e-7


@pytest.mark.parametrize("name", ["x500", pytest.param("y6", marks=slow), pytest.param("racer", marks=slow)])
def test_wind_tunnel_rotors(name: str) -> None:
    vehicle = with_tunnel(name)
    position, attitude, rotors = Flown(vehicle, hard_commands(vehicle, 5.0)).errors()
    assert position < 2e-9
    assert attitude < 2e-9
    assert rotors < 1e-11
    commands = random_commands(vehicle, 5.0, 11)
    position, attitude, _ = Flown(vehicle, commands, height_m=3000.0).errors()
    assert position < 1e-6
    assert attitude < 1e-6
    near = Flown(vehicle, hard_commands(vehicle, 0.2), height_m=0.5)
    assert near.errors()[0] < 1e-9
    assert near.errors(effects={})[0] > 1e-5  # the ground effect is active


def test_order_of_the_methods_with_motors() -> None:
    vehicle = with_motors("x500")
    commands = hard_commands(vehicle, 1.0, 8_000_000)

    def error(method: Any, step_ms: int) -> float:
        integration = Integration(method, step_ns=step_ms * 1_000_000)
        return Flown(vehicle, commands, tick_ns=8_000_000, integration=integration).errors()[0]

    errors = [error("classical", step_ms) for step_ms in (8, 4, 2)]
    assert np.polyfit(np.log([8, 4, 2]), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.3), errors
    assert error("order8", 8) < 1e-9
