"""Echoes of corner reflectors by three bounces, which pictures cannot show.

Let l <= m <= n be the direction cosines of the radar in the frame of the corner, and a the edge of its square plates.
If all cosines are above 0 (else no path meets all three plates), the echo is that of a flat mirror of area

    A = a^2 (l m / n) (4 - max(0, 2 - n / m)^2),      sigma = 4 pi A^2 / lambda^2

On the axis A = sqrt(3) a^2 and sigma = 12 pi a^4 / lambda^2. A is the cross-section of the lines along (l, m, n) that
meet both the cube [0, a]^3 and its image [-a, 0]^3, because three bounces mirror a ray's straight continuation at the
corner point.

A corner is visible if the picture's range at its pixel is at least its distance minus sqrt(2) a, the farthest that its
plates reach towards the radar. Corners are static, so their radial speed comes from the radar's motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_atan2
from signals.rotation import applied_back, dot, matrix_of
from signals.samples import Vec3
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.distortion import KannalaBrandt
from sim.radar.antenna import Antenna
from sim.radar.echoes import Echoes
from sim.radar.mask import Mask
from sim.scene.scene_map import CornerReflector

Float64 = NDArray[np.float64]

_FOUR_PI = 12.566370614359172


def effective_area_m2(cosines: Vec3, edge_m: float) -> float:
    """Return A for the direction cosines of the radar in the frame of the corner."""
    low, middle, high = sorted(cosines)
    if not low > 0.0:
        return 0.0
    cut = max(0.0, 2.0 - high / middle)
    return edge_m * edge_m * (low * middle / high) * (4.0 - cut * cut)


@dataclass(frozen=True, eq=False)
class CameraPixels:
    """Direction and solid angle of every pixel of a camera."""

    camera: CameraModel
    rays_C: Float64  # (height, width, 3) unit vectors
    solid_sr: Float64  # (height, width)


class CornerEchoes:
    """Echoes of a map's corner reflectors in the radar of one camera.

    `amplitude_scale` is A R^2 / sqrt(sigma) on the antenna's axis.
    """

    def __init__(
        self,
        corners: Sequence[CornerReflector],
        pixels: CameraPixels,
        antenna: Antenna,
        mask: Mask,
        *,
        pattern_floor: float,
        amplitude_scale: float,
        wavelength_m: float,
    ) -> None:
        kept = [corner for corner in corners if mask.classes is None or corner.class_name in mask.classes]
        self._corners = [(corner, matrix_of(corner.q_WK)) for corner in kept]
        self._camera, self._rays_C, self._pixel_sr = pixels.camera, pixels.rays_C, pixels.solid_sr
        self._antenna, self._mask, self._floor = antenna, mask, pattern_floor
        self._scale = amplitude_scale * sqrt(_FOUR_PI) / wavelength_m

    def __len__(self) -> int:
        return len(self._corners)

    def write(self, picture_range: NDArray[Any], pose: CameraPose, out: Echoes, at: int) -> int:
        """Write the echoes of visible corners to `out` from row `at` on; return their number."""
        first = at
        for corner, R_WK in self._corners:
            x, y, z = (corner.p_WK[i] - pose.p_WC[i] for i in range(3))
            range_m = sqrt(x * x + y * y + z * z)
            if not range_m > corner.edge_m:  # the radar is inside the corner
                continue
            if self._mask.max_range_m is not None and range_m > self._mask.max_range_m:
                continue
            d_W = (x / range_m, y / range_m, z / range_m)
            d_K = applied_back(R_WK, d_W)
            area_m2 = effective_area_m2((-d_K[0], -d_K[1], -d_K[2]), corner.edge_m)
            d_C = applied_back(pose.R_WC, d_W)
            if area_m2 == 0.0 or not self._is_free(picture_range, d_C, range_m - sqrt(2.0) * corner.edge_m):
                continue
            d_R = np.array([[d_C[2], -d_C[0], -d_C[1]]])
            share = float(self._antenna.share(d_R)[0])
            if share < self._floor or not self._mask.in_window(d_R)[0]:
                continue
            out.range_m[at] = range_m
            out.speed_mps[at] = -dot(pose.v_WC_W, d_W)
            out.direction_R[at] = d_R[0]
            out.amplitude[at] = self._scale * sqrt(share) * area_m2 / (range_m * range_m)
            at += 1
        return at - first

    def _is_free(self, picture_range: NDArray[Any], d_C: Vec3, min_m: float) -> bool:
        """Return True if the pixel in this direction shows nothing nearer than `min_m`."""
        pixel = _pixel(self._camera, d_C)
        if pixel is None:
            return False
        column, row = pixel
        if not (0.0 <= column < self._camera.width and 0.0 <= row < self._camera.height):
            return False
        i, j = floor(row), floor(column)
        # Beyond the invertible part of a distortion, the pixel may belong to another direction.
        x, y, z = self._rays_C[i, j].tolist()
        if x * d_C[0] + y * d_C[1] + z * d_C[2] < 1.0 - 4.0 * float(self._pixel_sr[i, j]):
            return False
        return float(picture_range[i, j]) >= min_m


def _pixel(camera: CameraModel, d_C: Vec3) -> tuple[float, float] | None:
    """Return column and row of a direction; unlike CameraModel.project, without the C library's atan2."""
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
