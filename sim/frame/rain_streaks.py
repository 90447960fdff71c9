"""Streaks of rain and flakes of snow in a picture.

A drop of width D at range z is a disc of w = f D / z pixels. In an exposure of T it moves by

    (du, dv) = f (d_x - x d_z, d_y - y d_z) / z,     d = (air past the camera + fall) T,  x = (u - cx) / f

and covers each pixel of its streak for a part of T: its area pi/4 w^2, spread evenly along and across the streak, is
the opacity a that it adds. A drop refracts what lies in a wide angle before it, so that it shows about the mean light
of the picture (Garg and Nayar, Int. J. Computer Vision 75, 2007):

    L' = L + min(a, 1) (mean L - L)        in linear light

Where drops are is drawn anew for each picture, as many as the distribution of sizes (sim/scene/precipitation.py) has in
the volume where one adds at least `_VISIBLE` to a pixel, or the nearest `_MOST_DROPS`; those beyond are the extinction
of the air. Left out: distortion of the lens, and surfaces that hide a drop (most are within a few metres).
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_pow
from signals.rotation import applied_back, minus
from signals.samples import Vec3
from sim._kernels import draw_streaks
from sim.frame.camera_effects import mean_light
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.linear_picture import LinearPicture
from sim.scene.precipitation import Precipitation

USUAL_EXPOSURE_S = 0.008  # of a camera that states none
_VISIBLE = 0.004  # opacity that changes a pixel by about half a code
_CLASSES = 64  # of width
_NEAR_M = 0.2
_MOST_DROPS = 20_000.0  # in one picture


class RainStreaks:
    """Drops in the pictures of one camera."""

    def __init__(
        self,
        falling: Precipitation,
        camera: CameraModel,
        *,
        exposure_s: float,
        wind_W_mps: Vec3,
        key: tuple[int, int],
    ) -> None:
        """`key`: of the noise of this camera's drops."""
        self._camera, self._exposure_s, self._wind_W, self._key = camera, exposure_s, wind_W_mps, key
        edges_mm = [falling.width_mm(falling.largest_mm) * k / _CLASSES for k in range(_CLASSES + 1)]
        middles_mm = [0.5 * (a + b) for a, b in pairwise(edges_mm)]
        fall_mps = [falling.fall_mps(width) for width in middles_mm]
        self._margin_px = min(0.5 * max(fall_mps) * exposure_s * camera.fx / _NEAR_M, float(camera.width))
        spread = (camera.width + 2.0 * self._margin_px) * (camera.height + 2.0 * self._margin_px)
        per_m = [
            (falling.per_m3(a) - falling.per_m3(b)) * spread / (3.0 * camera.fx * camera.fy)  # times z^3
            for a, b in pairwise(edges_mm)
        ]
        far_m = [
            self._visible_to_m(1e-3 * width_mm, speed_mps)
            for width_mm, speed_mps in zip(middles_mm, fall_mps, strict=True)
        ]
        counts = [density * (far**3 - _NEAR_M**3) for density, far in zip(per_m, far_m, strict=True)]
        if math.fsum(counts) > _MOST_DROPS:
            nearer = det_pow(_MOST_DROPS / math.fsum(counts), 1.0 / 3.0)
            far_m = [max(nearer * far, _NEAR_M) for far in far_m]
            counts = [density * (far**3 - _NEAR_M**3) for density, far in zip(per_m, far_m, strict=True)]
        self.mean_count = math.fsum(counts)
        self._share = np.array([math.fsum(counts[: k + 1]) for k in range(_CLASSES)]) / (self.mean_count or 1.0)
        self._width_m, self._far_m = 1e-3 * np.array(middles_mm), np.array(far_m)
        self._fall_mps = np.array(fall_mps)
        shape = (camera.height, camera.width)
        self._opacity, self._picture = np.zeros(shape, np.float32), LinearPicture(camera)

    def _visible_to_m(self, width_m: float, speed_mps: float) -> float:
        """Return the range at which a drop adds `_VISIBLE` to a pixel: as a streak, or as a point if it moves less."""
        f, disc = self._camera.fx, 0.25 * math.pi
        as_streak_m = disc * f * width_m**2 / (speed_mps * self._exposure_s * _VISIBLE)
        return max(min(as_streak_m, f * width_m * math.sqrt(disc / _VISIBLE)), _NEAR_M)

    def opacity(self, pose: CameraPose, index: int) -> NDArray[np.float32]:
        """Return the opacity of the drops in picture number `index`; valid until the next call."""
        air_C = applied_back(pose.R_WC, minus(self._wind_W, pose.v_WC_W))
        self._opacity.fill(0.0)
        draw_streaks(
            self._opacity,
            intrinsics_px=(self._camera.fx, self._camera.fy, self._camera.cx, self._camera.cy),
            share=self._share,
            width_m=self._width_m,
            far_m=self._far_m,
            fall_mps=self._fall_mps,
            near_m_and_margin_px=(_NEAR_M, self._margin_px),
            air_C_mps=air_C,
            down_C=(-pose.R_WC[6], -pose.R_WC[7], -pose.R_WC[8]),
            exposure_s=self._exposure_s,
            key=self._key,
            index=index,
            count=int(self.mean_count + 0.5),
        )
        return self._opacity

    def draw(self, rgb: NDArray[np.uint8], pose: CameraPose, index: int) -> None:
        """Draw the drops of picture number `index`; pixels without one keep their bits."""
        opacity = np.minimum(self.opacity(pose, index), np.float32(1.0))[:, :, None]
        self._picture.load(rgb)
        mean = np.array([mean_light(rgb[:, :, channel]) for channel in range(3)], np.float32)
        light = self._picture.light
        light += opacity * (mean - light)
        self._picture.store(rgb, opacity[:, :, 0] > 0.0)
