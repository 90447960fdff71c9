"""A camera by its calibration, as the bench tells it: from pixels to rays, and where it sits on the vehicle.

Boxes count pixels from the picture's edge, OpenCV's calibration from the middle of the first pixel: half a pixel less.
"""

from __future__ import annotations

from typing import Any, Mapping

import cv2
import numpy as np

from hil_companion.errors import CutError
from hil_companion.explore.rotation import matrix_of

_FISHEYE = "equidistant"


class Camera:
    """From `welcome.sensors[NAME]`. CutError where that is no camera."""

    def __init__(self, name: str, calibration: Mapping[str, Any] | None) -> None:
        told = calibration or {}
        try:
            self.size_px = (int(told["width"]), int(told["height"]))
            self._K = np.asarray(told["camera_matrix"], float).reshape(3, 3)
            self._d = np.asarray(told["coefficients"], float)
            self._fisheye = told["distortion"] == _FISHEYE
            self.p_BC = np.asarray(told["p_BC"], float).reshape(3)
            w, x, y, z = np.asarray(told["q_BC"], float).tolist()
        except (KeyError, TypeError, ValueError) as error:
            raise CutError(
                f"detect: the bench says nothing of a camera {name!r} ({error}); name a camera's topic"
            ) from None
        self.R_BC = matrix_of((w, x, y, z))

    def rays_C(self, points_px: Any) -> np.ndarray:
        """(n, 3) with z = 1 for (n, 2) places in the picture: times a depth, the point in C."""
        points = np.asarray(points_px, float).reshape(-1, 1, 2) - 0.5
        undistort = cv2.fisheye.undistortPoints if self._fisheye else cv2.undistortPoints
        flat = undistort(points, self._K, self._d).reshape(-1, 2)
        return np.column_stack([flat, np.ones(len(flat))])

    def pixels(self, points_C: Any) -> np.ndarray:
        """(n, 2) places in the picture of points in C, which have to lie before the camera."""
        points = np.asarray(points_C, float).reshape(-1, 1, 3)
        project = cv2.fisheye.projectPoints if self._fisheye else cv2.projectPoints
        return np.asarray(project(points, np.zeros(3), np.zeros(3), self._K, self._d)[0]).reshape(-1, 2) + 0.5
