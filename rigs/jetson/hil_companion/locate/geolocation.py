"""Boxes to places: range from depth or from the ground, then from the camera's estimated pose into the world.

Depth    the box's middle shows the thing and what is behind it. Sought is the nearest heap of depths: from the 25th
         percentile on, three times the median of what lies within a tenth of the last (0.6 m at least). A twig before
         it, a few wrong pixels, or noise of metres from pixel to pixel move that little.
Ground   without depth: where the ray through the middle of the box's lower edge meets the ground, taken for level.
Radar    points in the direction of the box, and about as far away where that is known; the strongest of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Mapping, Sequence

import cv2
import numpy as np

from hil_companion.errors import CutError
from hil_companion.explore.inertial import Moment
from hil_companion.explore.rotation import matrix_of

# Of a place, besides the vehicle's own: what box, lens and attitude leave open [m, and share of the range].
_DEPTH_SIGMA, _GROUND_SIGMA = (0.25, 0.025), (0.5, 0.06)
_MIDDLE_X, _MIDDLE_Y = (0.3, 0.7), (0.15, 0.75)  # of the box: where the thing is, rather than what is beside it
_NEAR_SHARE, _HEAP_SHARE, _HEAP_M, _ROUNDS = 0.25, 0.1, 0.6, 3
_LEAST_PIXELS, _MOST_M = 4, 1000.0
_EDGE_PX = 1.5  # a box that ends so near to the picture's lower edge shows no feet
_LEAST_DOWN = 0.05  # of a ray of length 1: flatter ones meet the ground anywhere
_ANGLE_RAD, _RANGE_M, _RANGE_SHARE = 0.06, 1.0, 0.1  # how far a radar point may be off, besides the box's own half

_FISHEYE = "equidistant"

Box = Sequence[float]


class Camera:
    """By its calibration, `welcome.sensors[NAME]`: from pixels to rays, and where it sits. CutError where that is none.

    Boxes count pixels from the picture's edge, OpenCV's calibration from the middle of the first pixel: half a pixel
    less.
    """

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


def depth_in(depth_m: np.ndarray, box_px: Box) -> float | None:
    """Planar depth of what is in the box [m]; None where too few pixels have one."""
    height, width = depth_m.shape[:2]
    x0, y0, x1, y1 = box_px
    left, right = (x0 + share * (x1 - x0) for share in _MIDDLE_X)
    top, bottom = (y0 + share * (y1 - y0) for share in _MIDDLE_Y)
    columns = slice(max(0, math.floor(left)), min(width, max(math.ceil(right), math.floor(left) + 2)))
    rows = slice(max(0, math.floor(top)), min(height, max(math.ceil(bottom), math.floor(top) + 2)))
    values = np.asarray(depth_m[rows, columns], float).ravel()
    values = values[np.isfinite(values) & (values > 0.0) & (values < _MOST_M)]
    if len(values) < _LEAST_PIXELS:
        return None
    # Always one of the values themselves: between two heaps there may be nothing near.
    values.sort()
    depth = float(values[int(_NEAR_SHARE * (len(values) - 1))])
    for _ in range(_ROUNDS):
        heap = values[np.abs(values - depth) <= max(_HEAP_M, _HEAP_SHARE * depth)]
        depth = float(heap[(len(heap) - 1) // 2])
    return depth


def ground_range(p_WC: np.ndarray, R_WC: np.ndarray, ray_C: np.ndarray, ground_z_m: float) -> float | None:
    """Along the ray to level ground [m]; None where it does not meet it."""
    ray_W = R_WC @ (ray_C / np.linalg.norm(ray_C))
    above_m = float(p_WC[2]) - ground_z_m
    if ray_W[2] > -_LEAST_DOWN or above_m <= 0.0:
        return None
    return above_m / -float(ray_W[2])


def shows_feet(box_px: Box, height_px: int) -> bool:
    """Whether the thing's lower end is in the picture."""
    return box_px[3] < height_px - _EDGE_PX


