"""Echoes of corner reflectors: three bounces, which no picture shows.

With l <= m <= n the direction cosines of the radar in the frame of the corner (all above 0, else there is no way by all
three plates) and a the edge of its square plates, what comes back is as from a flat mirror of the area

    A = a^2 (l m / n) (4 - max(0, 2 - n / m)^2),      sigma = 4 pi A^2 / lambda^2

on the axis A = sqrt(3) a^2 and sigma = 12 pi a^4 / lambda^2. It is the area of the lines along (l, m, n) that meet both
the cube [0, a]^3 and its image [-a, 0]^3: after three bounces a ray goes back along the line that it would have gone on
along, mirrored in the corner.

A corner answers where nothing stands before it: where the picture's range at its pixel is not shorter than its distance
by more than its plates reach towards the radar, at most sqrt(2) a. It stands still; its speed is that of the radar.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.signals._kernel import det_atan2
from hil.signals.rotation import matrix_of
from hil.signals.samples import Vec3
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.distortion import KannalaBrandt
from sim.radar.antenna import Antenna
from sim.radar.echoes import Echoes
from sim.radar.mask import Mask
from sim.scene.maps.scene_map import CornerReflector

Float64 = NDArray[np.float64]

_FOUR_PI = 12.566370614359172


def effective_area_m2(cosines: Vec3, edge_m: float) -> float:
    """A for the direction cosines of the radar in the frame of the corner."""
    low, middle, high = sorted(cosines)
    if not low > 0.0:
        return 0.0
    cut = max(0.0, 2.0 - high / middle)
    return edge_m * edge_m * (low * middle / high) * (4.0 - cut * cut)


class CornerEchoes:
    """The corners of a map, as one camera's radar sees them.

    `rays_C` and `pixel_sr` are those of the camera's pixels; `amplitude_scale` is A R^2 / sqrt(sigma) on the axis.
    """

    def __init__(
        self,
        corners: Sequence[CornerReflector],
        camera: CameraModel,
        rays_C: Float64,
        pixel_sr: Float64,
        antenna: Antenna,
        mask: Mask,
        pattern_floor: float,
        amplitude_scale: float,
        wavelength_m: float,
    ) -> None:
        kept = [corner for corner in corners if mask.classes is None or corner.class_name in mask.classes]
        self._corners = [(corner, matrix_of(corner.q_WK)) for corner in kept]
        self._camera, self._rays_C, self._pixel_sr = camera, rays_C, pixel_sr
        self._antenna, self._mask, self._floor = antenna, mask, pattern_floor
        self._scale = amplitude_scale * sqrt(_FOUR_PI) / wavelength_m

    def __len__(self) -> int:
        return len(self._corners)

    def write(self, picture_range: NDArray[Any], pose: CameraPose, out: Echoes, at: int) -> int:
        """Puts the echoes of the corners in sight from row `at` on and returns how many they are."""
        first = at
        for corner, R_WK in self._corners:
            x, y, z = (corner.p_WK[i] - pose.p_WC[i] for i in range(3))
            range_m = sqrt(x * x + y * y + z * z)
            if not range_m > corner.edge_m:  # the radar stands in it
                continue
            if self._mask.max_range_m is not None and range_m > self._mask.max_range_m:
                continue
            d_W = (x / range_m, y / range_m, z / range_m)
            to_K = _turned_back(R_WK, d_W)
            area_m2 = effective_area_m2((-to_K[0], -to_K[1], -to_K[2]), corner.edge_m)
            d_C = _turned_back(pose.R_WC, d_W)
            if area_m2 == 0.0 or not self._free(picture_range, d_C, range_m - sqrt(2.0) * corner.edge_m):
                continue
            d_R = np.array([[d_C[2], -d_C[0], -d_C[1]]])
            share = float(self._antenna.share(d_R)[0])
            if share < self._floor or not self._mask.in_window(d_R)[0]:
                continue
            v = pose.v_WC_W
            out.range_m[at] = range_m
            out.speed_mps[at] = -(v[0] * d_W[0] + v[1] * d_W[1] + v[2] * d_W[2])
            out.direction_R[at] = d_R[0]
            out.amplitude[at] = self._scale * sqrt(share) * area_m2 / (range_m * range_m)
            at += 1
        return at - first

    def _free(self, picture_range: NDArray[Any], d_C: Vec3, least_m: float) -> bool:
        """Whether the pixel in this direction shows nothing nearer than `least_m`."""
        place = _pixel(self._camera, d_C)
        if place is None:
            return False
        column, row = place
        if not (0.0 <= column < self._camera.width and 0.0 <= row < self._camera.height):
            return False
        i, j = floor(row), floor(column)
        # Beyond where a distortion can be inverted it leads to pixels that see elsewhere.
        x, y, z = self._rays_C[i, j].tolist()
        if x * d_C[0] + y * d_C[1] + z * d_C[2] < 1.0 - 4.0 * float(self._pixel_sr[i, j]):
            return False
        return float(picture_range[i, j]) >= least_m


def _turned_back(R: Sequence[float], v: Vec3) -> Vec3:
    """R^T v."""
    x, y, z = v
    return (R[0] * x + R[3] * y + R[6] * z, R[1] * x + R[4] * y + R[7] * z, R[2] * x + R[5] * y + R[8] * z)


def _pixel(camera: CameraModel, d_C: Vec3) -> tuple[float, float] | None:
    """Column and row of a direction, as CameraModel.project, whose fisheye uses the C library's angles."""
    if isinstance(camera.distortion, KannalaBrandt):
        x, y, z = d_C
        across = sqrt(x * x + y * y)
        theta = det_atan2(across, z)
        gain = 0.0
        for k in reversed(camera.distortion.coefficients):
            gain = (gain + k) * theta * theta
        scale = theta * (1.0 + gain) / across if across > 0.0 else 0.0
        return camera.fx * x * scale + camera.cx, camera.fy * y * scale + camera.cy
    if not d_C[2] > 0.0:
        return None
    column, row = camera.project(np.array([d_C]))[0].tolist()
    return column, row
