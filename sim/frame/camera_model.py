"""Camera model: directions of pixels, and pixels of points.

    u = fx x' + cx,   v = fy y' + cy       x' = X/Z, y' = Y/Z of a point in C, distorted (sim/frame/distortion.py)

Camera frame C is the optical frame: x right, y down, z along the view. Inside the bench pixel (column i, row j) has its
centre at (i + 0.5, j + 0.5), so the picture covers [0, width] x [0, height]. OpenCV, ROS and Kalibr put the centre at
(i, j): values in files follow their convention, half a pixel less (`from_opencv`, `opencv_matrix`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_sin
from signals.units import RAD_PER_DEG
from sim.frame.distortion import BrownConrady, Distortion, KannalaBrandt, NotInvertible

Float64 = NDArray[np.float64]

MAX_PIXELS_ACROSS = 8192
MAX_FISHEYE_FOV_DEG = 220.0
_HALF = 0.5  # of a pixel, from OpenCV's pixel centres to this bench's
_BLOCK_PIXELS = 1 << 20


@dataclass(frozen=True)
class CameraModel:
    """Intrinsics and distortion of one camera. Raises ValueError for values that no camera can have."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float  # in this bench's pixel coordinates
    cy: float
    distortion: Distortion | None = None

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self, name)
            if not 1 <= value <= MAX_PIXELS_ACROSS:
                raise ValueError(f"the {name} must be 1 to {MAX_PIXELS_ACROSS} pixels, not {value}")
        for name in ("fx", "fy"):
            value = getattr(self, name)
            if not 1e-3 <= value <= 1e7:
                raise ValueError(f"the focal length {name} must be 0.001 to 1e7 pixels, not {value:g}")

    @classmethod
    def from_fov(cls, width: int, height: int, fov_deg: float, distortion: Distortion | None = None) -> CameraModel:
        """Return a camera with square pixels and a centred axis, given by its horizontal field of view.

        `fov_deg` is the angle between the rays at the middles of the left and right edges, with the radial part of the
        distortion.
        """
        max_deg = MAX_FISHEYE_FOV_DEG if isinstance(distortion, KannalaBrandt) else 180.0
        allowed = fov_deg <= max_deg if isinstance(distortion, KannalaBrandt) else fov_deg < max_deg
        if not (fov_deg > 0.0 and allowed):
            kind = "a fisheye" if isinstance(distortion, KannalaBrandt) else "a camera without fisheye distortion"
            raise ValueError(f"the field of view of {kind} must lie between 0 and {max_deg:g} degrees, not {fov_deg:g}")
        half_rad = 0.5 * fov_deg * RAD_PER_DEG
        try:
            edge = det_sin(half_rad) / det_cos(half_rad) if distortion is None else distortion.radial(half_rad)
        except NotInvertible as error:
            raise ValueError(
                f"the distortion turns back before a field of view of {fov_deg:g} degrees: two directions share a pixel"
            ) from error
        f = 0.5 * width / edge
        return cls(width, height, f, f, 0.5 * width, 0.5 * height, distortion)

    @classmethod
    def from_opencv(
        cls, width: int, height: int, fx: float, fy: float, cx: float, cy: float, distortion: Distortion | None = None
    ) -> CameraModel:
        """Return a camera by its calibration in OpenCV, ROS or Kalibr (pixel centres at whole numbers)."""
        return cls(width, height, fx, fy, cx + _HALF, cy + _HALF, distortion)

    @property
    def pinhole(self) -> bool:
        """True without distortion, or if all its coefficients are zero."""
        d = self.distortion
        return d is None or (isinstance(d, BrownConrady) and not any(d.coefficients))

    @property
    def opencv_matrix(self) -> tuple[float, ...]:
        """Camera matrix K, row by row, with OpenCV's pixel centres."""
        return (self.fx, 0.0, self.cx - _HALF, 0.0, self.fy, self.cy - _HALF, 0.0, 0.0, 1.0)

    def scaled(self, factor: int) -> CameraModel:
        """Return the same view with `factor` times the width and height in pixels."""
        f = float(factor)
        size = (factor * self.width, factor * self.height)
        return CameraModel(*size, f * self.fx, f * self.fy, f * self.cx, f * self.cy, self.distortion)

    def rays(self) -> Float64:
        """Return unit directions in C of the pixel centres, (height, width, 3).

        Raises ValueError if the distortion cannot be inverted everywhere in the picture.
        """
        x = (np.arange(self.width) + (_HALF - self.cx)) / self.fx
        y = (np.arange(self.height) + (_HALF - self.cy)) / self.fy
        rays = np.empty((self.height, self.width, 3))
        step = max(1, _BLOCK_PIXELS // self.width)  # limits the memory for large pictures
        for first in range(0, self.height, step):
            block = rays[first : first + step]
            distorted = np.stack(np.meshgrid(x, y[first : first + step]), axis=-1).reshape(-1, 2)
            block[:] = self.directions(distorted).reshape(block.shape)
        return rays

    def directions(self, distorted: Float64) -> Float64:
        """Return unit directions in C (n, 3) of x', y' (n, 2). Raises ValueError as `rays` does."""
        d = self.distortion
        if d is None or self.pinhole:
            length = np.sqrt(distorted[:, 0] ** 2 + distorted[:, 1] ** 2 + 1.0)
            return np.stack([distorted[:, 0] / length, distorted[:, 1] / length, 1.0 / length], axis=1)
        try:
            return d.undistort(distorted)
        except NotInvertible as error:
            pixels = error.radius * min(self.fx, self.fy)
            raise ValueError(
                f"the distortion cannot be inverted inside the picture: from {pixels:.0f} pixels off the axis on, two "
                "directions share a pixel. Use a smaller picture or field of view, or check the coefficients"
            ) from error

    def project(self, points_C: Float64) -> Float64:
        """Return pixel coordinates (n, 2) of points in C (n, 3); NaN behind a camera that is not a fisheye."""
        points = np.asarray(points_C, np.float64).reshape(-1, 3)
        d = self.distortion
        if isinstance(d, KannalaBrandt):
            distorted = d.distort(points)
        else:
            points = np.where(points[:, 2:] > 0.0, points, np.nan)
            distorted = points[:, :2] / points[:, 2:] if d is None else d.distort(points)
        return distorted * (self.fx, self.fy) + (self.cx, self.cy)
