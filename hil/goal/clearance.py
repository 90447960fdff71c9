"""How near a vehicle came to anything: distances from a place to whatever surface is nearest, people included.

Rays in all directions from the place, and then a finer bundle round the shortest: at `_REACH_M` neighbouring rays lie
0.3 m apart, at 1 m 6 cm, and the finer ones a tenth of that. A surface is nearest where it is met at a right angle, so
that the distance found is too long by no more than 2 mm at 1 m; a wire thinner than the rays' distance may be missed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RayCaster, Vicinity
from sim.frame.geometry import FrameGeometry
from sim.physics.vehicle import Vehicle

_REACH_M = 5.0
_RAYS, _FINE_RAYS = 4000, 150
_SPACING_RAD = math.sqrt(4.0 * math.pi / _RAYS)


def vehicle_radius_m(vehicle: Vehicle) -> float:
    """Of the sphere round the body's origin that holds the whole vehicle, propellers included."""
    blades = vehicle.rotor_constants.radius_m
    return max(vehicle.bounding_radius_m, *(math.hypot(*rotor.position_m) + blades for rotor in vehicle.rotors))


class Clearance:
    """Distances in one scene [m]; `_REACH_M` where nothing is nearer."""

    def __init__(self, geometry: FrameGeometry) -> None:
        self._geometry = geometry
        self._caster = RayCaster(geometry.native)
        n = _RAYS
        up = 1.0 - (2.0 * np.arange(n) + 1.0) / n
        turn = np.arange(n) * (math.pi * (3.0 - math.sqrt(5.0)))
        level = np.sqrt(1.0 - up * up)
        self._sphere = np.stack([level * np.cos(turn), level * np.sin(turn), up], axis=1)
        m = _FINE_RAYS
        away = _SPACING_RAD * np.sqrt((np.arange(m) + 0.5) / m)
        turn = np.arange(m) * (math.pi * (3.0 - math.sqrt(5.0)))
        self._bundle = np.stack([away * np.cos(turn), away * np.sin(turn)], axis=1)

    def nearest_m(self, p_W: tuple[float, float, float], t_ns: int) -> float:
        """From this place to the nearest surface, as everything stands at `t_ns`."""
        self._geometry.expect(t_ns)
        self._geometry.bring(Vicinity(p_W, p_W, _REACH_M))
        range_m = self._cast(p_W, self._sphere)
        best = int(np.argmin(range_m))
        if not math.isfinite(range_m[best]):
            return _REACH_M
        d = self._sphere[best]
        a = np.cross(d, (1.0, 0.0, 0.0) if abs(d[0]) < 0.9 else (0.0, 1.0, 0.0))
        a /= np.linalg.norm(a)
        finer = d + self._bundle[:, :1] * a + self._bundle[:, 1:] * np.cross(d, a)
        finer /= np.linalg.norm(finer, axis=1, keepdims=True)
        return min(float(range_m[best]), float(self._cast(p_W, finer).min()), _REACH_M)

    def _cast(self, p_W: tuple[float, float, float], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        n = len(directions)
        range_m, geom = np.empty(n), np.empty(n, np.int32)
        origins = np.ascontiguousarray(np.broadcast_to(np.asarray(p_W), (n, 3)))
        self._caster.cast(origins, np.ascontiguousarray(directions), 0.0, _REACH_M, range_m, geom)
        return np.where(geom >= 0, range_m, math.inf)
