"""Judges a flight to a goal from ground truth (the section `goal` of a bench).

The flight is over when the client in control reports an `outcome` other than `flying`, reports that it has finished, or
asks to land; otherwise when the run ends.

outcome          reported by the client and expected by the bench, such as `goal_in_obstacle` for a goal in a building
goal_error_m     horizontal distance from the goal when the flight was over
height_error_m   greatest distance from the goal's height, from the end of the climb that first came within the limit of
                 it (2 m if that is null) until the flight was over: over all houses there is no path to find
clearance_m      smallest distance from the sphere that encloses the vehicle to any surface, people included, sampled
                 ten times a second from half the height of the flight on
contacts         ticks with contact, from the first 0.3 m above the ground until the flight was over
path_ratio       horizontal length of the path flown, divided by the length of the shortest path from start to goal that
                 keeps `min_clearance_m` on the full map (`hil.run.verdict.shortest_path`)

If the bench expects an outcome other than `goal`, errors and ratio are not judged, nor is the clearance of a flight
that never reached half its height. `goal_in_obstacle` is false where a path leads to the goal with 2 m of clearance, or
`min_clearance_m` if that is more: clients call a goal nearer to an obstacle one in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hil.config.schema import AT_GOAL, Goal
from hil.run.verdict.clearance import Clearance, vehicle_radius_m
from hil.run.verdict.shortest_path import length_m, shortest_path
from hil.run.verdict.true_slice import TrueSlice, true_slice
from hil.run.verdict.verdict import AIRBORNE_M, Row, rows_within
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from sim.frame.geometry import FrameGeometry
from sim.physics.vehicle import Vehicle

_FLYING, _IN_OBSTACLE = "flying", "goal_in_obstacle"  # outcomes reported by clients
_SAMPLE_PERIOD_NS = NS_PER_S // 10
_MAP_MARGIN_M = 45.0  # the full map extends this far beyond start and goal
_DEFAULT_CLEARANCE_M = 0.5
_DEFAULT_HEIGHT_ERROR_M = 2.0
_OPEN_M = 2.0


@dataclass(frozen=True)
class GoalResult:
    """Measurements of a flight to a goal; None: not measured."""

    outcome: str = ""
    why: str = ""
    t_s: float | None = None
    goal_error_m: float | None = None
    height_error_m: float | None = None
    clearance_m: float | None = None
    contacts: int = 0
    path_m: float | None = None
    shortest_m: float | None = None
    path_ratio: float | None = None
    open_path_m: float | None = None  # length of the shortest path of a goal that is in no obstacle
    client: Mapping[str, Any] = field(default_factory=dict)

    def as_map(self) -> dict[str, Any]:
        """Return the fields for run.json."""
        return {name: getattr(self, name) for name in type(self).__dataclass_fields__}


class GoalMeasurement:
    """Collects ground truth and the client's reports during the flight; call `conclude` after it."""

    def __init__(self, goal: Goal, vehicle: Vehicle) -> None:
        self._goal, self._radius_m = goal, vehicle_radius_m(vehicle)
        self._report: Mapping[str, Any] = {}
        self._end_ns: int | None = None
        self._track: list[tuple[int, Vec3]] = []
        self._home: Vec3 | None = None
        self._airborne = False
        self._contacts = 0
        self._last: TruthState | None = None
        self.result = GoalResult()

    def add(self, truth: TruthState) -> None:
        """Add the true state of one tick; call it for every tick, in order."""
        if self._end_ns is not None and truth.t_ns > self._end_ns:
            return
        if self._home is None:
            self._home = truth.p_WB
        self._airborne = self._airborne or truth.p_WB[2] > self._home[2] + AIRBORNE_M
        self._contacts += self._airborne and truth.in_contact
        self._last = truth
        if truth.t_ns % _SAMPLE_PERIOD_NS == 0:
            self._track.append((truth.t_ns, truth.p_WB))

    def reported(self, report: Mapping[str, Any], t_ns: int) -> None:
        """Keep a report of the client in control; an outcome other than `flying` ends the flight."""
        self._report = report
        if report.get("outcome", _FLYING) != _FLYING:
            self.end(t_ns)

    def end(self, t_ns: int) -> None:
        """End the flight to the goal at `t_ns`. The landing that follows is not measured."""
        if self._end_ns is None:
            self._end_ns = t_ns

    def verdict_rows(self) -> tuple[list[Row], list[str]]:
        """Return the measurements beside their limits, and the reasons why the flight fails."""
        return _judge_goal(self.result, self._goal)

    def conclude(self, geometry: FrameGeometry) -> None:
        """Compute clearance and path ratio, which takes seconds. Poses moving objects at times of the past flight."""
        goal, last = self._goal, self._last
        if last is None or self._home is None:
            return
        (x, y, z), home = goal.p_W, self._home
        half_height_m = home[2] + 0.5 * (z - home[2])
        first = next((i for i, (_, p) in enumerate(self._track) if p[2] >= half_height_m), len(self._track))
        path = self._track[first:]
        clearance_m = path_m = shortest_m = ratio = open_path_m = None
        errors_m = [abs(p[2] - z) for _, p in self._track]
        near_m = goal.max_height_error_m or _DEFAULT_HEIGHT_ERROR_M
        there = next((i for i, error_m in enumerate(errors_m) if error_m <= near_m), len(errors_m))
        while there + 1 < len(errors_m) and errors_m[there + 1] < errors_m[there]:  # the climb goes on
            there += 1
        if path:
            meter = Clearance(geometry)
            clearance_m = min(meter.nearest_m(p, t_ns) for t_ns, p in path) - self._radius_m
            path_m = length_m([(p[0], p[1]) for _, p in path])
        is_in_obstacle = goal.outcome == _IN_OBSTACLE
        if path or is_in_obstacle:
            keep_m = goal.min_clearance_m or _DEFAULT_CLEARANCE_M
            full_map = self._full_map(geometry, home, keep_m)
            if path_m is not None:
                shortest_m = self._shortest_m(full_map, home, keep_m)
                ratio = path_m / shortest_m if shortest_m else None
            if is_in_obstacle:
                open_path_m = self._shortest_m(full_map, home, max(goal.min_clearance_m or 0.0, _OPEN_M))
        outcome = str(self._report.get("outcome", ""))
        self.result = GoalResult(
            outcome,
            str(self._report.get("why", "")),
            last.t_ns / NS_PER_S,
            math.dist(last.p_WB[:2], (x, y)),
            max(errors_m[there:], default=None),
            clearance_m,
            self._contacts,
            path_m,
            shortest_m,
            ratio,
            open_path_m,
            dict(self._report),
        )

    def _full_map(self, geometry: FrameGeometry, home: Vec3, keep_m: float) -> TrueSlice:
        """Return the map of the vehicle's height and `keep_m` [m] above and below it."""
        (x, y, z), margin_m, above_m = self._goal.p_W, _MAP_MARGIN_M, self._radius_m + keep_m
        area_W = (
            *(min(home[0], x) - margin_m, min(home[1], y) - margin_m),
            *(max(home[0], x) + margin_m, max(home[1], y) + margin_m),
        )
        return true_slice(geometry, low_m=z - above_m, high_m=z + above_m, area_W=area_W)

    def _shortest_m(self, full_map: TrueSlice, home: Vec3, keep_m: float) -> float | None:
        """Return the length [m] of the shortest path to the goal that keeps away `keep_m`; None: none leads there."""
        x, y, _ = self._goal.p_W
        shortest = shortest_path(full_map, (home[0], home[1]), (x, y), clearance_m=self._radius_m + keep_m)
        return None if shortest is None else length_m(shortest)


