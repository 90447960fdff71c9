"""Rotors that are tilted or coaxial: closed forms of their wrench, and errors of vehicle files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signals.errors import ConfigError
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.forces.rotors import Rotor
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import VEHICLE_DIR, Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Scene
from tests.worlds.rotor_models import quadratic

TICK_NS = 100_000  # short: accelerations are those of the start
G = 9.80665


def with_axes(name: str, axes: dict[int, tuple[float, float, float]]) -> Vehicle:
    vehicle = quadratic(name)
    rotors = [
        Rotor.model_validate(rotor.model_dump() | {"axis": axes.get(i, (0.0, 0.0, 1.0))})
        for i, rotor in enumerate(vehicle.rotors)
    ]
    return vehicle.model_copy(update={"rotors": tuple(rotors)})


def wrench(vehicle: Vehicle, scene: Scene, speeds: list[float], **state: tuple[float, ...]) -> np.ndarray:
    """Force and torque on the level vehicle high above the ground, with rotors that keep these speeds."""
    physics = VehiclePhysics(vehicle, scene, TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, 500.0)))
    physics.state[7:10], physics.state[10:13] = state.get("v", (0.0,) * 3), state.get("w", (0.0,) * 3)
    physics.state[13:] = speeds
    c = vehicle.rotor_constants
    controls = [(speed / c.max_speed_radps) ** (1 if c.thrust_model_factor == 1.0 else 2) for speed in speeds]
    physics.advance(0, controls)
    truth = physics.advance(1, controls)
    force = vehicle.mass_kg * np.add(truth.a_WB_W, (0.0, 0.0, G))
    return np.concatenate([force, np.array(vehicle.inertia_kgm2) * truth.alpha_WB_B])


def test_wrench_of_a_tilted_rotor(airfield: Scene) -> None:
    """T along the axis at the hub, and its torque m T against the spin about the same axis."""
    angle = math.radians(30.0)
    axis = (math.sin(angle), 0.0, math.cos(angle))
    vehicle = with_axes("hexa_x", {0: axis})
    c = vehicle.rotor_constants
    given = wrench(vehicle, airfield, [500.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    thrust_n = c.thrust_coefficient_n_per_radps2 * 500.0**2
    force = thrust_n * np.array(axis)
    torque = np.cross(vehicle.rotors[0].position_m, force) + c.moment_ratio_m * force  # clockwise: turns the body left
    assert given == pytest.approx([*force, *torque], abs=2e-4)


def test_gyroscopic_torque_follows_the_axis(airfield: Scene) -> None:
    """-w x J O n, besides the rigid body's own -w x I w."""
    axis, spin_radps = (0.0, 0.6, 0.8), (3.0, -2.0, 1.0)
    vehicle = with_axes("hexa_x", {1: axis})
    vehicle = vehicle.model_copy(
        update={
            "rotor_constants": vehicle.rotor_constants.model_copy(
                update={"inertia_kgm2": 1e-3, "drag_kg_per_rad": 0.0, "thrust_coefficient_n_per_radps2": 1e-30}
            ),
            "body_drag_quadratic_n_per_m2ps2": (0.0, 0.0, 0.0),
        }
    )
    given = wrench(vehicle, airfield, [0.0, 800.0, 0.0, 0.0, 0.0, 0.0], w=spin_radps)[3:]
    body = np.cross(spin_radps, np.array(vehicle.inertia_kgm2) * spin_radps)
    assert given == pytest.approx(-body - np.cross(spin_radps, 1e-3 * 800.0 * np.array(axis)), abs=5e-3)


def test_rotor_drag_lies_in_the_rotors_plane(airfield: Scene) -> None:
    axis, v = np.array([0.0, -0.6, 0.8]), np.array([2.0, 1.0, 0.5])
    vehicle = with_axes("hexa_x", dict.fromkeys(range(6), tuple(axis)))
    vehicle = vehicle.model_copy(
        update={
            "rotor_constants": vehicle.rotor_constants.model_copy(
                update={"descent_loss": 0.0, "thrust_coefficient_n_per_radps2": 1e-30}
            ),
            "body_drag_quadratic_n_per_m2ps2": (0.0, 0.0, 0.0),
        }
    )
    force = wrench(vehicle, airfield, [500.0] * 6, v=tuple(v))[:3]
    across = v - (v @ axis) * axis
    assert force == pytest.approx(-6 * vehicle.rotor_constants.drag_kg_per_rad * 500.0 * across, abs=1e-4)


def test_coaxial_ratio_is_that_of_momentum_theory() -> None:
    """Equal torques: P_l = P_u, lower rotor half in the wake 2 v_u: t (1 + t)^2 = 2 (Leishman and Syal 2008)."""
    for name in ("x8", "y6"):
        t = load_vehicle(name).rotor_constants.coaxial_thrust_ratio
        assert t * (1.0 + t) ** 2 == pytest.approx(2.0, abs=1e-3)
        assert 2.0 / (1.0 + t**1.5) == pytest.approx(1.266, abs=1e-3)  # kappa_int


