"""The landings that a plan asks for before its end."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hil.config.missions.path import Leg, LegKind
from hil.run.verdict.verdict import REST_SPEED_MPS
from signals.rotation import norm
from signals.samples import TruthState, Vec3


class Landings:
    """Landings in the middle of a plan. `due`: their places not yet landed at, by the index of the next waypoint."""

    def __init__(self, legs: Sequence[Leg], *, reach_m: float) -> None:
        """`reach_m`: greatest horizontal distance [m] from its place at which a landing counts."""
        self._reach_m = reach_m
        self.due: dict[int, list[Vec3]] = {}
        waypoint = 0
        for leg in legs:
            if leg.kind is LegKind.DESCENT:
                self.due.setdefault(waypoint, []).append(leg.end_W)
            waypoint += leg.kind is LegKind.FLY
        self.due.pop(waypoint, None)  # that at the end is in no middle

    def add(self, truth: TruthState, waypoint: int) -> None:
        """Add a true state on the way to a waypoint, by its index."""
        places = self.due.get(waypoint)
        if not places or not truth.in_contact or norm(truth.v_WB_W) > REST_SPEED_MPS:
            return
        if math.dist(truth.p_WB[:2], places[0][:2]) <= self._reach_m:
            del places[0]

    def missed(self, waypoint: int) -> str:
        """Return that the vehicle did not land on the way to a waypoint, in words; empty: nothing is due."""
        due = self.due.get(waypoint)
        return f"the plan lands before waypoint {waypoint + 1}, and the vehicle did not" if due else ""