def _judge_goal(result: GoalResult, goal: Goal) -> tuple[list[Row], list[str]]:
    """Return the rows of the verdict, and the reasons why it fails."""
    reasons: list[str] = []
    if result.outcome != goal.outcome:
        reported = f"reported the outcome {result.outcome!r}" if result.outcome else "reported no outcome"
        why = f" ({result.why})" if result.why else ""
        reasons.append(f"the client {reported}{why}, but the bench expects {goal.outcome!r}")
    if result.open_path_m is not None:
        leads = f"a path of {result.open_path_m:.3g} m leads to it, far from all obstacles"
        reasons.append(f"the bench expects {goal.outcome!r}, but the goal is in none: {leads}")
    at_goal = goal.outcome == AT_GOAL
    judge_clearance = result.clearance_m is not None or at_goal  # other outcomes may occur below half the height
    rows, failed = rows_within(
        ("goal_error_m", result.goal_error_m, goal.within_m if at_goal else None, "m", False),
        ("height_error_m", result.height_error_m, goal.max_height_error_m if at_goal else None, "m", False),
        ("clearance_m", result.clearance_m, goal.min_clearance_m if judge_clearance else None, "m", True),
        ("path_ratio", result.path_ratio, goal.max_path_ratio if at_goal else None, "", False),
        ("contacts", float(result.contacts), 0.0, "", False),
    )
    return rows, [*reasons, *failed]