@pytest.mark.parametrize("name", ["x8", "y6"])
def test_a_coaxial_pair_hovers_with_its_loss(name: str, airfield: Scene) -> None:
    """At one speed a pair has (1 + t) T; the lower rotor alone, and the upper one, have T."""
    vehicle = quadratic(name)
    c = vehicle.rotor_constants
    t, one_n = c.coaxial_thrust_ratio, c.thrust_coefficient_n_per_radps2 * 400.0**2
    lower = next(i for i, rotor in enumerate(vehicle.rotors) if rotor.coaxial_below is not None)
    upper = vehicle.rotors[lower].coaxial_below
    speeds = {"both": {lower, upper}, "lower": {lower}, "upper": {upper}}
    lift = {
        running: wrench(vehicle, airfield, [400.0 * (i in who) for i in range(len(vehicle.rotors))])[2]
        for running, who in speeds.items()
    }
    assert lift["both"] == pytest.approx((1.0 + t) * one_n, rel=1e-6)
    assert (lift["lower"], lift["upper"]) == pytest.approx((one_n, one_n), rel=1e-6)
    pairs = len(vehicle.rotors) / 2
    share = vehicle.mass_kg * G / (pairs * (1.0 + t) * c.thrust_coefficient_n_per_radps2 * c.max_speed_radps**2)
    assert multirotor.hover_control(vehicle) == pytest.approx(math.sqrt(share), rel=1e-12)
    balanced = wrench(vehicle, airfield, [400.0] * len(vehicle.rotors))
    assert balanced == pytest.approx([0.0, 0.0, pairs * (1.0 + t) * one_n, 0.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("name", multirotor_names())
def test_effectiveness_is_the_slope_of_the_wrench(name: str, airfield: Scene) -> None:
    """Change of force and torque with k O^2 of each rotor, about hover, by differences of the flown physics."""
    vehicle = quadratic(name)
    k, hover = (
        vehicle.rotor_constants.thrust_coefficient_n_per_radps2,
        multirotor.speed_radps(vehicle, multirotor.hover_control(vehicle)),
    )
    for i in range(len(vehicle.rotors)):
        low, high = ([hover + d * (j == i) for j in range(len(vehicle.rotors))] for d in (-0.5, 0.5))
        change = wrench(vehicle, airfield, high) - wrench(vehicle, airfield, low)
        assert change / (k * 2.0 * hover) == pytest.approx(multirotor.effectiveness(vehicle)[:, i], abs=1e-4)


def test_a_symmetric_hexa_has_no_torque_at_equal_speeds(airfield: Scene) -> None:
    assert wrench(load_vehicle("hexa_x"), airfield, [600.0] * 6)[3:] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_an_axis_is_normalised_and_an_upright_one_stays_exact() -> None:
    place: dict[str, Any] = {"position_m": (0.1, 0.1, 0.0), "spin": "cw"}
    assert Rotor.model_validate(place | {"axis": (0.0, 0.0, 2.0)}) == Rotor.model_validate(place)
    assert Rotor.model_validate(place | {"axis": (0.0, 3.0, 4.0)}).axis == pytest.approx((0.0, 0.6, 0.8), abs=1e-15)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("hexa_x", "0.1076], spin: ccw}", "0.1076], spin: ccw, axis: [0, 0, 0]}", "has no direction"),
        ("hexa_x", "0.1076], spin: ccw}", "0.1076], spin: ccw, axis: [0, 0, -1]}", "does not point up or ahead"),
        ("hexa_x", "0.1076], spin: ccw}", "0.1076], spin: ccw, axis: [1, 0, 0]}", "does not point up"),
        ("x8", "coaxial_below: 1", "coaxial_below: 7", "must name another rotor"),
        ("x8", "coaxial_below: 1", "coaxial_below: 4", "must name another rotor"),
        ("x8", "coaxial_below: 1", "coaxial_below: 0", "must name another rotor"),
        ("y6", "-0.045], spin: ccw, coaxial_below: 2", "0.145], spin: ccw, coaxial_below: 2", "not below rotor 2"),
        ("y6", "[-0.28, 0, -0.045]", "[-0.25, 0, -0.045]", "not below rotor 2"),
    ],
)
def test_wrong_rotors_are_named(name: str, old: str, new: str, message: str, tmp_path: Path) -> None:
    text = (VEHICLE_DIR / f"{name}.yaml").read_text()
    assert old in text
    file = tmp_path / "vehicle.yaml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=message) as caught:
        load_vehicle(file)
    assert "vehicle.yaml:" in str(caught.value)
