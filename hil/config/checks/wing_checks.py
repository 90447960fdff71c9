"""Checks that a vehicle with wings can be flown as a plane: it trims, stalls below its cruise speed, and is stable."""

from __future__ import annotations

import math

from signals.documents.validate import Located, at
from signals.errors import Problem
from sim.physics import fixed_wing
from sim.physics.fixed_wing import Airframe, NoTrimError
from sim.physics.vehicle import Vehicle

_STALL_MARGIN = 1.1  # least cruise speed over the stall speed


def wing_problems(vehicle: Vehicle, file: Located) -> list[Problem]:
    """Report a plane that cannot fly level at its cruise speed, at sea level."""
    unfit = fixed_wing.unfit(vehicle)
    if unfit is not None:
        return [at(file, (unfit[0],), unfit[1])]
    airframe = Airframe(vehicle)
    key = ("cruise_mps",) if "cruise_mps" in vehicle.model_fields_set else ("forces",)
    try:
        stall = airframe.stall_speed_mps
        cruise = airframe.cruise_mps
        if cruise < _STALL_MARGIN * stall:
            hint = f"cruise at {fixed_wing.USUAL_CRUISE * stall:.1f} m/s or more, or lower mass_kg or raise the lift"
            message = f"is {cruise:g} m/s, and the vehicle stalls at {stall:.1f} m/s"
            return [at(file, key, message, hint)]
        trim = airframe.trim(cruise)
    except NoTrimError as error:
        return [at(file, key, f"gives a vehicle that cannot fly level: {error}", _hint(airframe))]
    behind_m = airframe.neutral_point_m(cruise)
    if behind_m > 0.0:
        return []
    margin = airframe.static_margin(cruise)
    chords = "" if margin is None else f", {-margin:.0%} of the chord"
    message = (
        f"put the centre of mass {-1000.0 * behind_m:.0f} mm{chords}, behind the neutral point: at {cruise:g} m/s and "
        f"{math.degrees(trim.alpha_rad):.1f} degrees the nose moves away by itself"
    )
    return [at(file, ("forces",), message, "move the mass ahead (reference_m), or make pitch.alpha less than 0")]


def _hint(airframe: Airframe) -> str:
    try:
        slowest, fastest = airframe.speed_range_mps
    except NoTrimError:
        return "lower the drag or the mass, or raise the thrust or the reach of the surfaces"
    return f"it flies level from {slowest:.1f} to {fastest:.1f} m/s"
