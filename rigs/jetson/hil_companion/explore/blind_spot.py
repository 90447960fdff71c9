"""What a LiDAR saw and cannot see any more, because it has come too near: its lowest ring passes over people's heads.

Points at the height of the flight are remembered for `_KEPT_S` where they were; those that the newest sweep could see
are forgotten, since it tells.
"""

from __future__ import annotations

from collections import deque

import numpy as np

_KEPT_S = 2.0
_NEAR_M = 4.0
_CELL_M = 0.1
_SPARE = 0.02  # of slope
_LOWEST_SHARE = 1.0  # per cent of the returns that may lie lower than the lowest ring


class BlindSpot:
    """`unseen` once for each sweep, in order."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, np.ndarray]] = deque()

    def unseen(self, t_ns: int, eye_W: np.ndarray, points_W: np.ndarray, level_W: np.ndarray) -> np.ndarray:
        """x and y (n, 2) of what is remembered. `eye_W`: the LiDAR; `points_W` (n, 3): the sweep; `level_W` (n, 3):
        those at the height of the flight."""
        while self._kept and (t_ns - self._kept[0][0]) * 1e-9 > _KEPT_S:
            self._kept.popleft()
        lowest = float(np.percentile(_slope(points_W, eye_W)[0], _LOWEST_SHARE)) if len(points_W) else 0.0
        before = np.concatenate([np.zeros((0, 3)), *(points for _, points in self._kept)])
        slope, away_m = _slope(before, eye_W)
        hidden = before[(slope < lowest + _SPARE) & (away_m < _NEAR_M)][:, :2]
        _, away_m = _slope(level_W, eye_W)
        near = level_W[(away_m < _NEAR_M) & (level_W[:, 2] < eye_W[2])]
        if len(near):
            _, first = np.unique(np.floor(near / _CELL_M).astype(np.int64), axis=0, return_index=True)
            self._kept.append((t_ns, near[np.sort(first)]))
        return np.asarray(hidden)


def _slope(points_W: np.ndarray, eye_W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Up over level, and level distance."""
    d = points_W - eye_W
    away_m = np.hypot(d[:, 0], d[:, 1])
    return d[:, 2] / np.maximum(away_m, 0.05), away_m
