"""The vehicle of a bench as its autopilot is told of it: a multirotor, or a plane."""

from __future__ import annotations

from firmware_bridge.autopilots.installation import FixedWing, Multirotor
from hil.config.multirotor_facts import multirotor_facts
from sim.physics import multirotor
from sim.physics.forces.force import Effects
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Site


def is_plane(vehicle: Vehicle) -> bool:
    """Return True if the vehicle flies on its wings: it cannot hover on its rotors, and has what a plane needs."""
    if not vehicle.has_wings or multirotor.unfit(vehicle) is None:
        return False
    from sim.physics.fixed_wing import unfit  # loads SciPy's solvers

    return unfit(vehicle) is None


def airframe_facts(vehicle: Vehicle, site: Site, effects: Effects) -> Multirotor | FixedWing:
    """Return the facts about a vehicle that some autopilot can fly. Raises NoTrimError for a plane that cannot fly."""
    if is_plane(vehicle):
        from hil.config.fixed_wing_facts import fixed_wing_facts

        return fixed_wing_facts(vehicle, site)
    return multirotor_facts(vehicle, multirotor.density_ratio(vehicle, site, effects))
