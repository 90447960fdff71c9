"""What one would land on: the heights of what sweeps met, cell by cell, and the nearest place of bare ground.

The LiDAR of a vehicle sees little straight below it, but what lies there was seen from afar on the way. A cell holds
the highest that was met in it; what later sweeps show lower sinks by `_SINK_M` each time, so that people who walked on
are forgotten in a second. Ground is what lies within `_BARE_M` of the start's height: roofs and cars are not.

After an outcome other than the goal: over bare ground it hovers `hover_s`. Over a roof, a car, people or what nobody
has seen it goes to the nearest bare ground that it can get to, as long as it sees its way; where there is none it
hovers `unsafe_hover_s` and says what is below.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from hil_companion.explore.outcome import GOAL
from hil_companion.explore.plan_map import Berth, PlanMap
from hil_companion.explore.settings import FlightSettings

GROUND, OBSTACLE, UNKNOWN = "ground", "obstacle", "unknown"
_CELL_M = 0.5
_BARE_M = 0.5
_SINK_M = 0.15
_KNOWN_SHARE = 0.4  # of the cells of a place, between the rings of the sweeps
_NOTHING = -1e3
_WITHIN_M = 30.0


class Ground:
    """`area_W`: x and y of two corners of what is remembered; `level_m`: the start's height."""

    def __init__(self, area_W: tuple[float, float, float, float], level_m: float, radius_m: float) -> None:
        """`radius_m`: of the room that a landing takes."""
        x0, y0, x1, y1 = area_W
        self._corner_W, self._level_m = np.array([x0, y0]), level_m
        self._top_m = np.full((math.ceil((y1 - y0) / _CELL_M), math.ceil((x1 - x0) / _CELL_M)), _NOTHING, np.float32)
        reach = math.ceil(radius_m / _CELL_M)
        rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        self._disc = (np.hypot(rows, columns) * _CELL_M <= radius_m + 0.5 * _CELL_M).astype(np.uint8)

    def add(self, points_W: np.ndarray) -> None:
        """One sweep (n, 3)."""
        height, width = self._top_m.shape
        cell = np.floor((points_W[:, :2] - self._corner_W) * (1.0 / _CELL_M)).astype(np.int64)
        inside = ((cell >= 0) & (cell < (width, height))).all(axis=1)
        at = cell[inside, 1] * width + cell[inside, 0]
        order = np.argsort(points_W[inside, 2], kind="stable")
        top = self._top_m.reshape(-1)
        before = top[at]
        top[at[order]] = points_W[inside, 2][order]  # of each cell the highest comes last
        top[at] = np.maximum(top[at], before - _SINK_M)

    def stood_on(self, x_m: float, y_m: float) -> None:
        """The vehicle stands here: it is ground."""
        reach = np.arange(-3, 4) * _CELL_M
        x, y = (a.reshape(-1) for a in np.meshgrid(reach + x_m, reach + y_m))
        self.add(np.stack([x, y, np.full(len(x), self._level_m)], axis=1))

    def below(self, x_m: float, y_m: float) -> str:
        """GROUND, OBSTACLE or UNKNOWN: what a vehicle would land on there."""
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
        """x and y (n, 2) of places of bare ground, the nearest first."""
        bare = (self._top_m > _NOTHING) & (self._top_m <= self._level_m + _BARE_M)
        taken = cv2.dilate((self._top_m > self._level_m + _BARE_M).astype(np.uint8), self._disc) > 0
        share = cv2.filter2D(bare.astype(np.float32), -1, self._disc / float(self._disc.sum()))
        rows, columns = np.nonzero((share >= _KNOWN_SHARE) & ~taken)
        xy = (np.stack([columns, rows], axis=-1) + 0.5) * _CELL_M + self._corner_W
        away_m = np.hypot(xy[:, 0] - x_m, xy[:, 1] - y_m)
        order = np.argsort(away_m, kind="stable")
        return np.asarray(xy[order[away_m[order] <= within_m]])


class Landing:
    """Of one flight: when the bench may land the vehicle, and where it had better hover until then."""

    def __init__(self, settings: FlightSettings, ground: Ground) -> None:
        self._settings, self._ground = settings, ground
        self._spot: tuple[float, float] | None = None

    def due(self, outcome: str, below: str, since_s: float) -> bool:
        """Whether it may be landed, so long after the outcome."""
        if outcome == GOAL:
            return True  # whoever set the goal chose what lies below
        return since_s >= (self._settings.hover_s if below == GROUND else self._settings.unsafe_hover_s)

    def spot(self, p_W: np.ndarray, around: PlanMap, berth: Berth) -> tuple[float, float] | None:
        """Where to go; the same again while it is good."""
        places = self._ground.places(float(p_W[0]), float(p_W[1]), _WITHIN_M)
        if self._spot is not None and self._ground.below(*self._spot) == GROUND:
            places = np.vstack([self._spot, places])
        places = places[around.holds(places)]
        rows, columns = around.fine(places)
        reachable = _reachable(around, p_W)[rows // around.blocks, columns // around.blocks]
        good = np.flatnonzero(reachable & (around.distance_m[rows, columns] >= berth.hard_m))
        self._spot = (float(places[good[0], 0]), float(places[good[0], 1])) if len(good) else None
        return self._spot


def _reachable(around: PlanMap, p_W: np.ndarray) -> np.ndarray:
    """Cells of the plan's grid that there is a way to."""
    here = around.plan_cell(float(p_W[0]), float(p_W[1]))
    passable = np.isfinite(around.price).astype(np.uint8)
    passable[here] = 1
    _, label = cv2.connectedComponents(passable, connectivity=4)
    return np.asarray(label == label[here])
