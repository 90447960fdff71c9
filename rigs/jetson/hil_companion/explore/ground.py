"""Landing sites: a height map from all sweeps, and the nearest bare ground.

The LiDAR sees little straight below the vehicle, so the map keeps the returns of earlier sweeps. A cell holds the
height of its highest return. With each sweep whose return in it is lower, the height falls by up to `_SINK_M`, so
people who walked on disappear within a second. Bare ground lies at most `_BARE_M` above the start's height, unlike
roofs and cars.

After an outcome other than the goal, the vehicle hovers `hover_s` over bare ground. Over a roof, a car, people or
unknown ground it flies to the nearest reachable bare ground, as long as its sensors work. If there is none, it hovers
`unsafe_hover_s` and reports the surface below.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from hil_companion.explore.outcome import GOAL
from hil_companion.explore.planning.flight_settings import FlightSettings
from hil_companion.explore.planning.plan_map import Clearances, PlanMap

GROUND, OBSTACLE, UNKNOWN = "ground", "obstacle", "unknown"
_CELL_M = 0.5
_BARE_M = 0.5
_SINK_M = 0.15
_KNOWN_SHARE = 0.4  # share of known cells that a site needs; the sweeps' rings leave gaps
_NOTHING = -1e3  # height of a cell without a return
_WITHIN_M = 30.0  # largest distance of a landing site


class Ground:
    """Height map of a rectangle. `area_W`: x and y of two corners; `level_m`: the start's height."""

    def __init__(self, area_W: tuple[float, float, float, float], level_m: float, radius_m: float) -> None:
        """Make an unknown map. `radius_m`: radius of the area that a landing needs."""
        x0, y0, x1, y1 = area_W
        self._corner_W, self._level_m = np.array([x0, y0]), level_m
        self._top_m = np.full((math.ceil((y1 - y0) / _CELL_M), math.ceil((x1 - x0) / _CELL_M)), _NOTHING, np.float32)
        reach = math.ceil(radius_m / _CELL_M)
        rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        self._disc = (np.hypot(rows, columns) * _CELL_M <= radius_m + 0.5 * _CELL_M).astype(np.uint8)

    def add(self, points_W: np.ndarray) -> None:
        """Add the points (n, 3) of one sweep."""
        height, width = self._top_m.shape
        cell = np.floor((points_W[:, :2] - self._corner_W) * (1.0 / _CELL_M)).astype(np.int64)
        inside = ((cell >= 0) & (cell < (width, height))).all(axis=1)
        at = cell[inside, 1] * width + cell[inside, 0]
        order = np.argsort(points_W[inside, 2], kind="stable")
        top = self._top_m.reshape(-1)
        before = top[at]
        top[at[order]] = points_W[inside, 2][order]  # the highest point of each cell is written last
        top[at] = np.maximum(top[at], before - _SINK_M)

    def stood_on(self, x_m: float, y_m: float) -> None:
        """Mark the ground on which the vehicle stands."""
        reach = np.arange(-3, 4) * _CELL_M
        x, y = (a.reshape(-1) for a in np.meshgrid(reach + x_m, reach + y_m))
        self.add(np.stack([x, y, np.full(len(x), self._level_m)], axis=1))

    def below(self, x_m: float, y_m: float) -> str:
        """Return GROUND, OBSTACLE or UNKNOWN for a landing at this position."""
        reach = len(self._disc) // 2
        column, row = (int(c) for c in np.floor((np.array([x_m, y_m]) - self._corner_W) / _CELL_M))
        height, width = self._top_m.shape
        if not (reach <= row < height - reach and reach <= column < width - reach):
            return UNKNOWN
        part = self._top_m[row - reach : row + reach + 1, column - reach : column + reach + 1][self._disc > 0]
        if (part > self._level_m + _BARE_M).any():
            return OBSTACLE
        return GROUND if np.mean(part > _NOTHING) >= _KNOWN_SHARE else UNKNOWN

    def places(self, x_m: float, y_m: float, within_m: float) -> np.ndarray:
        """Return positions (n, 2) of bare ground within a distance, the nearest first."""
        bare = (self._top_m > _NOTHING) & (self._top_m <= self._level_m + _BARE_M)
        occupied = cv2.dilate((self._top_m > self._level_m + _BARE_M).astype(np.uint8), self._disc) > 0
        share = cv2.filter2D(bare.astype(np.float32), -1, self._disc / float(self._disc.sum()))
        rows, columns = np.nonzero((share >= _KNOWN_SHARE) & ~occupied)
        xy = (np.stack([columns, rows], axis=-1) + 0.5) * _CELL_M + self._corner_W
        away_m = np.hypot(xy[:, 0] - x_m, xy[:, 1] - y_m)
        order = np.argsort(away_m, kind="stable")
        return np.asarray(xy[order[away_m[order] <= within_m]])


class Landing:
    """Landing decision of one flight: when the bench may land the vehicle, and where it hovers until then."""

    def __init__(self, settings: FlightSettings, ground: Ground) -> None:
        self._settings, self._ground = settings, ground
        self._spot: tuple[float, float] | None = None

    def due(self, outcome: str, below: str, since_s: float) -> bool:
        """Return True if the vehicle may be landed, this long after the outcome."""
        if outcome == GOAL:
            return True  # the goal was chosen as the landing site
        return since_s >= (self._settings.hover_s if below == GROUND else self._settings.unsafe_hover_s)

    def spot(self, p_W: np.ndarray, plan_map: PlanMap, clearances: Clearances) -> tuple[float, float] | None:
        """Return the nearest reachable site, or the previous one while it is still good; None if there is none."""
        places = self._ground.places(float(p_W[0]), float(p_W[1]), _WITHIN_M)
        if self._spot is not None and self._ground.below(*self._spot) == GROUND:
            places = np.vstack([self._spot, places])
        places = places[plan_map.holds(places)]
        rows, columns = plan_map.fine(places)
        reachable = _reachable(plan_map, p_W)[rows // plan_map.blocks, columns // plan_map.blocks]
        good = np.flatnonzero(reachable & (plan_map.distance_m[rows, columns] >= clearances.hard_m))
        self._spot = (float(places[good[0], 0]), float(places[good[0], 1])) if len(good) else None
        return self._spot


def _reachable(plan_map: PlanMap, p_W: np.ndarray) -> np.ndarray:
    """Return the mask of the price grid's cells that are connected with the vehicle's cell."""
    here = plan_map.plan_cell(float(p_W[0]), float(p_W[1]))
    passable = np.isfinite(plan_map.price).astype(np.uint8)
    passable[here] = 1
    _, label = cv2.connectedComponents(passable, connectivity=4)
    return np.asarray(label == label[here])
