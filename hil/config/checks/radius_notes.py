"""Notes on waypoints that an autopilot may take as reached before it has flown there."""

from __future__ import annotations

import math

from hil.config.bench import Bench
from hil.config.missions.path import Leg, named_radius_m, planned_path, waypoint_legs

_SAME_M = 0.05  # places nearer than this are one place, to which nothing is flown


def radius_notes(bench: Bench) -> list[str]:
    """Describe the first waypoint with a radius above the one within which it counts, and the first inside its own."""
    if bench.mission is None:
        return []
    wide: dict[int, tuple[Leg, str]] = {}  # by item: a jump repeats it
    near: dict[int, tuple[Leg, str]] = {}
    for leg in waypoint_legs(planned_path(bench.mission, bench.scene, home_W=bench.config.start.p_W)):
        named_m, counts_m = named_radius_m(bench.mission.items[leg.seq]), leg.acceptance_radius_m
        length_m = math.dist(leg.start_W[:2], leg.end_W[:2])
        if length_m <= _SAME_M:
            continue
        if length_m <= counts_m and math.dist(leg.start_W, leg.end_W) <= counts_m:
            near.setdefault(
                leg.seq,
                (leg, f"lies {length_m:.2g} m from the place before, within its acceptance radius of {counts_m:.3g} m"),
            )
        elif named_m is not None and named_m > counts_m:
            radius = f"has an acceptance radius of {named_m:g} m, more than half of the {length_m:.1f} m to it"
            wide.setdefault(leg.seq, (leg, f"{radius} (it counts within {counts_m:.3g} m)"))
    notes = []
    for found in (wide, near):
        if found:
            leg, text = next(iter(found.values()))
            where, item = bench.mission.sources[leg.seq]
            more = f"; {len(found) - 1} more such" if len(found) > 1 else ""
            notes.append(f"{where}: {item} {text}: an autopilot may pass it by{more}")
    return notes
