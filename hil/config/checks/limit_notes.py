"""Notes on limits that differ from the default and that do not judge the kind of vehicle of their bench.

A multirotor is judged by `limits`, a plane by `plane_limits`, a VTOL by those and `vtol_limits`. Other sections have no
effect, and a PASS says nothing about what they ask for. Whoever changes the vehicle of a bench may leave them in it.
"""

from __future__ import annotations

from hil.config.bench import Bench
from sim.physics.fixed_wing import is_plane
from sim.physics.vtol import is_vtol


def limit_notes(bench: Bench) -> list[str]:
    """Return a line about each section of limits that is not the default and does not judge the vehicle."""
    if is_vtol(bench.vehicle):
        return []
    kind, own = ("a plane", "plane_limits") if is_plane(bench.vehicle) else ("a multirotor", "limits")
    notes = []
    for section in ("limits", "plane_limits", "vtol_limits"):
        given = getattr(bench.config, section)
        default = type(given)()
        changed = [key for key in type(given).model_fields if getattr(given, key) != getattr(default, key)]
        if changed and section != own:
            keys = ", ".join(f"{section}.{key}" for key in changed)
            notes.append(f"{keys}: not judged, the vehicle {bench.config.vehicle!r} is {kind} (its limits: {own})")
    return notes
