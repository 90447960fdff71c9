"""Launches against closed forms: hold, exit speed of catapult, hand and bungee, rail, triggers, repeatability."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from sim.physics.flight_start import FlightStart
from sim.physics.launch import Launch
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

SCENE = load_scene("airfield")
G = SCENE.gravity_mps2
TICK_NS = 4_000_000
DT = TICK_NS * 1e-9
MASS = 2.5
LAUNCH: TypeAdapter[Any] = TypeAdapter(Launch)
SPHERES = [
    {"name": f"hull_{i}", "position_m": (x, y, 0.0), "radius_m": 0.05}
    for i, (x, y) in enumerate(((0.3, 0.0), (-0.2, 0.1), (-0.2, -0.1)))
]


def dart(**changes: Any) -> Vehicle:
    """A body without air forces, so that the rail alone is tested."""
    content: dict[str, Any] = {
        "name": "dart",
        "description": "dart",
        "mass_kg": MASS,
        "inertia_kgm2": (0.05, 0.1, 0.12),
        "body_drag_linear_n_per_mps": (0.0, 0.0, 0.0),
        "body_drag_quadratic_n_per_m2ps2": (0.0, 0.0, 0.0),
        "feet": SPHERES,
    }
    return Vehicle.model_validate(content | changes)


def launched(entry: dict[str, Any], *, yaw_rad: float = 0.0, model: Vehicle | None = None) -> VehiclePhysics:
    launch = LAUNCH.validate_python(entry)
    start = FlightStart(ground_W=(3.0, -2.0, 0.5), yaw_rad=yaw_rad, launch=launch)
    return VehiclePhysics(model or dart(), SCENE, TICK_NS, start=start)


def fly(physics: VehiclePhysics, ticks: int, controls: tuple[float, ...] = ()) -> list[Any]:
    return [physics.advance(tick, controls) for tick in range(ticks)]


def released_mps(physics: VehiclePhysics) -> float:
    text = next(event.text for event in physics.take_events() if "released" in event.text)
    return float(text.split(" at ")[1].split()[0])


CATAPULT = {"kind": "catapult", "length_m": 3.0, "speed_mps": 15.0, "elevation_deg": 12.0, "at_s": 0.4, "delay_s": 0.0}


def test_it_is_held_where_the_rail_begins_until_its_time() -> None:
    physics = launched(CATAPULT, yaw_rad=1.1)
    truths = fly(physics, 101)
    first, last = truths[0], truths[-1]
    assert first.p_WB == (3.0, -2.0, 1.7)
    assert last.p_WB == first.p_WB
    assert last.v_WB_W == (0.0, 0.0, 0.0)
    assert last.in_contact
    w, x, y, z = last.q_WB
    ahead = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    c = math.cos(math.radians(12.0))
    assert ahead == pytest.approx((c * math.cos(1.1), c * math.sin(1.1), math.sin(math.radians(12.0))), abs=1e-12)
    assert np.linalg.norm(np.subtract(physics.advance(101, ()).p_WB, first.p_WB)) > 1e-5


@pytest.mark.parametrize("kind", ["catapult", "hand"])
@pytest.mark.parametrize("elevation_deg", [0.0, 30.0])
def test_constant_force_over_a_length_gives_its_speed_less_the_work_of_the_weight(
    kind: str, elevation_deg: float
) -> None:
    physics = launched(CATAPULT | {"kind": kind, "elevation_deg": elevation_deg, "length_m": 2.0, "speed_mps": 12.0})
    truths = fly(physics, 300)
    lift = 2.0 * math.sin(math.radians(elevation_deg))
    expected = math.sqrt(12.0**2 - 2.0 * G * lift)
    assert released_mps(physics) == pytest.approx(expected, rel=2e-3)
    acceleration = 12.0**2 / 4.0 - G * math.sin(math.radians(elevation_deg))
    for k in (10, 30):  # s = a t^2 / 2, from the tick of the release on
        way = np.linalg.norm(np.subtract(truths[100 + k].p_WB, truths[0].p_WB))
        assert way == pytest.approx(0.5 * acceleration * (k * DT) ** 2, rel=1e-6)
    last = truths[-1]
    assert not last.in_contact or last.p_WB[2] < 0.6


def test_a_bungee_gives_its_energy() -> None:
    physics = launched(
        {"kind": "bungee", "stiffness_npm": 40.0, "stretch_m": 4.0, "elevation_deg": 10.0, "at_s": 0.0, "delay_s": 0.0}
    )
    fly(physics, 400)
    energy = 0.5 * 40.0 * 16.0 - MASS * G * 4.0 * math.sin(math.radians(10.0))
    assert released_mps(physics) == pytest.approx(math.sqrt(2.0 * energy / MASS), rel=2e-3)


def test_after_the_release_it_flies_a_parabola() -> None:
    physics = launched(CATAPULT | {"elevation_deg": 40.0})
    truths = fly(physics, 300)
    k = next(i for i, truth in enumerate(truths) if i > 100 and not truth.in_contact)
    a, b = truths[k], truths[k + 50]
    t = 50 * DT
    expected = np.array(a.p_WB) + np.array(a.v_WB_W) * t - np.array([0.0, 0.0, 0.5 * G * t * t])
    assert np.array(b.p_WB) == pytest.approx(expected, abs=1e-9)
    assert b.q_WB == pytest.approx(a.q_WB, abs=1e-12)


def test_throttle_releases_it_after_the_delay() -> None:
    model = load_vehicle("x500")
    physics = launched(CATAPULT | {"at_s": None, "throttle": 0.4, "delay_s": 0.2}, model=model)
    for tick in range(50):
        truth = physics.advance(tick, (0.3,) * 4)
    held = truth.p_WB
    for tick in range(50, 101):
        truth = physics.advance(tick, (0.5,) * 4)
    assert truth.p_WB == held
    assert truth.rotor_speed_radps[0] > 100.0  # rotors turn while it is held
    moved = physics.advance(101, (0.5,) * 4)
    assert moved.p_WB != held


def test_a_pull_weaker_than_the_weight_leaves_it_at_the_stop() -> None:
    physics = launched({"kind": "bungee", "stiffness_npm": 1.0, "stretch_m": 1.0, "elevation_deg": 60.0, "at_s": 0.0})
    truths = fly(physics, 400)
    assert truths[-1].p_WB == truths[0].p_WB
    assert physics.launching


def test_a_restart_repeats_the_launch_to_the_bit() -> None:
    physics = launched(CATAPULT)
    first = fly(physics, 250)[1:]
    physics.restart(1)
    again = [physics.advance(tick, ()) for tick in range(1, 250)]
    assert [truth[2:] for truth in first] == [truth[2:] for truth in again]


def test_a_vehicle_that_is_placed_is_free() -> None:
    physics = launched(CATAPULT)
    physics.advance(0, ())
    physics.place((0.0, 0.0, 30.0))
    truth = physics.advance(1, ())
    assert truth.v_WB_W[2] == pytest.approx(-G * DT)