def radar_speed(
    points: Any,
    p_BR: np.ndarray,
    R_BR: np.ndarray,
    p_BC: np.ndarray,
    R_BC: np.ndarray,
    rays_C: np.ndarray,
    range_m: float | None,
) -> float | None:
    """Radial speed of the strongest radar point in the box [m/s, + receding]; None where there is none.

    `rays_C`: through the box's middle, and through its corners.
    """
    p_R = np.column_stack([np.asarray(points[name], float) for name in ("x_R", "y_R", "z_R")])
    snr_db, speed = np.asarray(points["snr_db"], float), np.asarray(points["speed_mps"], float)
    good = np.isfinite(p_R).all(axis=1) & np.isfinite(snr_db) & np.isfinite(speed)
    if not good.any():
        return None
    p_C = (p_R[good] @ R_BR.T + p_BR - p_BC) @ R_BC
    away_m = np.linalg.norm(p_C, axis=1)
    unit = p_C / np.maximum(away_m, 1e-9)[:, None]
    rays = rays_C / np.linalg.norm(rays_C, axis=1, keepdims=True)
    half_rad = float(np.arccos(np.clip(rays[1:] @ rays[0], -1.0, 1.0)).max())
    fits = np.arccos(np.clip(unit @ rays[0], -1.0, 1.0)) <= half_rad + _ANGLE_RAD
    if range_m is not None:
        fits &= np.abs(away_m - range_m) <= _RANGE_M + _RANGE_SHARE * range_m
    if not fits.any():
        return None
    best = int(np.flatnonzero(fits)[np.argmax(snr_db[good][fits])])
    return float(speed[good][best])


@dataclass(frozen=True)
class RadarView:
    """Points of a radar, and where it sits on the vehicle."""

    points: Any
    p_BR: np.ndarray
    R_BR: np.ndarray


class Geolocation:
    """For one camera. `ground_z_m`: height of the ground, where there is no depth."""

    def __init__(self, camera: Camera, *, ground_z_m: float) -> None:
        self.camera = camera
        self._ground_z_m = ground_z_m

    def place(
        self, boxes: Sequence[Any], pose: Moment | None, depth_m: np.ndarray | None, radar: RadarView | None
    ) -> list[Any]:
        """The same detections with range, speed and place, as far as these can be known."""
        return [self._placed(box, pose, depth_m, radar) for box in boxes]

    def sigma_m(self, range_m: float, own_sigma_m: float, *, by_depth: bool) -> float:
        """Of a place, horizontally, an axis."""
        fixed_m, share = _DEPTH_SIGMA if by_depth else _GROUND_SIGMA
        return float(np.hypot(fixed_m + share * range_m, own_sigma_m))

    def _placed(self, box: Any, pose: Moment | None, depth_m: np.ndarray | None, radar: RadarView | None) -> Any:
        camera = self.camera
        x0, y0, x1, y1 = box.box_px
        middle, foot = (0.5 * (x0 + x1), 0.5 * (y0 + y1)), (0.5 * (x0 + x1), y1)
        rays = camera.rays_C([middle, (x0, y0), (x1, y0), (x0, y1), (x1, y1), foot])
        R_WC = p_WC = None
        if pose is not None:
            R_WB = matrix_of(pose.q)
            R_WC, p_WC = R_WB @ camera.R_BC, np.array(pose.p) + R_WB @ camera.p_BC
        range_m, ray = None, rays[0]
        if depth_m is not None:
            z_m = depth_in(depth_m, box.box_px)
            range_m = None if z_m is None else z_m * float(np.linalg.norm(ray))
        elif R_WC is not None and p_WC is not None and shows_feet(box.box_px, camera.size_px[1]):
            ray = rays[5]
            range_m = ground_range(p_WC, R_WC, ray, self._ground_z_m)
        p_W = None
        if range_m is not None and R_WC is not None and p_WC is not None:
            x, y, z = (p_WC + R_WC @ (ray / np.linalg.norm(ray)) * range_m).tolist()
            p_W = (x, y, z)
        speed = None
        if radar is not None:
            speed = radar_speed(radar.points, radar.p_BR, radar.R_BR, camera.p_BC, camera.R_BC, rays[:5], range_m)
        return replace(box, range_m=range_m, radial_speed_mps=speed, p_W=p_W)
