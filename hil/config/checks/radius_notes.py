"""Notes on waypoints that an autopilot may take as reached before it has flown there."""

from __future__ import annotations

import math

from hil.config.bench import Bench
from hil.config.missions.path import named_radius_m, planned_path, waypoint_legs


def radius_notes(bench: Bench) -> list[str]:
    """Describe the first waypoint with an acceptance radius greater than the one within which it is judged."""
    if bench.mission is None:
        return []
    wide = {}  # by item: a jump repeats it
    for leg in waypoint_legs(planned_path(bench.mission, bench.scene, home_W=bench.config.start.p_W)):
        named_m = named_radius_m(bench.mission.items[leg.seq])
        if named_m is not None and named_m > leg.acceptance_radius_m:
            wide.setdefault(leg.seq, (leg, named_m))
    if not wide:
        return []
    leg, named_m = next(iter(wide.values()))
    where, item = bench.mission.sources[leg.seq]
    more = f"; {len(wide) - 1} more such waypoints" if len(wide) > 1 else ""
    return [
        f"{where}: {item}: its acceptance radius of {named_m:g} m is more than half of the "
        f"{math.dist(leg.start_W[:2], leg.end_W[:2]):.1f} m to it, so an autopilot may pass it by: it counts within "
        f"{leg.acceptance_radius_m:.3g} m{more}"
    ]
