"""Distance from a point to the nearest surface of a scene, and the sphere that encloses a vehicle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from sim._kernels import RayCaster, Vicinity
from sim.frame.geometry import FrameGeometry
from sim.physics.vehicle import Vehicle

_MAX_RANGE_M = 5.0
_RAYS, _FINE_RAYS = 4000, 150
_SPACING_RAD = math.sqrt(4.0 * math.pi / _RAYS)  # between neighbouring rays
_GOLDEN_ANGLE_RAD = math.pi * (3.0 - math.sqrt(5.0))


def vehicle_radius_m(vehicle: Vehicle) -> float:
    """Return the radius of the sphere about the body's origin that encloses the whole vehicle, propellers included."""
    blades = vehicle.most_radius_m
    return max(vehicle.bounding_radius_m, *(math.hypot(*rotor.position_m) + blades for rotor in vehicle.rotors))


class Clearance:
    """Measures distances [m] from points of one scene to the nearest surface, people included.

    Rays leave the point in all directions (a Fibonacci sphere), then a finer bundle surrounds the shortest. At
    `_MAX_RANGE_M` neighbouring rays lie 0.3 m apart, at 1 m 6 cm; the rays of the bundle a seventh of that. A ray meets
    the nearest point of a surface at a right angle, so the distance is too long by at most 2 mm at 1 m. A wire thinner
    than the spacing of the rays may be missed.
    """

    def __init__(self, geometry: FrameGeometry) -> None:
        self._geometry = geometry
        self._caster = RayCaster(geometry.native)
        n = _RAYS
        z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
        angle_rad = np.arange(n) * _GOLDEN_ANGLE_RAD
        radius = np.sqrt(1.0 - z * z)
        self._sphere = np.stack([radius * np.cos(angle_rad), radius * np.sin(angle_rad), z], axis=1)
        m = _FINE_RAYS
        radius = _SPACING_RAD * np.sqrt((np.arange(m) + 0.5) / m)
        angle_rad = np.arange(m) * _GOLDEN_ANGLE_RAD
        self._bundle = np.stack([radius * np.cos(angle_rad), radius * np.sin(angle_rad)], axis=1)

    def nearest_m(self, p_W: Vec3, t_ns: int) -> float:
        """Return the distance from this point to the nearest surface at time `t_ns`; at most `_MAX_RANGE_M`.

        Poses everything that moves at `t_ns`.
        """
        self._geometry.expect(t_ns)
        self._geometry.pose_within(Vicinity(p_W, p_W, _MAX_RANGE_M))
        range_m = self._cast(p_W, self._sphere)
        shortest = int(np.argmin(range_m))
        if not math.isfinite(range_m[shortest]):
            return _MAX_RANGE_M
        d = self._sphere[shortest]
        a = np.cross(d, (1.0, 0.0, 0.0) if abs(d[0]) < 0.9 else (0.0, 1.0, 0.0))
        a /= np.linalg.norm(a)
        finer = d + self._bundle[:, :1] * a + self._bundle[:, 1:] * np.cross(d, a)
        finer /= np.linalg.norm(finer, axis=1, keepdims=True)
        return min(float(range_m[shortest]), float(self._cast(p_W, finer).min()), _MAX_RANGE_M)

    def is_blocked(self, a_W: Vec3, b_W: Vec3) -> bool:
        """Return True if a surface that does not move lies between two points."""
        way = np.subtract(b_W, a_W)
        length_m = float(np.linalg.norm(way))
        if length_m == 0.0:
            return False
        pieces = math.ceil(length_m / _MAX_RANGE_M)
        return any(
            float(self._cast(_vec3(np.asarray(a_W) + way * (k / pieces)), (way / length_m)[None, :])[0])
            < length_m / pieces
            for k in range(pieces)
        )

    def _cast(self, p_W: Vec3, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the range [m] along each direction, (n, 3) unit vectors; infinite without a hit."""
        n = len(directions)
        range_m, geom = np.empty(n), np.empty(n, np.int32)
        origins = np.ascontiguousarray(np.broadcast_to(np.asarray(p_W), (n, 3)))
        self._caster.cast(origins, np.ascontiguousarray(directions), 0.0, _MAX_RANGE_M, range_m, geom)
        return np.where(geom >= 0, range_m, math.inf)


def _vec3(row: NDArray[np.float64]) -> Vec3:
    x, y, z = (float(value) for value in row)
    return x, y, z
