"""What GPS and barometer say, in metres east, north and up of where the vehicle started.

The first fix is taken for the start, so what a receiver is off by as a whole cancels; what it drifts from then on does
not. The height that the barometer has in its first frames, on the ground, is the start's.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

_A_M = 6378137.0
_E2 = 6.69437999014e-3
_FIX_3D, _MOST_SIGMA_M = 3, 50.0
_ZERO_FRAMES = 10  # of the barometer, on the ground


class LocalPlane:
    """WGS-84 for a few kilometres about a fix: metres per degree by the ellipsoid's two radii there, height included.

    1 mm off at 100 m, 2 cm at 1 km.
    """

    def __init__(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
        self._origin = (latitude_deg, longitude_deg, altitude_m)
        s = math.sin(math.radians(latitude_deg))
        n = _A_M / math.sqrt(1.0 - _E2 * s * s)
        m = n * (1.0 - _E2) / (1.0 - _E2 * s * s)
        self._north_m = math.radians(1.0) * (m + altitude_m)
        self._east_m = math.radians(1.0) * (n + altitude_m) * math.cos(math.radians(latitude_deg))

    def enu(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> tuple[float, float, float]:
        """East, north, up."""
        east = (longitude_deg - self._origin[1] + 180.0) % 360.0 - 180.0
        return east * self._east_m, (latitude_deg - self._origin[0]) * self._north_m, altitude_m - self._origin[2]


class Fix(NamedTuple):
    """One fix. `p_W`: None of the first, which says where the start is."""

    t_ns: int
    p_W: np.ndarray | None
    v_W: np.ndarray
    sigma_m: float  # horizontally, as the receiver says


class GpsFixes:
    """`start_W`: x, y, z of the first fix."""

    def __init__(self, start_W: np.ndarray) -> None:
        self._start_W = start_W
        self._plane: LocalPlane | None = None

    def of(self, gps: Any) -> list[Fix]:
        """The usable ones of a frame's rows: three-dimensional, finite, and known to 50 m."""
        found = []
        for k, t_ns in enumerate(gps["t_capture_ns"]):
            place = (gps["latitude_deg"][k], gps["longitude_deg"][k], gps["altitude_m"][k])
            sigma_m, speed = gps["horizontal_accuracy_m"][k], gps["v_W"][k]
            sane = np.isfinite((*place, sigma_m, *speed)).all() and 0.0 <= sigma_m < _MOST_SIGMA_M
            if gps["fix_type"][k] < _FIX_3D or not sane:
                continue
            p_W = None if self._plane is None else self._start_W + np.array(self._plane.enu(*place))
            self._plane = self._plane or LocalPlane(*place)
            found.append(Fix(int(t_ns), p_W, np.array(speed, float), float(sigma_m)))
        return found


class BaroHeights:
    """`start_z_m`: where the vehicle stands in the first frames."""

    def __init__(self, start_z_m: float) -> None:
        self._start_z_m = start_z_m
        self._zero: list[float] = []

    def of(self, baro: Any) -> tuple[int, float] | None:
        """Time [ns] and height in W of a frame's rows; None where there is none that is finite."""
        heights = [h for h in baro["pressure_altitude_m"] if math.isfinite(h)]
        if not heights:
            return None
        mean = sum(heights) / len(heights)
        if len(self._zero) < _ZERO_FRAMES:
            self._zero.append(mean)
        zero = sum(self._zero) / len(self._zero)
        return int(baro["t_capture_ns"][len(heights) // 2]), self._start_z_m + mean - zero
