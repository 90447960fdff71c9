"""Notes on missions that lead out of what their bench allows: its time, and the distance from the plan."""

from __future__ import annotations

import math

from hil.config.bench import Bench
from hil.config.missions.mission import Mission
from hil.config.missions.path import LegKind
from hil.config.missions.places import LOITER_RADII, TIMES
from sim.physics.fixed_wing import is_plane
from sim.physics.vtol import is_vtol

_FASTEST_MPS = 100.0  # faster than any vehicle of a bench flies
_WAYPOINT = 16  # whose time planes do not wait


def far_notes(bench: Bench) -> list[str]:
    """Describe a mission that cannot end within `duration_s`, and the first circle wider than `fly_away_m`."""
    if bench.mission is None:
        return []
    on_wings = is_plane(bench.vehicle) or is_vtol(bench.vehicle)
    notes = _time_notes(bench, bench.mission, on_wings=on_wings) if bench.outcome == "complete" else []
    return [*notes, *(_circle_notes(bench.mission, bench.config.fly_away_m) if on_wings else ())]


def _time_notes(bench: Bench, mission: Mission, *, on_wings: bool) -> list[str]:
    duration_s = bench.config.duration_s
    legs = bench.legs
    if any(leg.kind is LegKind.ENDLESS for leg in legs):
        return []  # the verdict tells of it
    timed = TIMES.keys() - ({_WAYPOINT} if on_wings else set())
    items = [mission.items[leg.seq] for leg in legs if leg.kind is LegKind.FLY]
    waits_s = sum(item.param1 for item in items if item.command in timed and item.param1 > 0.0)  # NaN: none
    way_m = sum(math.dist(leg.start_W, leg.end_W) for leg in legs)
    least_s = way_m / _FASTEST_MPS + waits_s
    if least_s <= duration_s:
        return []
    waits = f" with {waits_s:g} s of waiting" if waits_s else ""
    takes = f"{way_m / 1000.0:.3g} km{waits} takes at least {math.ceil(least_s)} s ({_FASTEST_MPS:g} m/s)"
    return [f"mission: {takes}, but the flight ends at duration_s ({duration_s:g} s)"]


def _circle_notes(mission: Mission, fly_away_m: float | None) -> list[str]:
    if fly_away_m is None:
        return []
    circles = {}
    for item in mission.items:
        index = LOITER_RADII.get(item.command)
        radius_m = 0.0 if index is None else abs((item.param1, item.param2, item.param3)[index])
        if radius_m > fly_away_m:
            circles[item.seq] = f"has the loiter radius {radius_m:g} m"
    if not circles:
        return []
    first, more = mission.first_of(circles)
    return [f"{first}: farther from the plan than fly_away_m ({fly_away_m:g} m) allows{more}"]
