"""Directions in the radar's forward half space, in cells of equal solid angle that divide by three.

Lambert's azimuthal projection about x_R maps a direction to a, b [rad] with r^2 = a^2 + b^2 <= 2, and keeps areas:

    d = (1 - r^2 / 2, a s, b s),   s = sqrt(1 - r^2 / 4),   dOmega = da db

(Snyder, Map Projections: A Working Manual, USGS 1395, 1987, eq. (24-2) to (24-4)). Cell (i, j) has its middle at
(i, j) times the spacing, so each cell of one level covers 3 x 3 of the next, and the middle one has the same direction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Cells = NDArray[np.int64]  # (n, 2), i and j

_HALF_SPACE = 2.0  # r^2 at its rim
_STEPS = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])


def forward_cells(spacing_rad: float) -> Cells:
    """Return all cells whose middle is in front, row by row."""
    reach = int(np.sqrt(_HALF_SPACE) / spacing_rad)
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1), indexing="ij")
    cells = np.stack([i.reshape(-1), j.reshape(-1)], axis=1)
    return cells[_square(cells, spacing_rad) < _HALF_SPACE]


def directions(cells: Cells, spacing_rad: float) -> Float64:
    """Return the directions of the cells' middles, (n, 3), in R. Middles behind the radar have x_R below 0."""
    square = _square(cells, spacing_rad)
    s = np.sqrt(np.maximum(1.0 - 0.25 * square, 0.0)) * spacing_rad
    return np.stack([1.0 - 0.5 * square, cells[:, 0] * s, cells[:, 1] * s], axis=1)


def children(cells: Cells) -> Cells:
    """Return the 3 x 3 cells of the next level under each cell, (9 n, 2)."""
    return np.asarray((3 * cells[:, None, :] + _STEPS[None, :, :]).reshape(-1, 2))


class CellIndex:
    """Place of cells in a list."""

    def __init__(self, cells: Cells) -> None:
        self._first = cells.min(axis=0, initial=0) - 1
        self._place = np.full(cells.max(axis=0, initial=0) + 2 - self._first, -1, np.int64)
        self._place[cells[:, 0] - self._first[0], cells[:, 1] - self._first[1]] = np.arange(len(cells))

    def neighbours(self, cells: Cells) -> NDArray[np.int64]:
        """Return the places of the eight neighbours of each of the list's cells, (n, 8); -1: not in the list."""
        around = np.delete(_STEPS, 4, axis=0) - self._first
        return np.asarray(self._place[cells[:, :1] + around[:, 0], cells[:, 1:] + around[:, 1]])


def _square(cells: Cells, spacing_rad: float) -> Float64:
    a, b = cells[:, 0] * spacing_rad, cells[:, 1] * spacing_rad
    return np.asarray(a * a + b * b)
