"""Where rays meet surfaces one after the other, all along their way: what stands in a scene, by the scene itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RayCaster

_BEYOND_M = 0.004  # a ray goes on this far behind what it met
_MOST = 400  # along one ray; far more than a village has


def surfaces_along(
    caster: RayCaster, origins_W: NDArray[np.float64], direction: NDArray[np.float64], length_m: float
) -> list[NDArray[np.float64]]:
    """Points (n, 3) met by parallel rays of this length, in parts: the first of each ray, the second, and so on."""
    found = []
    left_m = np.full(len(origins_W), length_m)
    for _ in range(_MOST):
        n = len(origins_W)
        if not n:
            break
        range_m, geom = np.empty(n), np.empty(n, np.int32)
        directions = np.ascontiguousarray(np.broadcast_to(direction, (n, 3)))
        caster.cast(np.ascontiguousarray(origins_W), directions, 0.0, length_m, range_m, geom)
        met = (geom >= 0) & (range_m < left_m)
        step_m = range_m[met] + _BEYOND_M
        found.append(origins_W[met] + range_m[met, None] * direction)
        origins_W = origins_W[met] + step_m[:, None] * direction
        left_m = left_m[met] - step_m
    return found
