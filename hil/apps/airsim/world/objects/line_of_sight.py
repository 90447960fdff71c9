"""Rays through everything that sensors see, and lines of sight between two points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from sim.frame.geometry import FrameGeometry
from sim.frame.source import SharedFrames


def is_clear(frames: SharedFrames, start_W: Vec3, end_W: Vec3) -> bool:
    """Return True if nothing that `frames` shows is between two points, at its present time."""
    way = np.subtract(end_W, start_W)
    length_m = float(np.linalg.norm(way))
    if length_m < 1e-6:
        return True
    geometry = frames.geometry
    geometry.pose_within()
    range_m, _ = cast(geometry, np.array([start_W]), way[None] / length_m, length_m)
    return bool(range_m[0] >= length_m - 1e-6)


def cast(
    geometry: FrameGeometry, origins_W: NDArray, directions_W: NDArray, most_m: float
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the range [m] of each ray to its first surface within `most_m`, inf for none, and that surface's geom."""
    range_m, geom = np.empty(len(origins_W)), np.empty(len(origins_W), np.int32)
    origins, directions = (np.ascontiguousarray(each, np.float64) for each in (origins_W, directions_W))
    geometry.caster.cast(origins, directions, 0.0, most_m, range_m, geom)
    return range_m, geom
