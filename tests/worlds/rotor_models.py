"""Shipped vehicles with the simple model of their rotors, whose closed forms many tests state."""

from __future__ import annotations

from sim.physics.vehicle import Vehicle, load_vehicle


def quadratic(name: str) -> Vehicle:
    """Return a shipped vehicle with `rotor_model: quadratic`: thrust k O^2, air as dense as at sea level."""
    vehicle = load_vehicle(name)
    constants = vehicle.rotor_constants.model_copy(update={"blade_element": None})
    return vehicle.model_copy(update={"rotor_model": "quadratic", "rotor_constants": constants})
