"""Takes what moves out of the map: a cell that was free for long and then filled is somebody who came.

Such a cell counts as an obstacle while sweeps show it, and `keep_s` longer. Afterwards it is no obstacle any more, even
where the grid still says so because no beam has crossed it since: people leave no walls behind them. One that stays
filled for `settle_s` has become part of the place, and one that touches a part of the place always was: a wall whose
cells a beam had missed at first.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hil_companion.explore.maps import GridView
from hil_companion.explore.plan_map import occupied_mask

SURELY_FREE = -1.0  # log-odds


class Moving:
    """Looked at once for each new grid, in order."""

    def __init__(self, *, keep_s: float = 1.0, settle_s: float = 8.0) -> None:
        self._keep_s, self._settle_s = keep_s, settle_s
        self._place: Any | None = None
        self._was_free = np.zeros((0, 0), bool)
        # Of the cells that were free and are filled, by their number in the grid, ascending:
        self._cell = np.zeros(0, np.int64)
        self._since_s = np.zeros(0)  # when it was filled
        self._seen_s = np.zeros(0)  # when a sweep last showed it

    def gone(self, grid: GridView, level_W: np.ndarray, t_s: float) -> np.ndarray:
        """The cells that are marked, but were left by what moves; `level_W` (n, 2): what the newest sweep shows."""
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
        """What is known of the cells, where the grid has grown, or shows another part of the world."""
        x, y, cell_m = float(grid.origin_W[0]), float(grid.origin_W[1]), float(grid.cell_m)
        place = (x, y, cell_m, shape)
        if place == self._place:
            return
        was_free = np.zeros(shape, bool)
        if self._place is not None and self._place[2] == cell_m:
            up, right = round((self._place[1] - y) / cell_m), round((self._place[0] - x) / cell_m)
            rows, columns = np.nonzero(self._was_free)
            rows, columns = rows + up, columns + right
            inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
            was_free[rows[inside], columns[inside]] = True
            rows, columns = np.divmod(self._cell, self._was_free.shape[1])
            rows, columns = rows + up, columns + right
            inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
            self._cell = rows[inside] * shape[1] + columns[inside]  # ascending still
            self._since_s, self._seen_s = self._since_s[inside], self._seen_s[inside]
        else:
            self._cell, self._since_s, self._seen_s = np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
        self._place, self._was_free = place, was_free


def _marked(cell: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    out = np.zeros(shape, bool)
    out.ravel()[cell] = True
    return out


def _shown(cell: np.ndarray, level_W: np.ndarray, grid: GridView, shape: tuple[int, ...]) -> np.ndarray:
    """Whether a point of the sweep lies in a cell or beside it."""
    if not len(level_W) or not len(cell):
        return np.zeros(len(cell), bool)
    at = np.floor((level_W - np.asarray(grid.origin_W, float)) / float(grid.cell_m)).astype(np.int64)
    inside = (at[:, 0] > 0) & (at[:, 0] < shape[1] - 1) & (at[:, 1] > 0) & (at[:, 1] < shape[0] - 1)
    middle = at[inside, 1] * shape[1] + at[inside, 0]
    around = [middle + row * shape[1] + column for row in (-1, 0, 1) for column in (-1, 0, 1)]
    return np.isin(cell, np.concatenate(around))


def _touches(cell: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether one of the eight cells round a cell is one of the others."""
    rows, columns = np.divmod(cell, other.shape[1])
    touches = np.zeros(len(cell), bool)
    for r in (-1, 0, 1):
        for c in (-1, 0, 1):
            row, column = np.clip(rows + r, 0, other.shape[0] - 1), np.clip(columns + c, 0, other.shape[1] - 1)
            touches |= other[row, column]
    return touches
