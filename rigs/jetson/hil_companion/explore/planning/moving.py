"""Removal of moving obstacles from the map: a cell that was surely free and then became occupied.

Such a cell is an obstacle while sweeps show it and `keep_s` longer. Afterwards it counts as vacated, even if it is
still occupied in the grid because no beam has crossed it since. A cell that stays occupied for `settle_s` becomes
static. A cell beside a static one counts as static, too: it is part of a wall that beams missed at first.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hil_companion.explore.mapping.maps import GridView
from hil_companion.explore.planning.plan_map import occupied_mask

SURELY_FREE = -1.0  # log-odds


class MovingObstacles:
    """Memory of cells that moving obstacles occupy; call `vacated` once for each new grid, in order."""

    def __init__(self, *, keep_s: float = 1.0, settle_s: float = 8.0) -> None:
        self._keep_s, self._settle_s = keep_s, settle_s
        self._grid_frame: Any | None = None  # x, y, cell size and shape of the last grid
        self._was_free = np.zeros((0, 0), bool)
        # Cells that were free and are occupied, by their flat index in the grid, ascending:
        self._cell = np.zeros(0, np.int64)
        self._since_s = np.zeros(0)  # time at which the cell became occupied
        self._seen_s = np.zeros(0)  # time of the last sweep that showed it

    def vacated(self, grid: GridView, level_W: np.ndarray, t_s: float) -> np.ndarray:
        """Return a mask of the occupied cells that a moving obstacle has left.

        `level_W` (n, 2): the newest sweep's points at the flight's height.
        """
        log_odds = np.asarray(grid.log_odds)
        self._carry_over(grid, log_odds.shape)
        self._was_free |= log_odds < SURELY_FREE
        occupied = occupied_mask(log_odds)
        cell = np.flatnonzero(occupied & self._was_free)
        since_s, seen_s = np.full(len(cell), t_s), np.full(len(cell), t_s)
        if len(self._cell):
            at = np.minimum(np.searchsorted(self._cell, cell), len(self._cell) - 1)
            known = self._cell[at] == cell
            since_s[known] = self._since_s[at[known]]
            shown = _shown(cell[known], level_W, grid, log_odds.shape)
            seen_s[known] = np.where(shown, t_s, self._seen_s[at[known]])
        settled = t_s - since_s > self._settle_s
        self._was_free.ravel()[cell[settled]] = False
        stays = ~settled
        self._cell, self._since_s, self._seen_s = cell[stays], since_s[stays], seen_s[stays]
        out = np.zeros(log_odds.shape, bool)
        left = self._cell[t_s - self._seen_s > self._keep_s]
        out.ravel()[left[~_touches(left, occupied & ~_marked(self._cell, occupied.shape))]] = True
        return out

    def _carry_over(self, grid: GridView, shape: tuple[int, ...]) -> None:
        """Move the memory to the cells of a grid that has grown or covers another area."""
        x, y, cell_m = float(grid.origin_W[0]), float(grid.origin_W[1]), float(grid.cell_m)
        frame = (x, y, cell_m, shape)
        if frame == self._grid_frame:
            return
        was_free = np.zeros(shape, bool)
        if self._grid_frame is not None and self._grid_frame[2] == cell_m:
            up, right = round((self._grid_frame[1] - y) / cell_m), round((self._grid_frame[0] - x) / cell_m)
            rows, columns = np.nonzero(self._was_free)
            rows, columns = rows + up, columns + right
            inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
            was_free[rows[inside], columns[inside]] = True
            rows, columns = np.divmod(self._cell, self._was_free.shape[1])
            rows, columns = rows + up, columns + right
            inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
            self._cell = rows[inside] * shape[1] + columns[inside]  # still ascending
            self._since_s, self._seen_s = self._since_s[inside], self._seen_s[inside]
        else:
            self._cell, self._since_s, self._seen_s = np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
        self._grid_frame, self._was_free = frame, was_free


def _marked(cell: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    out = np.zeros(shape, bool)
    out.ravel()[cell] = True
    return out


def _shown(cell: np.ndarray, level_W: np.ndarray, grid: GridView, shape: tuple[int, ...]) -> np.ndarray:
    """Return for each cell True if a point of the sweep lies in it or in one of its 8 neighbours."""
    if not len(level_W) or not len(cell):
        return np.zeros(len(cell), bool)
    at = np.floor((level_W - np.asarray(grid.origin_W, float)) / float(grid.cell_m)).astype(np.int64)
    inside = (at[:, 0] > 0) & (at[:, 0] < shape[1] - 1) & (at[:, 1] > 0) & (at[:, 1] < shape[0] - 1)
    middle = at[inside, 1] * shape[1] + at[inside, 0]
    around = [middle + row * shape[1] + column for row in (-1, 0, 1) for column in (-1, 0, 1)]
    return np.isin(cell, np.concatenate(around))


def _touches(cell: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return for each cell True if one of its 8 neighbours is set in the mask `other`."""
    rows, columns = np.divmod(cell, other.shape[1])
    touches = np.zeros(len(cell), bool)
    for r in (-1, 0, 1):
        for c in (-1, 0, 1):
            row, column = np.clip(rows + r, 0, other.shape[0] - 1), np.clip(columns + c, 0, other.shape[1] - 1)
            touches |= other[row, column]
    return touches
