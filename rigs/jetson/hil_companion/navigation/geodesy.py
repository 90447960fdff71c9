"""GPS and barometer readings as positions and heights in W, relative to the vehicle's start.

The first fix defines the start, so a constant error of the receiver cancels, but not its later drift. The mean height
of the barometer in its first frames, on the ground, defines the start's height.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

_A_M = 6378137.0
_E2 = 6.69437999014e-3
_FIX_3D, _MAX_SIGMA_M = 3, 50.0
_ZERO_FRAMES = 10  # frames of the barometer on the ground


class LocalPlane:
    """Local tangent plane of WGS-84 for a few kilometres about a fix, from the ellipsoid's radii of curvature there.

    Its error is 1 mm at 100 m and 2 cm at 1 km.
    """

    def __init__(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
        self._origin = (latitude_deg, longitude_deg, altitude_m)
        s = math.sin(math.radians(latitude_deg))
        n = _A_M / math.sqrt(1.0 - _E2 * s * s)
        m = n * (1.0 - _E2) / (1.0 - _E2 * s * s)
        self._north_m = math.radians(1.0) * (m + altitude_m)
        self._east_m = math.radians(1.0) * (n + altitude_m) * math.cos(math.radians(latitude_deg))

    def enu(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> tuple[float, float, float]:
        """Convert degrees and metres to east, north, up of the fix [m]."""
        east = (longitude_deg - self._origin[1] + 180.0) % 360.0 - 180.0
        return east * self._east_m, (latitude_deg - self._origin[0]) * self._north_m, altitude_m - self._origin[2]


class Fix(NamedTuple):
    """One fix. `p_W` is None for the first one, which defines the start."""

    t_ns: int
    p_W: np.ndarray | None
    v_W: np.ndarray
    sigma_m: float  # horizontal, as the receiver reports it


class GpsFixes:
    """Converts a receiver's rows to fixes in W. `start_W`: x, y, z at the first fix."""

    def __init__(self, start_W: np.ndarray) -> None:
        self._start_W = start_W
        self._plane: LocalPlane | None = None

    def usable(self, gps: Any) -> list[Fix]:
        """Return a frame's usable fixes: three-dimensional, finite, and with a standard deviation below 50 m."""
        found = []
        for k, t_ns in enumerate(gps["t_capture_ns"]):
            place = (gps["latitude_deg"][k], gps["longitude_deg"][k], gps["altitude_m"][k])
            sigma_m, speed = gps["horizontal_accuracy_m"][k], gps["v_W"][k]
            sane = np.isfinite((*place, sigma_m, *speed)).all() and 0.0 <= sigma_m < _MAX_SIGMA_M
            if gps["fix_type"][k] < _FIX_3D or not sane:
                continue
            p_W = None if self._plane is None else self._start_W + np.array(self._plane.enu(*place))
            self._plane = self._plane or LocalPlane(*place)
            found.append(Fix(int(t_ns), p_W, np.array(speed, float), float(sigma_m)))
        return found


class BaroHeights:
    """Converts pressure altitudes to heights in W. `start_z_m`: the vehicle's height in the first frames."""

    def __init__(self, start_z_m: float) -> None:
        self._start_z_m = start_z_m
        self._zero: list[float] = []

    def height(self, baro: Any) -> tuple[int, float] | None:
        """Return time [ns] and height in W [m] of a frame's rows; None if no row is finite."""
        heights = [h for h in baro["pressure_altitude_m"] if math.isfinite(h)]
        if not heights:
            return None
        mean = sum(heights) / len(heights)
        if len(self._zero) < _ZERO_FRAMES:
            self._zero.append(mean)
        zero = sum(self._zero) / len(self._zero)
        return int(baro["t_capture_ns"][len(heights) // 2]), self._start_z_m + mean - zero
