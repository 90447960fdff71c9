"""An oblique collision of two spinning vehicles converges to an independent model as the contact step shrinks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.apps.bench_suite.physics.flight_cases import torque_free
from sim.physics import contact_model
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import ContactSphere, Vehicle, load_vehicle
from sim.physics.vehicle_group import VehicleGroup
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.reference.contact_reference import Body, Float64, collide

SECONDS, TIME_CONSTANT_S = 0.1, 4e-3
NOSE_M, NOSE_RADIUS_M = (0.2, 0.05, 0.03), 0.08
SPACE = load_scene("airfield").model_copy(update={"gravity_mps2": 0.0, "ground_friction": 1e-9})


def nosed(mass_kg: float) -> Vehicle:
    """Return a vehicle that can touch only with its nose: its feet and rotors are inside."""
    vehicle = torque_free(load_vehicle("x500"))
    inside = tuple(ContactSphere(name=f"foot_{i}", position_m=NOSE_M, radius_m=0.002) for i in range(3))
    return vehicle.model_copy(
        update={
            "mass_kg": mass_kg,
            "feet": inside,
            "hull": (ContactSphere(name="nose", position_m=NOSE_M, radius_m=NOSE_RADIUS_M),),
            "rotors": tuple(rotor.model_copy(update={"position_m": NOSE_M}) for rotor in vehicle.rotors),
            "rotor_constants": vehicle.rotor_constants.model_copy(update={"radius_m": 0.002}),
        }
    )


def state_of(
    p_W: tuple[float, float, float], yaw_rad: float, v_W: tuple[float, ...], w_B: tuple[float, ...]
) -> Float64:
    return np.array([*p_W, math.cos(0.5 * yaw_rad), 0.0, 0.0, math.sin(0.5 * yaw_rad), *v_W, *w_B])


VEHICLES = (nosed(2.0), nosed(1.2))
STARTS = (
    state_of((0.0, 0.0, 300.0), 0.0, (1.0, 0.1, 0.0), (0.3, -0.2, 0.4)),
    state_of((0.60, 0.03, 300.02), math.pi, (-0.9, 0.0, 0.1), (-0.2, 0.3, 0.2)),
)


def flown(step_ns: int, monkeypatch: pytest.MonkeyPatch) -> Float64:
    """Return both states after SECONDS, with one contact step in a tick of `step_ns`."""
    monkeypatch.setattr(contact_model, "_CONTACT_STEPS", TIME_CONSTANT_S / (step_ns / 1e9))
    group = {}
    for name, vehicle, start in zip("ab", VEHICLES, STARTS, strict=True):
        group[name] = VehiclePhysics(vehicle, SPACE, step_ns, start=FlightStart(p_WB=tuple(start[:3].tolist())))
        group[name].state[:13] = start
    together = VehicleGroup(group)
    for tick in range(round(SECONDS * 1e9 / step_ns) + 1):
        together.advance(tick, [(0.0,) * 4] * 2)
    assert not any(physics.hard for physics in group.values())
    assert len(together.take_contacts(last=True)) == 1
    return np.array([physics.state[:13] for physics in group.values()])


@pytest.mark.parametrize(
    "steps_ns",
    [(1_000_000, 250_000), pytest.param((1_000_000, 500_000, 250_000, 125_000, 62_500), marks=pytest.mark.slow)],
    ids=["two steps", "five steps"],
)
def test_a_collision_converges_to_the_reference(steps_ns: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """The order is 1, with a scatter by the phase of the step in which they meet; rates change by up to 2 rad/s."""
    a, b = (
        Body(vehicle.mass_kg, np.array(vehicle.inertia_kgm2), np.array(NOSE_M), NOSE_RADIUS_M, start)
        for vehicle, start in zip(VEHICLES, STARTS, strict=True)
    )
    exact = collide((a, b), time_constant_s=TIME_CONSTANT_S, seconds=SECONDS, step_s=2e-5)
    if len(steps_ns) > 2:
        coarser, exact = exact, collide((a, b), time_constant_s=TIME_CONSTANT_S, seconds=SECONDS, step_s=1e-5)
        assert np.abs(coarser - exact).max() < 5e-4
    assert np.abs(exact[:, 10:] - np.array(STARTS)[:, 10:]).max() > 1.0
    for step_ns in steps_ns:
        assert np.abs(flown(step_ns, monkeypatch) - exact).max() <= 0.05 * step_ns / 1e6
