"""Where the rings of a LiDAR look: a return that lies elsewhere is none, or the LiDAR is another one than was told."""

from __future__ import annotations

from typing import Sequence

import numpy as np

_OFF_M, _OFF_RAD = 0.05, 0.015  # of a return from its ring, since beams do not begin in one point


def on_ring(points_L: np.ndarray, ring: np.ndarray, elevation_deg: Sequence[float]) -> np.ndarray:
    """Which returns (n, 3) lie where their ring looks; of rings that are not told, and points that are none: none."""
    slopes = np.tan(np.radians(np.asarray(elevation_deg, float)))
    known = (ring >= 0) & (ring < len(slopes))
    slope = slopes[np.where(known, ring, 0)] if len(slopes) else np.zeros(len(ring))
    with np.errstate(invalid="ignore", over="ignore"):
        level_m = np.hypot(points_L[:, 0], points_L[:, 1])
        off_m = np.abs(points_L[:, 2] - slope * level_m)
        return np.asarray(known & (off_m <= _OFF_M + _OFF_RAD * (level_m + np.abs(points_L[:, 2]))))
