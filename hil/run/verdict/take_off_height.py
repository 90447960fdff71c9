"""The height to which a plan without waypoints was flown."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hil.config.missions.path import Leg, LegKind, waypoint_legs


class TakeOffHeight:
    """Tells whether a plan without waypoints was flown to the height of its take-off; other plans have waypoints."""

    def __init__(self, legs: Sequence[Leg], *, reach_height_m: float) -> None:
        """`reach_height_m`: below the top of a take-off it counts as reached; at most half the climb."""
        climbs = [] if waypoint_legs(legs) else [leg for leg in legs if leg.kind is LegKind.CLIMB]
        heights = [(leg.start_W[2], leg.end_W[2]) for leg in climbs]
        self._from_m = max((top - min(reach_height_m, (top - start) / 2) for start, top in heights), default=-math.inf)
        self._greatest_m = -math.inf

    def add(self, up_m: float) -> None:
        """Add the height of the vehicle in W."""
        self._greatest_m = max(self._greatest_m, up_m)

    @property
    def missed(self) -> str:
        """Distance by which the vehicle stayed below the height that counts, in words; empty: it came up."""
        if self._greatest_m >= self._from_m or self._greatest_m == -math.inf:
            return ""
        below_m = self._from_m - self._greatest_m
        return f"the take-off was not finished: the vehicle stayed {below_m:.3g} m below where it counts"
