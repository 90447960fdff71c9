"""A vehicle whose rotors are tilted about their arms, to either side in turn."""

from __future__ import annotations

import math

from sim.physics.vehicle import Vehicle


def tilted(vehicle: Vehicle, angle_deg: float) -> Vehicle:
    """Return the vehicle with rotors tilted by `angle_deg` by spin; the rotors of a coaxial pair lie on one axis."""
    rotors = list(vehicle.rotors)
    for i, rotor in enumerate(vehicle.rotors):
        upper = i if rotor.coaxial_below is None else rotor.coaxial_below
        x, y, z = vehicle.rotors[upper].position_m
        reach, side = math.hypot(x, y), vehicle.rotors[upper].spin.sign * math.sin(math.radians(angle_deg))
        axis = (-side * y / reach, side * x / reach, math.cos(math.radians(angle_deg)))
        down = z - rotor.position_m[2]
        place = tuple(p - down * n for p, n in zip((x, y, z), axis, strict=True))
        rotors[i] = rotor.model_copy(update={"axis": axis, "position_m": place})
    return vehicle.model_copy(update={"rotors": tuple(rotors)})
