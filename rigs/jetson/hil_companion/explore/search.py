"""Looks for a pose in a map about where it should be: correlative, from coarse to fine.

The map is a picture of the cells in which something was met, widened by one. At each level its cells are the maximum of
2 x 2 of the level below, so a good place is seldom missed for being between two candidates. A candidate's score is the
share of the scan's points that fall on set cells; the best of a level are looked at again on the next, at half the
step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_LEVELS = 3
_KEPT = 48  # candidates that go on to the next level
_POINTS = 150
_REACH_M = 40.0  # of the points used: beyond it the steps of heading would have to be finer
_LOOKUPS = 1_500_000  # of the first level at most; a larger window begins coarser


class Found(NamedTuple):
    """`share` of the scan's points that lie on the map there."""

    pose: np.ndarray
    share: float


def search(
    met_xy: np.ndarray, scan_xy: np.ndarray, about: np.ndarray, *, window_m: float, window_rad: float, cell_m: float
) -> Found:
    """The best pose within the window about `about` (x, y, yaw)."""
    near = np.hypot(scan_xy[:, 0], scan_xy[:, 1]) < _REACH_M
    scan_xy = scan_xy[near]
    if not len(scan_xy) or not len(met_xy):
        return Found(np.array(about, float), 0.0)
    if len(scan_xy) > _POINTS:
        scan_xy = scan_xy[(np.arange(_POINTS) * len(scan_xy)) // _POINTS]
    levels = _LEVELS
    while _candidates(window_m, window_rad, cell_m * 2 ** (levels - 1)) * len(scan_xy) > _LOOKUPS:
        levels += 1
    reach = _REACH_M + window_m + cell_m * 2**levels
    low = np.floor((np.asarray(about[:2]) - reach) / cell_m) * cell_m
    pictures = _pyramid(met_xy, low, 2.0 * reach, cell_m, levels)
    step = cell_m * 2 ** (levels - 1)
    offsets, turns = _steps(window_m, step), _steps(window_rad, step / _REACH_M)
    dx, dy, dyaw = (a.reshape(-1) for a in np.meshgrid(offsets, offsets, turns, indexing="ij"))
    poses = np.stack([dx, dy, dyaw], axis=-1) + np.asarray(about, float)
    for level in range(levels - 1, -1, -1):
        share = _shares(pictures[level], low, cell_m * 2**level, poses, scan_xy)
        # Of equal ones the nearest to where it should be.
        far = np.hypot(poses[:, 0] - about[0], poses[:, 1] - about[1])
        order = np.lexsort((far, -share))
        if level == 0:
            return Found(poses[order[0]], float(share[order[0]]))
        step *= 0.5
        shift = step * np.array([-1.0, 0.0, 1.0])
        a, b, c = (v.reshape(-1) for v in np.meshgrid(shift, shift, shift / _REACH_M, indexing="ij"))
        poses = (poses[order[:_KEPT], None, :] + np.stack([a, b, c], axis=-1)).reshape(-1, 3)
    raise AssertionError("there is at least one level")


def _candidates(window_m: float, window_rad: float, step: float) -> int:
    return len(_steps(window_m, step)) ** 2 * len(_steps(window_rad, step / _REACH_M))


def _steps(half: float, step: float) -> np.ndarray:
    count = max(0, int(np.ceil(half / step)))
    return np.arange(-count, count + 1) * step


def _pyramid(met_xy: np.ndarray, low: np.ndarray, side_m: float, cell_m: float, levels: int) -> list[np.ndarray]:
    """Level 0 is the map; one cell of level k is 2^k of it."""
    n = int(np.ceil(side_m / cell_m / 2**levels)) * 2**levels
    at = np.floor((met_xy - low) / cell_m).astype(int)
    at = at[((at > 0) & (at < n - 1)).all(axis=1)]
    picture = np.zeros((n, n), bool)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            picture[at[:, 1] + i, at[:, 0] + j] = True
    pictures = [picture]
    for _ in range(levels):
        rows = picture[::2] | picture[1::2]
        picture = rows[:, ::2] | rows[:, 1::2]
        pictures.append(picture)
    return pictures


def _shares(picture: np.ndarray, low: np.ndarray, cell_m: float, poses: np.ndarray, scan_xy: np.ndarray) -> np.ndarray:
    """Share of the points that fall on set cells, by pose."""
    out = np.empty(len(poses))
    n = len(picture)
    for begin in range(0, len(poses), 4096):  # bounds what is held at once
        part = poses[begin : begin + 4096]
        c, s = np.cos(part[:, 2:]), np.sin(part[:, 2:])
        x = (c * scan_xy[:, 0] - s * scan_xy[:, 1] + part[:, :1] - low[0]) * (1.0 / cell_m)
        y = (s * scan_xy[:, 0] + c * scan_xy[:, 1] + part[:, 1:2] - low[1]) * (1.0 / cell_m)
        column, row = np.clip(x, 0, n - 1).astype(np.int32), np.clip(y, 0, n - 1).astype(np.int32)
        out[begin : begin + 4096] = picture[row, column].mean(axis=1)
    return out
