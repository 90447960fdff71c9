"""What a CUT shows of itself to people who look on: where it believes that it is, its map, its plan, its particles.

A CUT that has a method `view()` is asked for one after an answer is on its way, as often as the bench wants (its
welcome says so). The bench shows it and keeps it for replays; it decides nothing.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any, Sequence

import numpy as np

from hil_companion.errors import CutError

UNKNOWN, FREE, NEAR, OCCUPIED = CELLS = (0, 1, 2, 3)  # near: too near to something to fly there
MAX_SIDE, MAX_POINTS = 256, 256  # what the bench takes
LARGEST_M = 1e7
_LEVEL = 6  # of zlib


@dataclass(frozen=True)
class Grid:
    """A map: one of `CELLS` by cell. Rows go north (y), columns east (x)."""

    cells: np.ndarray  # (rows, columns) uint8
    origin_W: Sequence[float]  # x, y of the corner of cell (0, 0) [m]
    cell_m: float


@dataclass(frozen=True)
class View:
    """What is shown. What there is too much of is thinned: cells to blocks of them, points to every other one."""

    p_W: Sequence[float]  # [m]
    yaw_rad: float
    goal_W: Sequence[float] | None = None  # x, y [m]
    plan_W: np.ndarray | None = None  # (n, 2) [m]
    particles_W: np.ndarray | None = None  # (n, 2) [m]
    grid: Grid | None = None

    def as_map(self) -> dict[str, Any]:
        """For the wire. CutError where a number is not finite or a shape is wrong."""
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
    packed = zlib.compress(shown.tobytes(), _LEVEL)  # two bits a cell at most: 16 KiB
    rows, columns = shown.shape
    size = {"rows": int(rows), "columns": int(columns), "cell_m": cell_m * blocks}
    return {**size, "origin_W": origin_W, "cells": packed}


def _pooled(cells: np.ndarray, blocks: int) -> np.ndarray:
    """Of each block the greatest value: a thin wall stays a wall."""
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
    every = -(-len(xy) // (MAX_POINTS - 1))
    thinned = xy[::every] if (len(xy) - 1) % every == 0 else np.concatenate([xy[::every], xy[-1:]])
    return np.ascontiguousarray(thinned, "<f4").tobytes()


def _numbers(name: str, values: Any, count: int) -> list[float]:
    made = [float(value) for value in values]
    if len(made) != count or not all(abs(value) <= LARGEST_M for value in made):
        raise CutError(f"view {name} {made}: {count} finite numbers are needed")
    return made
