"""A VTOL of a bench as its autopilot is told of it: a multirotor's facts of its lifters, a plane's of its wings."""

from __future__ import annotations

import math

from firmware_bridge.autopilots.installation import Tilt, Vtol
from hil.config.fixed_wing_facts import fixed_wing_facts
from hil.config.multirotor_facts import multirotor_facts
from sim.physics import fixed_wing, vtol
from sim.physics.forces.tilt import Tilt as FileTilt
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Site


def vtol_facts(vehicle: Vehicle, site: Site | None = None, density_ratio: float = 1.0) -> Vtol:
    """Return the facts about a vehicle that `vtol.unfit` finds fit. Raises NoTrimError if it cannot fly level."""
    return Vtol(
        hover=multirotor_facts(vtol.hovering(vehicle), density_ratio),
        wing=fixed_wing_facts(vehicle, site),
        lifters=tuple(vtol.lifters(vehicle)),
        pushers=tuple(vtol.pushers(vehicle)),
        engines=tuple(fixed_wing.engines(vehicle)),
        tilts=tuple(_tilt(tilt, vehicle) for tilt in vehicle.tilts),
        hover_pitch_rad=0.5 * math.pi if vehicle.stands == "on_tail" else 0.0,
    )


def _tilt(tilt: FileTilt, vehicle: Vehicle) -> Tilt:
    most, least, *_ = tilt.servo
    ahead_rad = tilt.ahead_rad(vehicle.rotors)
    return Tilt(
        name=tilt.name,
        rotors=tilt.rotors,
        axis=tilt.axis,
        min_rad=least,
        max_rad=most,
        hover_command=tilt.hover_command,
        ahead_command=tilt.command_of(ahead_rad),
        ahead_rad=ahead_rad,
    )
