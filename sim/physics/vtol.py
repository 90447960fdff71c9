"""Facts of a VTOL: rotors on which it hovers, rotors that pull ahead in flight, and wings that carry it there.

A standard VTOL has lifters and pushers. A tiltrotor's tilts turn rotors from the one to the other. A tailsitter hovers
with its nose up (`stands: on_tail`), on the rotors that pull ahead in flight. A tilt is at its angle 0 in hover, and in
flight where its rotors point most ahead.
"""

from __future__ import annotations

from signals.samples import Vec3
from sim.physics import fixed_wing, multirotor
from sim.physics.fixed_wing import LEAST_AHEAD
from sim.physics.forces.rotors import Rotor
from sim.physics.vehicle import Vehicle


def lifters(vehicle: Vehicle) -> list[int]:
    """Return the indices of the rotors that lift in hover."""
    return [i for i, rotor in enumerate(vehicle.rotors) if vehicle.upward(rotor.axis) >= LEAST_AHEAD]


def is_vtol(vehicle: Vehicle) -> bool:
    """Return True for a vehicle with wings, rotors that lift, and rotors that pull ahead in flight."""
    return vehicle.has_wings and bool(lifters(vehicle)) and bool(fixed_wing.engines(vehicle))


def pushers(vehicle: Vehicle) -> list[int]:
    """Return the indices of the rotors that pull ahead and do not lift."""
    lifting = set(lifters(vehicle))
    return [i for i in fixed_wing.engines(vehicle) if i not in lifting]


def hovering(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with its lifters alone, as a multirotor's controller sees it in hover.

    A tailsitter is turned into its hover frame (`to_hover_frame`), without its wings. Tilts stay where they are.
    """
    kept = lifters(vehicle)
    rotors = []
    for i in kept:
        rotor = vehicle.rotors[i]
        above = rotor.coaxial_below
        rotors.append(rotor if above is None else rotor.model_copy(update={"coaxial_below": kept.index(above)}))
    sets = {name: of for name, of in vehicle.rotor_sets.items() if any(rotor.set == name for rotor in rotors)}
    update = {"rotors": tuple(rotors), "rotor_sets": sets, "tilts": ()}
    if vehicle.stands == "on_tail":
        x, y, z = vehicle.inertia_kgm2
        xy, xz, yz = vehicle.inertia_products_kgm2
        update |= {
            "stands": "on_feet",
            "rotors": tuple(_in_hover_frame(rotor) for rotor in rotors),
            "inertia_kgm2": (z, y, x),
            "inertia_products_kgm2": (-yz, -xz, xy),
            "body_drag_linear_n_per_mps": vehicle.body_drag_linear_n_per_mps[::-1],
            "body_drag_quadratic_n_per_m2ps2": vehicle.body_drag_quadratic_n_per_m2ps2[::-1],
            "forces": (),
        }
    return vehicle.model_copy(update=update)


def to_hover_frame(v_B: Vec3) -> Vec3:
    """Return a vector of B in the hover frame of a tailsitter: x out of the belly, y to the left, z along the nose."""
    x, y, z = v_B
    return (-z + 0.0, y, x)


def _in_hover_frame(rotor: Rotor) -> Rotor:
    return rotor.model_copy(update={"position_m": to_hover_frame(rotor.position_m), "axis": to_hover_frame(rotor.axis)})


def unfit(vehicle: Vehicle) -> tuple[str, str] | None:
    """Return the key of the vehicle's file and the reason why a VTOL's controller cannot fly it; None if it can."""
    return fixed_wing.unfit(vehicle) or multirotor.unfit(hovering(vehicle))
