"""Facts of a standard VTOL: lifters, on which it hovers, engines that pull ahead, and wings that carry it in flight."""

from __future__ import annotations

from sim.physics import fixed_wing, multirotor
from sim.physics.fixed_wing import LEAST_AHEAD
from sim.physics.vehicle import Vehicle


def lifters(vehicle: Vehicle) -> list[int]:
    """Return the indices of the rotors that lift."""
    return [i for i, rotor in enumerate(vehicle.rotors) if rotor.axis[2] >= LEAST_AHEAD]


def is_vtol(vehicle: Vehicle) -> bool:
    """Return True for a vehicle with wings, rotors that lift, and others that pull ahead."""
    return vehicle.has_wings and bool(lifters(vehicle)) and bool(pushers(vehicle))


def pushers(vehicle: Vehicle) -> list[int]:
    """Return the indices of the rotors that pull ahead and do not lift."""
    return [i for i in fixed_wing.engines(vehicle) if vehicle.rotors[i].axis[2] < LEAST_AHEAD]


def hovering(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with its lifters alone, as a multirotor's controller sees it in hover."""
    return multirotor.lifting_part(vehicle)


def unfit(vehicle: Vehicle) -> tuple[str, str] | None:
    """Return the key of the vehicle's file and the reason why a VTOL's controller cannot fly it; None if it can."""
    return fixed_wing.unfit(vehicle) or multirotor.unfit(hovering(vehicle))
