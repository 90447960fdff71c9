"""The view of a CUT for display: its estimated position, map, plan and particles.

The runner calls a CUT's method `view()` after an answer was sent, at the period in the bench's welcome. The bench shows
the view and records it for replays; it has no effect on the flight.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any, Sequence

import numpy as np

from hil_companion.errors import CutError

UNKNOWN, FREE, NEAR, OCCUPIED = CELLS = (0, 1, 2, 3)  # NEAR: inside the safety margin of an obstacle
MAX_SIDE, MAX_POINTS = 256, 256  # the bench's limits
LARGEST_M = 1e7
_LEVEL = 6  # zlib's compression level


@dataclass(frozen=True)
class Grid:
    """A map with one of `CELLS` per cell. Rows go north (y), columns east (x)."""

    cells: np.ndarray  # (rows, columns) uint8
    origin_W: Sequence[float]  # x, y of the corner of cell (0, 0) [m]
    cell_m: float


@dataclass(frozen=True)
class View:
    """One view. A map that is too large is reduced to blocks of cells; too many points are thinned."""

    p_W: Sequence[float]  # [m]
    yaw_rad: float
    goal_W: Sequence[float] | None = None  # x, y [m]
    plan_W: np.ndarray | None = None  # (n, 2) [m]
    particles_W: np.ndarray | None = None  # (n, 2) [m]
    grid: Grid | None = None

    def as_map(self) -> dict[str, Any]:
        """Return the entries of the message. Raises CutError for a number that is not finite or a wrong shape."""
        return {
            "p_W": _numbers("p_W", self.p_W, 3),
            "yaw_rad": _numbers("yaw_rad", [self.yaw_rad], 1)[0],
            "goal_W": None if self.goal_W is None else _numbers("goal_W", self.goal_W, 2),
            "plan_W": _points("plan_W", self.plan_W),
            "particles_W": _points("particles_W", self.particles_W),
            "map": None if self.grid is None else _map(self.grid),
        }


def _map(grid: Grid) -> dict[str, Any] | None:
    cells = np.asarray(grid.cells)
    if cells.ndim != 2 or not cells.size or cells.dtype != np.uint8 or int(cells.max()) > max(CELLS):
        raise CutError(f"view grid: cells {cells.shape} {cells.dtype}: uint8, two axes, values 0 to 3 are needed")
    cell_m, origin_W = _numbers("cell_m", [grid.cell_m], 1)[0], _numbers("origin_W", grid.origin_W, 2)
    blocks = -(-max(cells.shape) // MAX_SIDE)
    shown = _pooled(cells, blocks)
    packed = zlib.compress(shown.tobytes(), _LEVEL)  # at most two bits a cell: 16 KiB
    rows, columns = shown.shape
    size = {"rows": int(rows), "columns": int(columns), "cell_m": cell_m * blocks}
    return {**size, "origin_W": origin_W, "cells": packed}


def _pooled(cells: np.ndarray, blocks: int) -> np.ndarray:
    """Return the greatest value of each block, so that a thin wall stays visible."""
    if blocks == 1:
        return cells
    rows, columns = (-(-n // blocks) for n in cells.shape)
    whole = np.zeros((rows * blocks, columns * blocks), np.uint8)
    whole[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(whole.reshape(rows, blocks, columns, blocks).max(axis=(1, 3)))


def _points(name: str, points: Any) -> bytes:
    if points is None or not len(points):
        return b""
    xy = np.asarray(points, np.float64)
    if xy.ndim != 2 or xy.shape[1] != 2 or not bool((np.abs(xy) <= LARGEST_M).all()):
        raise CutError(f"view {name}: finite points (n, 2) are needed, this is {xy.shape}")
    stride = -(-len(xy) // (MAX_POINTS - 1))
    thinned = xy[::stride] if (len(xy) - 1) % stride == 0 else np.concatenate([xy[::stride], xy[-1:]])
    return np.ascontiguousarray(thinned, "<f4").tobytes()


def _numbers(name: str, values: Any, count: int) -> list[float]:
    numbers = [float(value) for value in values]
    if len(numbers) != count or not all(abs(value) <= LARGEST_M for value in numbers):
        raise CutError(f"view {name} {numbers}: {count} finite numbers are needed")
    return numbers
