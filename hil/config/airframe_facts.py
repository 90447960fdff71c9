"""The vehicle of a bench as its autopilot is told of it: a multirotor, a plane, or a VTOL, which is both."""

from __future__ import annotations

from firmware_bridge.autopilots.installation import Aircraft
from hil.config.fixed_wing_facts import fixed_wing_facts
from hil.config.multirotor_facts import multirotor_facts
from hil.config.vtol_facts import vtol_facts
from sim.physics import fixed_wing, multirotor, vtol
from sim.physics.forces.force import Effects
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Site


def airframe_facts(vehicle: Vehicle, site: Site, effects: Effects) -> Aircraft:
    """Return the facts about a vehicle that some autopilot can fly. Raises NoTrimError for wings that cannot fly."""
    if vtol.is_vtol(vehicle):
        return vtol_facts(vehicle, site, multirotor.density_ratio(vehicle, site, effects))
    if fixed_wing.is_plane(vehicle):
        return fixed_wing_facts(vehicle, site)
    return multirotor_facts(vehicle, multirotor.density_ratio(vehicle, site, effects))
