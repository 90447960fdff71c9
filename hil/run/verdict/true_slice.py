"""Occupancy grid of a scene between two heights: the full map that judges a flight through unknown terrain.

Rays along the rows and columns of a grid three times as fine as the cells, at heights from `low_m` to `high_m`, find
the surfaces; rays from above find flat tops. An object thinner than a third of a cell and lower than the distance
between two heights may be missed. Moving objects are left out. The inside of a solid stays free, which is
harmless because no path from outside reaches it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RayCaster, Vicinity
from sim.frame.geometry import FrameGeometry

_RAYS_PER_CELL = 3  # along each side
_HEIGHT_STEP_M = 0.2
_STEP_BEHIND_M = 0.004  # a ray continues this far behind a hit
_MAX_HITS = 400  # along one ray; far more than a village has


@dataclass(frozen=True, eq=False)
class TrueSlice:
    """Grid `occupied[row, column]`: row along y, column along x; `origin_W` is the corner of cell (0, 0)."""

    occupied: NDArray[np.bool_]
    origin_W: tuple[float, float]
    cell_m: float

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return row and column of the cell that contains this point of W; they may lie outside the grid."""
        return (
            math.floor((y_m - self.origin_W[1]) / self.cell_m),
            math.floor((x_m - self.origin_W[0]) / self.cell_m),
        )

    def centre_of(self, row: int, column: int) -> tuple[float, float]:
        """Return x and y of a cell's centre in W [m]."""
        return (
            self.origin_W[0] + (column + 0.5) * self.cell_m,
            self.origin_W[1] + (row + 0.5) * self.cell_m,
        )

    def inside(self, row: int, column: int) -> bool:
        """Return True if the grid has this cell."""
        height, width = self.occupied.shape
        return 0 <= row < height and 0 <= column < width


def true_slice(
    geometry: FrameGeometry,
    *,
    low_m: float,
    high_m: float,
    area_W: tuple[float, float, float, float],
    cell_m: float = 0.25,
) -> TrueSlice:
    """Return the occupancy grid of an area. `area_W`: minimum x and y, maximum x and y [m].

    Moving objects in `geometry` are hidden until the caller poses them again.
    """
    x0, y0, x1, y1 = area_W
    width, height = math.ceil((x1 - x0) / cell_m), math.ceil((y1 - y0) / cell_m)
    occupied = np.zeros((height, width), np.bool_)
    geometry.expect(geometry.t_ns + 1)
    origin = (0.0, 0.0, 0.0)
    geometry.pose_within(Vicinity(origin, origin, -math.inf))  # poses no moving object
    caster = RayCaster(geometry.native)
    levels = np.linspace(low_m, high_m, max(2, math.ceil((high_m - low_m) / _HEIGHT_STEP_M) + 1))
    centres = (x0 + (np.arange(width) + 0.5) * cell_m, y0 + (np.arange(height) + 0.5) * cell_m)
    x, y = (a.ravel() for a in np.meshgrid(*centres))
    top_points = np.stack([x, y, np.full(len(x), high_m)], axis=1)
    hits = _hits_along(caster, top_points, np.array([0.0, 0.0, -1.0]), high_m - low_m)
    for axis, count, length_m in ((0, height, width * cell_m), (1, width, height * cell_m)):
        offsets_m = (np.arange(count * _RAYS_PER_CELL) + 0.5) * (cell_m / _RAYS_PER_CELL)
        offsets, heights = (a.ravel() for a in np.meshgrid(offsets_m, levels, indexing="ij"))
        origins = np.empty((len(offsets), 3))
        origins[:, axis] = (x0, y0)[axis]
        origins[:, 1 - axis] = (x0, y0)[1 - axis] + offsets
        origins[:, 2] = heights
        direction = np.zeros(3)
        direction[axis] = 1.0
        hits += _hits_along(caster, origins, direction, length_m)
    for points in hits:
        columns = np.floor((points[:, 0] - x0) / cell_m).astype(int)
        rows = np.floor((points[:, 1] - y0) / cell_m).astype(int)
        in_grid = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        occupied[rows[in_grid], columns[in_grid]] = True
    return TrueSlice(occupied, (x0, y0), cell_m)


def _hits_along(
    caster: RayCaster, origins_W: NDArray[np.float64], direction: NDArray[np.float64], length_m: float
) -> list[NDArray[np.float64]]:
    """Return the points (n, 3) where parallel rays of this length hit: an array of first hits, of second hits, ..."""
    hits = []
    remaining_m = np.full(len(origins_W), length_m)
    for _ in range(_MAX_HITS):
        n = len(origins_W)
        if not n:
            break
        range_m, geom = np.empty(n), np.empty(n, np.int32)
        directions = np.ascontiguousarray(np.broadcast_to(direction, (n, 3)))
        caster.cast(np.ascontiguousarray(origins_W), directions, 0.0, length_m, range_m, geom)
        hit = (geom >= 0) & (range_m < remaining_m)
        step_m = range_m[hit] + _STEP_BEHIND_M
        hits.append(origins_W[hit] + range_m[hit, None] * direction)
        origins_W = origins_W[hit] + step_m[:, None] * direction
        remaining_m = remaining_m[hit] - step_m
    return hits
