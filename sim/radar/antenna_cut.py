"""Measured cuts of an antenna's pattern: gain by angle in one principal plane, side lobes included.

Between its rows a cut is a straight line in decibels over the angle, beyond them constant. Azimuth is atan2(y, x), to
the left, and elevation atan2(z, sqrt(x^2 + y^2)), upwards, for the direction (x, y, z) in R. The table is linear in
power over steps of 0.05 degrees: within 0.01 dB of the lines where these fall by 5 dB per degree.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from signals._kernel import det_pow
from signals.units import RAD_PER_DEG

Float64 = NDArray[np.float64]

_Angle = Annotated[float, Field(ge=-180.0, le=180.0)]
_Gain = Annotated[float, Field(ge=-100.0, le=3.0)]
Cut = Annotated[tuple[tuple[_Angle, _Gain], ...], Field(min_length=2, max_length=2000)]  # degrees, dB to the axis
_STEPS_PER_DEG = 20


def problem_with(cut: tuple[tuple[float, float], ...]) -> str:
    """Return why the rows are no cut; "" if they are."""
    angles = [row[0] for row in cut]
    return "" if all(a < b for a, b in pairwise(angles)) else "must have rising angles"


def share(cut: tuple[tuple[float, float], ...], angle_rad: Float64) -> Float64:
    """Return the gain relative to the axis as ratios of powers, (n,)."""
    table = _table(cut)
    place = (angle_rad / RAD_PER_DEG + 180.0) * _STEPS_PER_DEG
    place = np.clip(place, 0.0, float(len(table) - 2))
    node = place.astype(np.int64)
    return np.asarray(table[node] + (place - node) * (table[node + 1] - table[node]))


@lru_cache(maxsize=32)
def _table(cut: tuple[tuple[float, float], ...]) -> Float64:
    powers, row = [], 0
    for step in range(360 * _STEPS_PER_DEG + 1):
        angle = step / _STEPS_PER_DEG - 180.0
        while row < len(cut) - 2 and angle > cut[row + 1][0]:
            row += 1
        (a0, g0), (a1, g1) = cut[row], cut[row + 1]
        t = min(max((angle - a0) / (a1 - a0), 0.0), 1.0)
        powers.append(det_pow(10.0, 0.1 * (g0 + t * (g1 - g0))))
    return np.array([*powers, powers[-1]])
