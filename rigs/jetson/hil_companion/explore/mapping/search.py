"""Correlative search for a pose in a map: tries every shift by cells and every heading in a window.

The map is a picture of the cells with hits, dilated by one cell. A pose's score is the share of the scan's points on
set cells. Each point adds the part of the picture about its cell, which scores all shifts at once.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

_POINTS = 150
_REACH_M = 40.0  # points beyond are not used, because they would need finer steps of heading
_DISTANCE_COST = 1e-6  # points per metre: of equal scores the pose nearest to the expected one wins


class Found(NamedTuple):
    """Best pose, and the `share` of the scan's points on the map there."""

    pose: np.ndarray
    share: float


def search(
    hit_xy: np.ndarray, scan_xy: np.ndarray, about: np.ndarray, *, window_m: float, window_rad: float, cell_m: float
) -> Found:
    """Return the best pose in the window about `about` (x, y, yaw). `hit_xy` (n, 2) in W, `scan_xy` (m, 2) in H."""
    about = np.array(about, float)
    scan_xy = scan_xy[np.hypot(scan_xy[:, 0], scan_xy[:, 1]) < _REACH_M]
    if not len(scan_xy) or not len(hit_xy):
        return Found(about, 0.0)
    if len(scan_xy) > _POINTS:
        scan_xy = scan_xy[(np.arange(_POINTS) * len(scan_xy)) // _POINTS]
    n, half = int(np.ceil(window_m / cell_m)), int(np.ceil((_REACH_M + window_m) / cell_m)) + 2
    corner = about[:2] - half * cell_m
    picture = np.zeros((2 * half, 2 * half), np.uint8)
    at = np.floor((hit_xy - corner) / cell_m).astype(int)
    at = at[((at >= 0) & (at < 2 * half)).all(axis=1)]
    picture[at[:, 1], at[:, 0]] = 1
    picture = cv2.dilate(picture, np.ones((3, 3), np.uint8))
    shifts = np.arange(-n, n + 1) * cell_m
    distances_m = np.hypot(shifts[:, None], shifts[None, :])
    turns = int(np.ceil(window_rad / (cell_m / _REACH_M)))
    best, pose = -1.0, about
    for turn in sorted(range(-turns, turns + 1), key=abs):
        yaw = about[2] + turn * cell_m / _REACH_M
        c, s = np.cos(yaw), np.sin(yaw)
        xy = scan_xy @ np.array([[c, s], [-s, c]])
        hits = np.zeros(distances_m.shape, np.uint8)  # _POINTS at most
        for column, row in (np.floor(xy / cell_m).astype(int) + half - n).tolist():
            hits += picture[row : row + 2 * n + 1, column : column + 2 * n + 1]
        score = hits - _DISTANCE_COST * distances_m
        here = int(np.argmax(score))
        if score.flat[here] > best:
            best = float(score.flat[here])
            pose = np.array([about[0] + shifts[here % len(shifts)], about[1] + shifts[here // len(shifts)], yaw])
    return Found(pose, round(best) / len(scan_xy))
