"""Latitude, longitude and height to metres east, north and up of a first fix: WGS-84, for a few kilometres about it."""

from __future__ import annotations

import math

_A_M = 6378137.0
_E2 = 6.69437999014e-3


class LocalPlane:
    """Metres per degree by the ellipsoid's two radii at the origin, height included; 1 mm at 100 m, 2 cm at 1 km."""

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
