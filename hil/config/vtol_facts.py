"""A VTOL of a bench as its autopilot is told of it: a multirotor's facts of its lifters, a plane's of its wings."""

from __future__ import annotations

from firmware_bridge.autopilots.installation import Vtol
from hil.config.fixed_wing_facts import fixed_wing_facts
from hil.config.multirotor_facts import multirotor_facts
from sim.physics import vtol
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Site


def vtol_facts(vehicle: Vehicle, site: Site | None = None, density_ratio: float = 1.0) -> Vtol:
    """Return the facts about a vehicle that `vtol.unfit` finds fit. Raises NoTrimError if it cannot fly level."""
    return Vtol(
        hover=multirotor_facts(vtol.hovering(vehicle), density_ratio),
        wing=fixed_wing_facts(vehicle, site),
        lifters=tuple(vtol.lifters(vehicle)),
        pushers=tuple(vtol.pushers(vehicle)),
    )
