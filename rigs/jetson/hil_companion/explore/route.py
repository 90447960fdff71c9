"""The way to the goal, planned anew with every sweep: A*, straightened where nothing stands in sight.

A new way takes the place of the one being flown only where that is blocked or clearly dearer: two ways of about the
same cost would otherwise be flown by turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from hil_companion.explore.astar import plan
from hil_companion.explore.plan_map import Berth, PlanMap

_BETTER = 0.93  # a new way's cost over that of the old one
_BETTER_M = 1.5
_ESCAPE_M, _ESCAPE_PRICE = 3.0, 30.0
_SMALL_AREA_M2 = 2500.0  # what encloses less is a building, or a yard


@dataclass(frozen=True, eq=False)
class Route:
    """`points_W` (n, 2) from the vehicle to the goal; none where there is no way, and `why` then says what is shut."""

    points_W: np.ndarray
    cost: float  # metres, each times its price
    why: str = ""  # "", "no_path" or "goal_in_obstacle"
    goal_W: tuple[float, float] = (math.nan, math.nan)  # where it leads to

    @property
    def found(self) -> bool:
        return len(self.points_W) > 0


NO_WAY = Route(np.zeros((0, 2)), math.inf, "no_path")


class Router:
    """Keeps the way being flown."""

    def __init__(self, move_goal_m: float) -> None:
        self._move_goal_m = move_goal_m
        self._before: np.ndarray | None = None

    def route(self, around: PlanMap, berth: Berth, start_W: np.ndarray, goal_W: tuple[float, float]) -> Route:
        goal = _free_goal(around, berth, goal_W, self._move_goal_m)
        if goal is None:
            self._before = None
            return Route(np.zeros((0, 2)), math.inf, "goal_in_obstacle", goal_W)
        escaping = _with_escape(around, berth, start_W)
        cells = plan(escaping.price, escaping.plan_cell(*start_W), escaping.plan_cell(*goal))
        if cells is None:
            self._before = None
            return Route(np.zeros((0, 2)), math.inf, _what_is_shut(escaping, start_W, goal), goal)
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
        self, around: PlanMap, start_W: np.ndarray, goal: tuple[float, float], cost: float
    ) -> tuple[np.ndarray, float] | None:
        """The rest of the way before, where it is still good enough."""
        if self._before is None or len(self._before) < 2 or np.hypot(*(self._before[-1] - goal)) > 1e-6:
            return None
        at, _ = nearest_on(self._before, start_W)
        rest = np.vstack([start_W, self._before[at + 1 :]])
        if not around.holds(rest).all():
            return None
        rest = straightened(around, rest)
        old = path_cost(around, rest)
        if not math.isfinite(old) or cost < _BETTER * old - _BETTER_M:
            return None
        return rest, old


def path_cost(around: PlanMap, points_W: np.ndarray) -> float:
    return sum(around.cost_along(a, b) for a, b in zip(points_W[:-1], points_W[1:]))


def _step_costs(around: PlanMap, cells: list[tuple[int, int]], points_W: np.ndarray) -> np.ndarray:
    """Of steps from cell to cell, as A* counts them."""
    at = np.asarray(cells)
    price = around.price[at[:, 0], at[:, 1]]
    price = np.where(np.isfinite(price), price, 1.0)
    return np.asarray(np.hypot(*np.diff(points_W, axis=0).T) * 0.5 * (price[:-1] + price[1:]))


def straightened(around: PlanMap, points_W: np.ndarray, costs: np.ndarray | None = None) -> np.ndarray:
    """Without the points that a straight line can pass by at no greater cost; `costs` from point to point."""
    if len(points_W) <= 2:
        return points_W
    if costs is None:
        costs = np.array([around.cost_along(a, b) for a, b in zip(points_W[:-1], points_W[1:])])
    upto = np.concatenate([[0.0], np.cumsum(costs)])
    kept: list[int] = [0]
    last = len(points_W) - 1

    def sees(here: int, there: int) -> bool:
        return around.cost_along(points_W[here], points_W[there]) <= upto[there] - upto[here] + 1e-9

    while kept[-1] < last:
        here = kept[-1]
        seen, unseen = here + 1, last + 1  # the next one always is
        while unseen - seen > 1:  # the farthest, if everything nearer is seen too; else one that is
            middle = last if unseen > last and seen == here + 1 else (seen + unseen) // 2
            if sees(here, middle):
                seen = middle
            else:
                unseen = middle
        kept.append(seen)
    return points_W[kept]


def nearest_on(points_W: np.ndarray, p_W: np.ndarray) -> tuple[int, np.ndarray]:
    """The segment of a path that a point is nearest to, and the place on it."""
    a, b = points_W[:-1], points_W[1:]
    leg = b - a
    squared = np.maximum((leg * leg).sum(axis=1), 1e-12)
    share = np.clip(((p_W - a) * leg).sum(axis=1) / squared, 0.0, 1.0)
    places = a + share[:, None] * leg
    away = np.hypot(*(places - p_W).T)
    # Of equally near ones the later: a corner belongs to the leg after it.
    at = len(away) - 1 - int(np.argmin(away[::-1]))
    return at, places[at]


def _with_escape(around: PlanMap, berth: Berth, start_W: np.ndarray) -> PlanMap:
    """Where the vehicle is nearer to something than planned, cells near by that are no nearer may be flown through."""
    here_m = around.distance_at(start_W[0], start_W[1])
    row, column = around.plan_cell(*start_W)
    if here_m >= berth.hard_m and math.isfinite(around.price[row, column]):
        return around
    height, width = around.price.shape
    pooled = cv2.resize(around.distance_m, (width, height), interpolation=cv2.INTER_AREA)
    rows, columns = np.ogrid[:height, :width]
    near = np.hypot(rows - row, columns - column) * around.plan_cell_m <= _ESCAPE_M
    open_m = max(min(here_m, berth.red_m) - 0.6 * around.plan_cell_m, 0.3)
    price = np.where(near & ~np.isfinite(around.price) & (pooled >= open_m), _ESCAPE_PRICE, around.price)
    price[row, column] = min(price[row, column], _ESCAPE_PRICE)
    return replace(around, price=price)


def _free_goal(around: PlanMap, berth: Berth, goal_W: tuple[float, float], move_m: float) -> tuple[float, float] | None:
    """The goal, or the nearest place within `move_m` of it where the vehicle can be; None where there is none."""
    row, column = around.plan_cell(*goal_W)
    if math.isfinite(around.price[row, column]) and around.distance_at(*goal_W) >= berth.hard_m:
        return goal_W
    if move_m <= 0.0:
        # What is planned with stays a little farther off than the goal has to be.
        return goal_W if around.distance_at(*goal_W) >= berth.red_m else None
    rows, columns = np.nonzero(np.isfinite(around.price))
    centres = around.plan_centres(np.stack([rows, columns], axis=1))
    away = np.hypot(centres[:, 0] - goal_W[0], centres[:, 1] - goal_W[1])
    if not len(away) or away.min() > move_m:
        return None
    best = centres[int(np.argmin(away))]
    return float(best[0]), float(best[1])


def _what_is_shut(around: PlanMap, start_W: np.ndarray, goal_W: tuple[float, float]) -> str:
    """Whether the goal lies in something closed, or the vehicle does."""
    areas = []
    for x, y in ((float(start_W[0]), float(start_W[1])), goal_W):
        row, column = around.plan_cell(x, y)
        passable = np.isfinite(around.price).astype(np.uint8)
        passable[row, column] = 1
        _, label = cv2.connectedComponents(passable, connectivity=4)
        areas.append(float((label == label[row, column]).sum()) * around.plan_cell_m**2)
    start_area, goal_area = areas
    return "goal_in_obstacle" if goal_area < start_area and goal_area < _SMALL_AREA_M2 else "no_path"
