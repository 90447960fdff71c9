"""Notes on limits that differ from the default and that do not judge the flight of their bench.

A multirotor is judged by `limits`, a plane by `plane_limits`, a VTOL by those and `vtol_limits`. Other sections have no
effect, and a PASS says nothing about what they ask for. Whoever changes the vehicle of a bench may leave them in it.
Likewise limits of the distance from a plan where there is none, and those on a runway where the scene has none.
"""

from __future__ import annotations

from collections.abc import Sequence

from hil.config.bench import Bench
from sim.physics.fixed_wing import is_plane
from sim.physics.vtol import is_vtol

_OF_A_PLAN = frozenset({"max_cross_track_m", "altitude_error_m", "final_error_m", "loiter_error_m"})
_OF_A_RUNWAY = frozenset({"takeoff_roll_m", "landing_roll_m", "centre_line_m", "off_runway_m"})


def limit_notes(bench: Bench) -> list[str]:
    """Return a line about each section of limits that is not the default and does not judge the flight."""
    if is_vtol(bench.vehicle):
        return []
    kind, own = ("a plane", "plane_limits") if is_plane(bench.vehicle) else ("a multirotor", "limits")
    notes = []
    for section in ("limits", "plane_limits", "vtol_limits"):
        given = getattr(bench.config, section)
        default = type(given)()
        changed = [key for key in type(given).model_fields if getattr(given, key) != getattr(default, key)]
        if section != own:
            notes += _note(section, changed, f"the vehicle {bench.config.vehicle!r} is {kind} (its limits: {own})")
            continue
        asked = [key for key in changed if getattr(given, key) is not None]
        if bench.mission is None:
            notes += _note(section, [key for key in asked if key in _OF_A_PLAN], "the bench has no mission")
        if bench.scene.runway is None:
            why = f"the scene {bench.scene.name!r} has no runway"
            notes += _note(section, [key for key in asked if key in _OF_A_RUNWAY], why)
    return notes


def _note(section: str, keys: Sequence[str], why: str) -> list[str]:
    named = ", ".join(f"{section}.{key}" for key in keys)
    return [f"{named}: not judged, {why}"] if keys else []
