"""Notes on missions that lead out of what their bench allows: its time, and the distance from the plan."""

from __future__ import annotations

import math

from hil.config.bench import Bench
from hil.config.missions.path import LegKind, planned_path
from sim.physics.fixed_wing import is_plane
from sim.physics.vtol import is_vtol

_FASTEST_MPS = 100.0  # faster than any vehicle of a bench flies
_TIMED = (16, 19, 82)  # commands whose param 1 is a time [s]
_CIRCLES = {17: 2, 18: 2, 19: 2, 31: 1}  # index of the radius among the parameters


def far_notes(bench: Bench) -> list[str]:
    """Describe a mission that cannot end within `duration_s`, and the first circle wider than `fly_away_m`."""
    mission, config = bench.mission, bench.config
    if mission is None:
        return []
    notes = []
    legs = planned_path(mission, bench.scene, home_W=config.start.p_W)
    endless = any(leg.kind is LegKind.ENDLESS for leg in legs)  # the verdict tells of it
    way_m = sum(math.dist(leg.start_W, leg.end_W) for leg in legs)
    waits_s = 0.0
    for leg in legs:
        item = mission.items[leg.seq]
        waits_s += max(item.param1, 0.0) if item.command in _TIMED and leg.kind is LegKind.FLY else 0.0  # NaN: none
    least_s = way_m / _FASTEST_MPS + waits_s
    if least_s > config.duration_s and not endless:
        waits = f" with {waits_s:g} s of waiting" if waits_s else ""
        takes = f"{way_m / 1000.0:.3g} km{waits} take {least_s:.0f} s at {_FASTEST_MPS:g} m/s"
        notes.append(f"mission: {takes}, and the flight ends at duration_s ({config.duration_s:g} s)")
    circles = {}
    limit_m = config.fly_away_m
    if limit_m is not None and (is_plane(bench.vehicle) or is_vtol(bench.vehicle)):
        for item in mission.items:
            radius_m = (0.0, item.param2, item.param3)[_CIRCLES.get(item.command, 0)]
            if abs(radius_m) > limit_m:
                circles[item.seq] = f"has the loiter radius {abs(radius_m):g} m"
    if circles:
        first, more = mission.first_of(circles)
        notes.append(f"{first}: farther from the plan than fly_away_m ({limit_m:g} m) allows{more}")
    return notes
