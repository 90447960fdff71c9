"""The route to the goal, planned with every sweep: A*, then shortcuts along free lines of sight.

A new route replaces the present one only if that is blocked or clearly more expensive. Otherwise the vehicle would
alternate between two routes of similar cost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from hil_companion.explore.planning.astar import plan
from hil_companion.explore.planning.plan_map import Clearances, PlanMap

_BETTER, _BETTER_M = 0.93, 1.5  # a new route must cost less than 0.93 times the old route's cost minus 1.5
_ESCAPE_M, _ESCAPE_PRICE = 3.0, 30.0
_SMALL_AREA_M2 = 2500.0  # a smaller enclosed area is a building or a yard


@dataclass(frozen=True, eq=False)
class Route:
    """Points (n, 2) from the vehicle to the goal; empty if there is no path, with the reason in `why`."""

    points_W: np.ndarray
    cost: float  # sum of metres times their price
    why: str = ""  # "", "no_path" or "goal_in_obstacle"
    goal_W: tuple[float, float] = (math.nan, math.nan)  # the goal, or the free point that replaces it

    @property
    def found(self) -> bool:
        return len(self.points_W) > 0


NO_ROUTE = Route(np.zeros((0, 2)), math.inf, "no_path")


class Router:
    """Plans routes and remembers the present one. `move_goal_m`: largest shift of a goal in an obstacle."""

    def __init__(self, move_goal_m: float) -> None:
        self._move_goal_m = move_goal_m
        self._before: np.ndarray | None = None

    def route(
        self, plan_map: PlanMap, clearances: Clearances, start_W: np.ndarray, goal_W: tuple[float, float]
    ) -> Route:
        goal = _free_goal(plan_map, clearances, goal_W, self._move_goal_m)
        if goal is None:
            self._before = None
            return Route(np.zeros((0, 2)), math.inf, "goal_in_obstacle", goal_W)
        escaping = _with_escape(plan_map, clearances, start_W)
        cells = plan(escaping.price, escaping.plan_cell(*start_W), escaping.plan_cell(*goal))
        if cells is None:
            self._before = None
            return Route(np.zeros((0, 2)), math.inf, _no_path_reason(escaping, start_W, goal), goal)
        points = escaping.plan_centres(cells)
        points[0] = start_W
        points[-1] = goal
        points = straightened(escaping, points, _step_costs(escaping, cells, points))
        cost = path_cost(escaping, points)
        kept = self._kept(escaping, start_W, goal, cost)
        if kept is not None:
            points, cost = kept
        self._before = points
        return Route(points, cost, "", goal)

    def _kept(
        self, plan_map: PlanMap, start_W: np.ndarray, goal: tuple[float, float], cost: float
    ) -> tuple[np.ndarray, float] | None:
        """Return the rest of the previous route and its cost, if it is still good enough."""
        if self._before is None or len(self._before) < 2 or np.hypot(*(self._before[-1] - goal)) > 1e-6:
            return None
        at, _ = nearest_on(self._before, start_W)
        rest = np.vstack([start_W, self._before[at + 1 :]])
        if not plan_map.holds(rest).all():
            return None
        rest = straightened(plan_map, rest)
        old = path_cost(plan_map, rest)
        if not math.isfinite(old) or cost < _BETTER * old - _BETTER_M:
            return None
        return rest, old


def path_cost(plan_map: PlanMap, points_W: np.ndarray) -> float:
    return sum(plan_map.cost_along(a, b) for a, b in zip(points_W[:-1], points_W[1:]))


def _step_costs(plan_map: PlanMap, cells: list[tuple[int, int]], points_W: np.ndarray) -> np.ndarray:
    """Return the cost of each step from cell to cell, as A* counts it."""
    at = np.asarray(cells)
    price = plan_map.price[at[:, 0], at[:, 1]]
    price = np.where(np.isfinite(price), price, 1.0)
    return np.asarray(np.hypot(*np.diff(points_W, axis=0).T) * 0.5 * (price[:-1] + price[1:]))


def straightened(plan_map: PlanMap, points_W: np.ndarray, costs: np.ndarray | None = None) -> np.ndarray:
    """Return the path without the points that a straight line can skip without a higher cost.

    `costs` (n - 1,): cost from each point to the next; None: computed from the map.
    """
    if len(points_W) <= 2:
        return points_W
    if costs is None:
        costs = np.array([plan_map.cost_along(a, b) for a, b in zip(points_W[:-1], points_W[1:])])
    upto = np.concatenate([[0.0], np.cumsum(costs)])
    kept: list[int] = [0]
    last = len(points_W) - 1

    def sees(here: int, there: int) -> bool:
        return plan_map.cost_along(points_W[here], points_W[there]) <= upto[there] - upto[here] + 1e-9

    while kept[-1] < last:
        here = kept[-1]
        seen, unseen = here + 1, last + 1  # the next point is always in sight
        while unseen - seen > 1:  # bisection, which tries the end of the path first
            middle = last if unseen > last and seen == here + 1 else (seen + unseen) // 2
            if sees(here, middle):
                seen = middle
            else:
                unseen = middle
        kept.append(seen)
    return points_W[kept]


def nearest_on(points_W: np.ndarray, p_W: np.ndarray) -> tuple[int, np.ndarray]:
    """Return the index of the path's segment nearest to a point, and the nearest point (2,) on it."""
    a, b = points_W[:-1], points_W[1:]
    leg = b - a
    squared = np.maximum((leg * leg).sum(axis=1), 1e-12)
    share = np.clip(((p_W - a) * leg).sum(axis=1) / squared, 0.0, 1.0)
    places = a + share[:, None] * leg
    away = np.hypot(*(places - p_W).T)
    # Of equally near segments the later one counts: a corner belongs to the leg after it.
    at = len(away) - 1 - int(np.argmin(away[::-1]))
    return at, places[at]


