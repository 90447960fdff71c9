"""The speeds over ground that a plan commands on the legs between its waypoints (`DO_CHANGE_SPEED`).

An autopilot may fly slower: at corners, in climbs, in turns of its nose. It is too fast if at any time it gets ahead of
a vehicle at the greatest speed allowed, by more than the distance by which it may be off its place: a gust that moves
it there is no speed. Where the plan has only now named a speed, or lowered it, it has the way to brake.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from hil.config.missions.path import Leg
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S

MARGIN_MPS = 1.0
MARGIN_SHARE = 0.2  # of the speed, where that is more
BRAKE_MPS2 = 1.0  # no autopilot brakes with less
_BRAKES_AFTER_M = 5.0  # the count is ahead of the vehicle
_START_M = 3.0  # from where the first leg begins: the way there, from a start elsewhere, belongs to the take-off


class LegSpeeds:
    """Tells whether a vehicle was faster than its plan; call `add` for every measured tick of the flight of a leg."""

    def __init__(self, fly: Sequence[Leg], *, off_m: float) -> None:
        """`off_m`: distance by which the vehicle may be off its place."""
        self._commanded_mps = [leg.speed_mps for leg in fly]
        self._most_mps = [mps + max(MARGIN_MPS, MARGIN_SHARE * mps) if mps else math.inf for mps in self._commanded_mps]
        self._start_W = fly[0].start_W if fly else None  # None: it has been there
        # ArduPilot turns at the waypoint itself, however wide the radius in which it counts.
        self._ahead_by_m = [0.0, *(leg.acceptance_radius_m for leg in fly)]
        self._off_m = off_m
        self._now_mps = 0.0  # commanded for the leg being flown
        self._brakes: tuple[Vec3, float] | None = None  # since where, and the greatest distance [m] that it takes
        self._ahead_m = 0.0
        self._before_ns: int | None = None
        self.missed = ""  # the first leg that was flown too fast, in words

    def add(self, truth: TruthState, target: int) -> None:
        """Add a true state on the way to a waypoint, by its index."""
        if self._start_W is not None:
            if target == 0 and math.dist(truth.p_WB, self._start_W) > _START_M:
                return
            self._start_W = None
        (vx, vy, _), commanded_mps, most_mps = truth.v_WB_W, self._commanded_mps[target], self._most_mps[target]
        squared = vx * vx + vy * vy
        before_ns, self._before_ns = self._before_ns, truth.t_ns
        if commanded_mps != self._now_mps:
            spare_m = (squared - commanded_mps * commanded_mps) / (2.0 * BRAKE_MPS2)
            self._brakes = truth.p_WB, max(0.0, spare_m) + _BRAKES_AFTER_M + self._ahead_by_m[target]
            self._now_mps, self._ahead_m = commanded_mps, 0.0
        if squared <= most_mps * most_mps and self._ahead_m == 0.0:
            self._brakes = None
            return
        if self._brakes is not None:
            since_W, distance_m = self._brakes
            if math.dist(since_W, truth.p_WB) < distance_m:
                return
            self._brakes = None
        speed_mps, elapsed_s = math.sqrt(squared), 0.0 if before_ns is None else (truth.t_ns - before_ns) / NS_PER_S
        self._ahead_m = max(0.0, self._ahead_m + (speed_mps - most_mps) * elapsed_s)
        if self._ahead_m > self._off_m and not self.missed:
            self.missed = (
                f"the vehicle flew at {speed_mps:.3g} m/s on the way to waypoint {target + 1}, {self._ahead_m:.2g} m "
                f"ahead of the {most_mps:.3g} m/s that are allowed; the plan commands {commanded_mps:g} m/s"
            )
