"""Echoes of corner reflectors in the images of mirrors, both ways by the mirror.

A corner sends a wave back to where it comes from, so it has no path out by a mirror and back without it. With O' the
image of the radar in a mirror plane, the way to the corner at K is that from O', and the mirror is met at the point B
of the plane on it. B must be free from the radar and be of that plane, and K free from B but for the corner's own
plates. The amplitude is that of corner_echoes.py for the range R' = |O'K| and the direction of the radar's image, times
the mirror's power g^2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from signals.rotation import applied_back, dot, matrix_of, minus, norm
from signals.samples import Vec3
from sim.frame.camera_pose import CameraPose
from sim.radar.antenna import Antenna
from sim.radar.corner_echoes import effective_area_m2
from sim.radar.mask import Mask
from sim.scene.scene_map import CornerReflector

_ROOT_FOUR_PI = 3.5449077018110318
_PATTERN_FLOOR = 1e-6
_TOUCH_M = 5e-3
_LIFT_M = 5e-4
_SAME_NORMAL = 1.0 - 1e-5

Cast = Callable[[Vec3, Vec3], tuple[float, int, Vec3]]  # range, geom and normal of the nearest surface
Power = Callable[[int, float], float]  # g^2 of a geom at a cosine


@dataclass(frozen=True)
class MirrorPlane:
    """Plane of a mirror in W: its normal towards the radar, and the radar's distance from it."""

    normal_W: Vec3
    distance_m: float
    geom: int


@dataclass(frozen=True)
class CornerImage:
    """Echo of one corner by one mirror."""

    range_m: float
    speed_mps: float
    direction_R: Vec3
    amplitude: float
    plate_geom: int  # of the corner, or -1
    mirror_geom: int


class MirroredCorners:
    """Corners of a map in the mirrors of a radar."""

    def __init__(
        self, corners: Sequence[CornerReflector], antenna: Antenna, mask: Mask, scale: float, wavelength_m: float
    ) -> None:
        kept = [corner for corner in corners if mask.classes is None or corner.class_name in mask.classes]
        self._corners = [(corner, matrix_of(corner.q_WK)) for corner in kept]
        self._antenna, self._mask = antenna, mask
        self._scale = scale * _ROOT_FOUR_PI / wavelength_m

    def __len__(self) -> int:
        return len(self._corners)

    def find(
        self, pose: CameraPose, planes: Sequence[MirrorPlane], limit_m: float, cast: Cast, power: Power
    ) -> list[CornerImage]:
        """Return the images within the mean range `limit_m`. Planes that agree give one image."""
        found: list[CornerImage] = []
        o = pose.p_WC
        for corner, R_WK in self._corners:
            images: list[Vec3] = []
            for plane in planes:
                n, h = plane.normal_W, plane.distance_m
                image: Vec3 = (o[0] - 2.0 * h * n[0], o[1] - 2.0 * h * n[1], o[2] - 2.0 * h * n[2])
                if any(norm(minus(image, other)) < _TOUCH_M for other in images):
                    continue
                range_m = norm(minus(image, corner.p_WK))
                if not corner.edge_m < range_m <= limit_m:
                    continue
                u_W = _ratio(minus(corner.p_WK, image), range_m)
                drop = dot(u_W, n)
                above_m = dot(minus(corner.p_WK, o), n) + h  # of the corner over the plane
                if drop <= 1e-3 or above_m <= 0.0:
                    continue
                first_m = h / drop  # from O' to B, and from O to B
                b_W: Vec3 = (image[0] + first_m * u_W[0], image[1] + first_m * u_W[1], image[2] + first_m * u_W[2])
                d_W = _ratio(minus(b_W, o), first_m)
                reached_m, geom, normal = cast(o, d_W)
                if abs(reached_m - first_m) > _TOUCH_M or dot(normal, n) < _SAME_NORMAL:
                    continue
                lifted: Vec3 = (b_W[0] + _LIFT_M * n[0], b_W[1] + _LIFT_M * n[1], b_W[2] + _LIFT_M * n[2])
                free_m, plate, _ = cast(lifted, u_W)
                if free_m < range_m - first_m - sqrt(2.0) * corner.edge_m:
                    continue
                u_K = applied_back(R_WK, u_W)
                area_m2 = effective_area_m2((-u_K[0], -u_K[1], -u_K[2]), corner.edge_m)
                d_R = pose.in_radar_frame(d_W)
                row = np.array([d_R])
                share = float(self._antenna.share(row)[0])
                if area_m2 == 0.0 or share < _PATTERN_FLOOR or not self._mask.in_window(row)[0]:
                    continue
                amplitude = self._scale * sqrt(share) * area_m2 * power(geom, drop) / (range_m * range_m)
                images.append(image)
                speed_mps = -dot(pose.v_WC_W, d_W)
                found.append(CornerImage(range_m, speed_mps, d_R, amplitude, plate, geom))
        return found


def _ratio(a: Vec3, length: float) -> Vec3:
    return (a[0] / length, a[1] / length, a[2] / length)
