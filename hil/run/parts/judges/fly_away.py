"""Ends a flight, as FAIL, whose vehicle is farther than `fly_away_m` from its start, its plan and its goal.

Distances are to the nearest point of the straight legs of the plan, of the line from the start to the goal, or of the
start where there is neither; in all three axes, from ground truth.

The distance grows by no more than the vehicle moves: with d_0 at p_0, d(p) <= d_0 + |p - p_0|. It is measured only
where this bound is above the limit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hil.config import Bench
from hil.run.part import Part, RunContext
from hil.run.verdict.verdict import Verdict
from signals.samples import Vec3
from signals.time import NS_PER_S

_PERIOD_NS = NS_PER_S // 2  # between two looks
_ROUNDING_M = 1e-6  # more than the bound is wrong by rounding


class FlyAwayPart(Part):
    name = "fly_away"

    def __init__(self, limit_m: float, goal_W: Vec3 | None, tick_ns: int) -> None:
        self._limit_m, self._goal_W = limit_m, goal_W
        self.every_ticks = max(1, _PERIOD_NS // tick_ns)
        self._reason: str | None = None
        self._measured_W: Vec3 = (0.0, 0.0, 0.0)  # the last place that was measured
        self._away_m = math.inf  # there

    def begin(self, run: RunContext) -> None:
        self._run = run
        x, y, z = run.physics.state[:3].tolist()
        start_W = (x, y, z)
        lines = [(start_W, start_W if self._goal_W is None else self._goal_W)]
        lines += [(leg.start_W, leg.end_W) for leg in run.legs]
        self._starts_W = np.array([line[0] for line in lines])
        self._ends_W = np.array([line[1] for line in lines])
        self._where = "its start"
        self._where += " and its plan" if run.legs else "" if self._goal_W is None else " and the way to its goal"

    def after_tick(self, tick: int) -> None:  # noqa: ARG002 (the truth has its tick)
        truth = self._run.scheduler.truth
        if truth is None or self._reason is not None:
            return
        if self._away_m + math.dist(truth.p_WB, self._measured_W) < self._limit_m - _ROUNDING_M:
            return
        self._measured_W = truth.p_WB
        away_m = self._away_m = distance_m(truth.p_WB, self._starts_W, self._ends_W)
        if not away_m <= self._limit_m:
            x, y, z = truth.p_WB
            self._reason = (
                f"flew away: {away_m:.0f} m from {self._where} after {truth.t_ns / NS_PER_S:.1f} s, at ({x:.0f}, "
                f"{y:.0f}, {z:.0f}) m; fly_away_m allows {self._limit_m:g} m"
            )
            self._run.event("error", self._reason)

    def ended(self) -> bool:
        return self._reason is not None

    def verdict(self) -> Verdict:
        return Verdict(causes=[] if self._reason is None else [self._reason])


def distance_m(p_W: Vec3, starts_W: NDArray[np.float64], ends_W: NDArray[np.float64]) -> float:
    """Return the distance from a point to the nearest of straight lines from `starts_W` to `ends_W`, (n, 3) each [m].

    s = clamp((p - a).(b - a) / |b - a|^2, 0, 1), d = |p - a - s (b - a)|.
    """
    along, to_p = ends_W - starts_W, np.asarray(p_W) - starts_W
    squared = np.einsum("ij,ij->i", along, along)
    s = np.clip(np.einsum("ij,ij->i", to_p, along) / np.where(squared > 0.0, squared, 1.0), 0.0, 1.0)
    away = to_p - s[:, None] * along
    return math.sqrt(float(np.min(np.einsum("ij,ij->i", away, away))))


def make(bench: Bench) -> Part:
    limit_m, goal = bench.config.fly_away_m, bench.config.goal
    assert limit_m is not None
    return FlyAwayPart(limit_m, None if goal is None else goal.p_W, bench.config.tick_ns)
