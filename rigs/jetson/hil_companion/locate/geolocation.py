"""Geolocation of boxes: range from depth or from the ground, then the position in the world by the camera's pose.

Depth    the middle of a box shows the object and its background. The object's depth is that of the nearest cluster:
         starting from the 25th percentile, three times the median of all depths within a tenth (0.6 m at least) of the
         last value. A twig in front, a few wrong pixels or metres of pixel noise change it little. If the object's own
         pixels are known (`looks.object_pixels`), only their depths count. The object's surface is `_FRONT_M` before
         its middle.
Ground   without depth: the intersection of the ray through the middle of the box's lower edge with level ground.
Radar    the strongest point in the direction of the box and, if the range is known, at about that range.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Mapping, Sequence

import cv2
import numpy as np

from hil_companion.errors import CutError
from hil_companion.locate.looks import ObjectPixels
from hil_companion.navigation.inertial import NavState
from hil_companion.navigation.rotation import matrix_of

# Standard deviation of a position along the view: a constant [m], and factors of the range and of its square, as the
# error of a stereo camera grows; and across it, due to box, lens and attitude.
_DEPTH_SIGMA, _GROUND_SIGMA = (0.1, 0.0, 0.0004), (0.5, 0.06, 0.0)
_ACROSS_SIGMA = (0.12, 0.004)
_ONE_PERSON_M, _PER_EXCESS = 2.1, 2.0
_BELOW_SHARE, _BELOW_PX = 0.15, 4.0  # height of the strip below a box that shows the ground
_MIDDLE_X, _MIDDLE_Y = (0.3, 0.7), (0.15, 0.75)  # part of the box that shows mostly the object
_NEAR_SHARE, _OWN_SHARE, _CLUSTER_SHARE, _CLUSTER_M, _ROUNDS = 0.25, 0.4, 0.1, 0.6, 3
_MIN_PIXELS, _OWN_PIXELS, _MAX_DEPTH_M = 4, 8, 1000.0
_ABOVE_FEET = 0.8  # upper part of the box
_FRONT_M = 0.15  # a person's surface is this much nearer than the middle
_EDGE_PX = 1.5  # a box that ends this near to the picture's lower edge does not show the object's lower end
_MIN_LEVEL = 0.35  # level part of a unit ray; in a steeper view the height of a box says little
_MIN_DOWN = 0.05  # downward component of a unit ray; with a flatter ray the range is too uncertain
_ANGLE_RAD, _RANGE_M, _RANGE_SHARE = 0.06, 1.0, 0.1  # tolerances of a radar point, besides half the box's angle

_FISHEYE = "equidistant"

Box = Sequence[float]


class Camera:
    """A calibrated camera on the vehicle, from `welcome.sensors[NAME]`. Raises CutError for an incomplete calibration.

    Boxes count pixels from the picture's edge, OpenCV's calibration from the middle of the first pixel, half a pixel
    less.
    """

    def __init__(self, name: str, calibration: Mapping[str, Any] | None) -> None:
        entries = calibration or {}
        try:
            self.size_px = (int(entries["width"]), int(entries["height"]))
            self._K = np.asarray(entries["camera_matrix"], float).reshape(3, 3)
            self.focal_px = float(self._K[1, 1])
            self._d = np.asarray(entries["coefficients"], float)
            self._fisheye = entries["distortion"] == _FISHEYE
            self.p_BC = np.asarray(entries["p_BC"], float).reshape(3)
            w, x, y, z = np.asarray(entries["q_BC"], float).tolist()
        except (KeyError, TypeError, ValueError) as error:
            raise CutError(
                f"detect: the bench sends no camera calibration of {name!r} ({error}); name a camera's topic"
            ) from None
        self.R_BC = matrix_of((w, x, y, z))

    def rays_C(self, points_px: Any) -> np.ndarray:
        """Return rays (n, 3) with z = 1 in C for pixels (n, 2); a ray times a planar depth is the point in C."""
        points = np.asarray(points_px, float).reshape(-1, 1, 2) - 0.5
        undistort = cv2.fisheye.undistortPoints if self._fisheye else cv2.undistortPoints
        flat = undistort(points, self._K, self._d).reshape(-1, 2)
        return np.column_stack([flat, np.ones(len(flat))])

    def pixels(self, points_C: Any) -> np.ndarray:
        """Return the pixels (n, 2) of points (n, 3) in C, which have to lie in front of the camera."""
        points = np.asarray(points_C, float).reshape(-1, 1, 3)
        project = cv2.fisheye.projectPoints if self._fisheye else cv2.projectPoints
        return np.asarray(project(points, np.zeros(3), np.zeros(3), self._K, self._d)[0]).reshape(-1, 2) + 0.5


def depth_in(depth_m: np.ndarray, box_px: Box, pixels: ObjectPixels | None = None) -> float | None:
    """Return the planar depth [m] of the object in the box; None if too few pixels have a depth."""
    if pixels is not None:
        upper = pixels.shown & _upper_rows(pixels, box_px)[:, np.newaxis]
        values = _valid(depth_m[pixels.rows, pixels.columns][upper])
        if len(values) >= _OWN_PIXELS:
            return _nearest_cluster(values, _OWN_SHARE)
    height, width = depth_m.shape[:2]
    x0, y0, x1, y1 = box_px
    left, right = (x0 + share * (x1 - x0) for share in _MIDDLE_X)
    top, bottom = (y0 + share * (y1 - y0) for share in _MIDDLE_Y)
    columns = slice(max(0, math.floor(left)), min(width, max(math.ceil(right), math.floor(left) + 2)))
    rows = slice(max(0, math.floor(top)), min(height, max(math.ceil(bottom), math.floor(top) + 2)))
    values = _valid(depth_m[rows, columns])
    return None if len(values) < _MIN_PIXELS else _nearest_cluster(values, _NEAR_SHARE)


def _upper_rows(pixels: ObjectPixels, box_px: Box) -> np.ndarray:
    """Return the rows of the box above the feet, beside which the ground is as near as the object."""
    y = np.arange(pixels.rows.start, pixels.rows.stop) + 0.5
    return y < box_px[1] + _ABOVE_FEET * (box_px[3] - box_px[1])


def _valid(depth_m: np.ndarray) -> np.ndarray:
    values = np.asarray(depth_m, float).ravel()
    return values[np.isfinite(values) & (values > 0.0) & (values < _MAX_DEPTH_M)]


def _nearest_cluster(values: np.ndarray, share: float) -> float:
    # The lower median is one of the depths; a mean could fall between two clusters, where no depth lies.
    values = np.sort(values)
    depth = float(values[int(share * (len(values) - 1))])
    for _ in range(_ROUNDS):
        cluster = values[np.abs(values - depth) <= max(_CLUSTER_M, _CLUSTER_SHARE * depth)]
        depth = float(cluster[(len(cluster) - 1) // 2])
    return depth


def ground_range(p_WC: np.ndarray, R_WC: np.ndarray, ray_C: np.ndarray, ground_z_m: float) -> float | None:
    """Return the distance along a ray to level ground [m]; None if the ray does not meet the ground."""
    ray_W = R_WC @ (ray_C / np.linalg.norm(ray_C))
    above_m = float(p_WC[2]) - ground_z_m
    if ray_W[2] > -_MIN_DOWN or above_m <= 0.0:
        return None
    return above_m / -float(ray_W[2])


def shows_feet(box_px: Box, height_px: int) -> bool:
    """Return True if the object's lower end is in the picture."""
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
    """Return the radial speed of the strongest radar point in the box [m/s, + receding]; None without such a point.

    `rays_C` (5, 3): through the box's middle and its four corners.
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
    """Points of a radar and its mounting pose on the vehicle."""

    points: Any
    p_BR: np.ndarray
    R_BR: np.ndarray


class Geolocation:
    """Locates detections of one camera in the world. `ground_z_m`: height of the ground, used without depth."""

    def __init__(self, camera: Camera, *, ground_z_m: float) -> None:
        self.camera = camera
        self._ground_z_m = ground_z_m

    def place(
        self,
        boxes: Sequence[Any],
        pose: NavState | None,
        depth_m: np.ndarray | None,
        radar: RadarView | None,
        pixels: Sequence[ObjectPixels | None] | None = None,
    ) -> list[Any]:
        """Return the same detections with range, speed and position, each None if it is unknown.

        `pixels`: for each box, the pixels that show its object.
        """
        own = [None] * len(boxes) if pixels is None else pixels
        return [self._placed(box, pose, depth_m, radar, shown) for box, shown in zip(boxes, own)]

    def covariance(
        self,
        p_W: Sequence[float],
        pose: NavState,
        own_sigma_m: float,
        yaw_sigma_rad: float,
        *,
        by_depth: bool,
        height_m: float | None = None,
    ) -> np.ndarray:
        """Return the covariance (2, 2) of a position's x and y [m2].

        Along the view it is that of the range, across that of the box, the heading and the vehicle's own position. A
        box higher than a person shows two, and its range may be that of either.
        """
        away = np.array(p_W[:2]) - np.array(pose.p[:2])
        range_m = max(float(np.linalg.norm(np.array(p_W) - np.array(pose.p))), 1e-3)
        fixed_m, share, square = _DEPTH_SIGMA if by_depth else _GROUND_SIGMA
        excess_m = 0.0 if height_m is None else _PER_EXCESS * max(0.0, height_m - _ONE_PERSON_M)
        along_m = math.hypot(fixed_m + share * range_m + square * range_m * range_m, own_sigma_m, excess_m)
        across_m = math.hypot(_ACROSS_SIGMA[0] + _ACROSS_SIGMA[1] * range_m, range_m * yaw_sigma_rad, own_sigma_m)
        unit = away / max(float(np.linalg.norm(away)), 1e-3)
        return across_m**2 * np.eye(2) + (along_m**2 - across_m**2) * np.outer(unit, unit)

    def height_m(self, box: Any, pose: NavState | None) -> float | None:
        """Return the height of a box's upright object; None without a position.

        The rays through the middles of the box's upper and lower edge, at the object's horizontal distance.
        """
        if box.p_W is None or pose is None:
            return None
        x0, y0, x1, y1 = box.box_px
        rays_W = (
            self.camera.rays_C([(0.5 * (x0 + x1), y0), (0.5 * (x0 + x1), y1)])
            @ (matrix_of(pose.q) @ self.camera.R_BC).T
        )
        p_WC = np.array(pose.p) + matrix_of(pose.q) @ self.camera.p_BC
        away_m = math.hypot(box.p_W[0] - p_WC[0], box.p_W[1] - p_WC[1])
        level = np.hypot(rays_W[:, 0], rays_W[:, 1])
        if level.min() < _MIN_LEVEL * np.linalg.norm(rays_W, axis=1).max():
            return None  # seen from above
        top_m, bottom_m = (away_m * rays_W[:, 2] / level).tolist()
        return float(top_m - bottom_m)

    def middle_m(self, box: Any, pose: NavState | None, depth_m: np.ndarray | None) -> float | None:
        """Return the height of an object's middle above the ground, the median of the points just below its box."""
        if box.p_W is None or pose is None or depth_m is None:
            return None
        x0, y0, x1, y1 = box.box_px
        height, width = depth_m.shape
        top, left = min(int(y1), height - 1), max(0, int(x0))
        rows = slice(top, min(height, int(y1 + max(_BELOW_PX, _BELOW_SHARE * (y1 - y0)))))
        below_m = depth_m[rows, left : min(width, int(x1) + 1)]
        ys, xs = np.nonzero(np.isfinite(below_m) & (below_m > 0.0))
        if len(ys) < _MIN_PIXELS:
            return None
        R_WB = matrix_of(pose.q)
        up_C = (R_WB @ self.camera.R_BC)[2]
        rays_C = self.camera.rays_C(np.column_stack([xs + left + 0.5, ys + top + 0.5]))
        above_m = (rays_C @ up_C) * below_m[ys, xs]
        ground_m = pose.p[2] + float((R_WB @ self.camera.p_BC)[2]) + float(np.median(above_m))
        return float(box.p_W[2] - ground_m)

    def _placed(
        self,
        box: Any,
        pose: NavState | None,
        depth_m: np.ndarray | None,
        radar: RadarView | None,
        shown: ObjectPixels | None,
    ) -> Any:
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
            z_m = depth_in(depth_m, box.box_px, shown)
            range_m = None if z_m is None else z_m * float(np.linalg.norm(ray))
        elif R_WC is not None and p_WC is not None and shows_feet(box.box_px, camera.size_px[1]):
            ray = rays[5]
            range_m = ground_range(p_WC, R_WC, ray, self._ground_z_m)
        p_W = None
        if range_m is not None and R_WC is not None and p_WC is not None:
            to_middle_m = range_m if depth_m is None else range_m + _FRONT_M
            x, y, z = (p_WC + R_WC @ (ray / np.linalg.norm(ray)) * to_middle_m).tolist()
            p_W = (x, y, z)
        speed = None
        if radar is not None:
            speed = radar_speed(radar.points, radar.p_BR, radar.R_BR, camera.p_BC, camera.R_BC, rays[:5], range_m)
        return replace(box, range_m=range_m, radial_speed_mps=speed, p_W=p_W)
