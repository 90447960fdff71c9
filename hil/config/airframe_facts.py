"""The vehicle of a bench as its autopilot is told of it: a multirotor, or a plane."""

from __future__ import annotations

from firmware_bridge.autopilots.installation import FixedWing, Multirotor
from hil.config.fixed_wing_facts import fixed_wing_facts
from hil.config.multirotor_facts import multirotor_facts
from sim.physics import fixed_wing, multirotor
from sim.physics.forces.force import Effects
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Site


def airframe_facts(vehicle: Vehicle, site: Site, effects: Effects) -> Multirotor | FixedWing:
    """Return the facts about a vehicle that some autopilot can fly. Raises NoTrimError for a plane that cannot fly."""
    if fixed_wing.is_plane(vehicle):
        return fixed_wing_facts(vehicle, site)
    return multirotor_facts(vehicle, multirotor.density_ratio(vehicle, site, effects))