def _with_escape(plan_map: PlanMap, clearances: Clearances, start_W: np.ndarray) -> PlanMap:
    """Return the map, with cells opened near a vehicle that is closer to an obstacle than planned.

    The opened cells are no nearer to obstacles than the vehicle, and expensive.
    """
    here_m = plan_map.distance_at(start_W[0], start_W[1])
    row, column = plan_map.plan_cell(*start_W)
    if here_m >= clearances.hard_m and math.isfinite(plan_map.price[row, column]):
        return plan_map
    height, width = plan_map.price.shape
    pooled = cv2.resize(plan_map.distance_m, (width, height), interpolation=cv2.INTER_AREA)
    rows, columns = np.ogrid[:height, :width]
    near = np.hypot(rows - row, columns - column) * plan_map.plan_cell_m <= _ESCAPE_M
    open_m = max(min(here_m, clearances.red_m) - 0.6 * plan_map.plan_cell_m, 0.3)
    price = np.where(near & ~np.isfinite(plan_map.price) & (pooled >= open_m), _ESCAPE_PRICE, plan_map.price)
    price[row, column] = min(price[row, column], _ESCAPE_PRICE)
    return replace(plan_map, price=price)


def _free_goal(
    plan_map: PlanMap, clearances: Clearances, goal_W: tuple[float, float], move_m: float
) -> tuple[float, float] | None:
    """Return the goal, or the nearest passable point within `move_m` of it; None if there is none."""
    row, column = plan_map.plan_cell(*goal_W)
    if math.isfinite(plan_map.price[row, column]) and plan_map.distance_at(*goal_W) >= clearances.hard_m:
        return goal_W
    if move_m <= 0.0:
        # A goal may lie nearer to an obstacle than the plan keeps elsewhere.
        return goal_W if plan_map.distance_at(*goal_W) >= clearances.red_m else None
    rows, columns = np.nonzero(np.isfinite(plan_map.price))
    centres = plan_map.plan_centres(np.stack([rows, columns], axis=1))
    away = np.hypot(centres[:, 0] - goal_W[0], centres[:, 1] - goal_W[1])
    if not len(away) or away.min() > move_m:
        return None
    best = centres[int(np.argmin(away))]
    return float(best[0]), float(best[1])


def _no_path_reason(plan_map: PlanMap, start_W: np.ndarray, goal_W: tuple[float, float]) -> str:
    """Return "goal_in_obstacle" if the goal lies in the smaller enclosed area, else "no_path"."""
    areas = []
    for x, y in ((float(start_W[0]), float(start_W[1])), goal_W):
        row, column = plan_map.plan_cell(x, y)
        passable = np.isfinite(plan_map.price).astype(np.uint8)
        passable[row, column] = 1
        _, label = cv2.connectedComponents(passable, connectivity=4)
        areas.append(float((label == label[row, column]).sum()) * plan_map.plan_cell_m**2)
    start_area, goal_area = areas
    return "goal_in_obstacle" if goal_area < start_area and goal_area < _SMALL_AREA_M2 else "no_path"
