"""Lens distortion, as defined in OpenCV, and its inverse.

With x = X/Z, y = Y/Z, r^2 = x^2 + y^2 and theta = atan2(sqrt(X^2 + Y^2), Z), a point has the distorted coordinates
(x', y'), and the pixel u = fx x' + cx, v = fy y' + cy.

    BrownConrady     x' = x g + 2 p1 x y + p2 (r^2 + 2 x^2)      (Brown 1966; rational terms: OpenCV's calib3d)
                     y' = y g + p1 (r^2 + 2 y^2) + 2 p2 x y
                     g = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
    KannalaBrandt    (x', y') = (X, Y) / sqrt(X^2 + Y^2) * theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
                     (Kannala and Brandt, IEEE TPAMI 28, 2006, eq. 6; OpenCV's fisheye)

The inverse has no closed form. A table of the radial part gives a first value, which Newton's method refines to 1e-12.
The models of real lenses fold back beyond some radius: there, two directions share a pixel. If this radius lies inside
the picture, the inverse does not exist, and `NotInvertible` holds the radius.

Only + - * / sqrt and comparisons are used, except in `KannalaBrandt.distort`, which calls the C library's atan2 but is
not used to render pictures.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels import sin_cos

Float64 = NDArray[np.float64]

TOLERANCE = 1e-12  # of x' and y', whose order of magnitude is 1
_NEWTON_STEPS = 30
_TABLE_SIZE = 8192
_MAX_ANGLE_RAD = 1.5698  # 89.94 degrees from the axis, the limit for a picture on a plane
_HALF_CIRCLE_RAD = 3.1415926535897931


class NotInvertible(ValueError):
    """Distortion for which two directions share a pixel. `radius`: sqrt(x'^2 + y'^2) beyond which they do."""

    def __init__(self, radius: float) -> None:
        self.radius = radius
        super().__init__(f"the distortion cannot be inverted beyond a radius of {radius:.6g} focal lengths")


class _RadialTable(NamedTuple):
    """Radial function up to the radius where it stops growing."""

    undistorted: Float64  # radius, or angle of a fisheye [rad]
    radius: Float64  # in the picture


@dataclass(frozen=True)
class BrownConrady:
    """Distortion with polynomial or rational radial terms and two tangential terms."""

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients in OpenCV's order: five, or eight with the rational terms."""
        values: tuple[float, ...] = astuple(self)
        return values if any(values[5:]) else values[:5]

    @property
    def ros_name(self) -> str:
        """Name of the model in sensor_msgs/CameraInfo."""
        return "rational_polynomial" if len(self.coefficients) == 8 else "plumb_bob"

    def distort(self, points_C: Float64) -> Float64:
        """Return x', y' (n, 2) of points in front of the camera (n, 3)."""
        x, y = points_C[:, 0] / points_C[:, 2], points_C[:, 1] / points_C[:, 2]
        distorted = self._distorted(x, y)
        return np.stack(distorted, axis=1)

    def radial(self, half_angle_rad: float) -> float:
        """Return the radius in the picture of a ray at this angle to the axis, without the tangential part.

        Raises NotInvertible if the picture folds back before that.
        """
        sine, cosine = _sine_cosine(np.linspace(0.0, half_angle_rad, _TABLE_SIZE))
        undistorted = sine / cosine
        return _last_if_growing(undistorted * self._gain(undistorted * undistorted))

    def undistort(self, distorted: Float64) -> Float64:
        """Return unit directions (n, 3) of x', y' (n, 2). Raises NotInvertible."""
        table = self._growing()
        radius = np.sqrt(distorted[:, 0] ** 2 + distorted[:, 1] ** 2)
        undistorted = np.interp(radius, table.radius, table.undistorted)
        scale = np.divide(undistorted, radius, out=np.ones_like(radius), where=radius > 0.0)
        x, y = distorted[:, 0] * scale, distorted[:, 1] * scale
        limit = float(table.undistorted[-1])
        for _ in range(_NEWTON_STEPS):
            fx, fy = self._distorted(x, y)
            ex, ey = fx - distorted[:, 0], fy - distorted[:, 1]
            if max(np.abs(ex).max(initial=0.0), np.abs(ey).max(initial=0.0)) <= TOLERANCE:
                break
            a, b, c, d = self._jacobian(x, y)
            det = a * d - b * c
            det = np.where(np.abs(det) < 1e-9, 1e-9, det)
            x, y = x - (d * ex - b * ey) / det, y - (a * ey - c * ex) / det
            # A step past the last radius of the table would find the wrong branch.
            r = np.sqrt(x * x + y * y)
            shrink = np.where(r > limit, limit / np.where(r > 0.0, r, 1.0), 1.0)
            x, y = x * shrink, y * shrink
        fx, fy = self._distorted(x, y)
        a, b, c, d = self._jacobian(x, y)
        undistorted = np.sqrt(x * x + y * y)
        good = np.abs(fx - distorted[:, 0]) <= 1e3 * TOLERANCE
        good &= np.abs(fy - distorted[:, 1]) <= 1e3 * TOLERANCE
        good &= (a * d - b * c > 0.0) & (undistorted < limit)
        if not good.all():
            raise NotInvertible(float(radius[~good].min()))
        length = np.sqrt(x * x + y * y + 1.0)
        return np.stack([x / length, y / length, 1.0 / length], axis=1)

    def _gain(self, r2: Float64) -> Float64:
        numerator = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        denominator = 1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6))
        return np.asarray(numerator / denominator)

    def _distorted(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        r2 = x * x + y * y
        g = self._gain(r2)
        return (
            x * g + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * g + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )

    def _jacobian(self, x: Float64, y: Float64) -> tuple[Float64, Float64, Float64, Float64]:
        r2 = x * x + y * y
        numerator = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        denominator = 1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6))
        d_numerator = self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3)
        d_denominator = self.k4 + r2 * (2.0 * self.k5 + r2 * 3.0 * self.k6)
        g = numerator / denominator
        slope = (
            2.0 * (d_numerator * denominator - numerator * d_denominator) / (denominator * denominator)
        )  # dg/d(r2) * 2
        p1, p2 = self.p1, self.p2
        cross = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        return (
            g + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            g + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        )

    def _growing(self) -> _RadialTable:
        sine, cosine = _sine_cosine(np.linspace(0.0, _MAX_ANGLE_RAD, _TABLE_SIZE))
        undistorted = sine / cosine
        return _while_growing(undistorted, undistorted * self._gain(undistorted * undistorted))


@dataclass(frozen=True)
class KannalaBrandt:
    """Fisheye distortion: a polynomial of the angle to the axis."""

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients in OpenCV's order."""
        values: tuple[float, ...] = astuple(self)
        return values

    @property
    def ros_name(self) -> str:
        """Name of the model in sensor_msgs/CameraInfo."""
        return "equidistant"

    def distort(self, points_C: Float64) -> Float64:
        """Return x', y' (n, 2) of points in any direction (n, 3)."""
        across = np.sqrt(points_C[:, 0] ** 2 + points_C[:, 1] ** 2)
        radius = self._radius(np.arctan2(across, points_C[:, 2]))
        scale = np.divide(radius, across, out=np.zeros_like(across), where=across > 0.0)
        return points_C[:, :2] * scale[:, None]

    def radial(self, half_angle_rad: float) -> float:
        """Return the radius of a ray at this angle to the axis. Raises NotInvertible beyond the growing part."""
        return _last_if_growing(self._radius(np.linspace(0.0, half_angle_rad, _TABLE_SIZE)))

    def undistort(self, distorted: Float64) -> Float64:
        """Return unit directions (n, 3) of x', y' (n, 2). Raises NotInvertible."""
        angles = np.linspace(0.0, _HALF_CIRCLE_RAD, _TABLE_SIZE)
        table = _while_growing(angles, self._radius(angles))
        radius = np.sqrt(distorted[:, 0] ** 2 + distorted[:, 1] ** 2)
        limit = float(table.undistorted[-1])
        theta = np.interp(radius, table.radius, table.undistorted)
        for _ in range(_NEWTON_STEPS):
            error = self._radius(theta) - radius
            if np.abs(error).max(initial=0.0) <= TOLERANCE:
                break
            slope = self._slope(theta)
            theta = np.clip(theta - error / np.where(np.abs(slope) < 1e-9, 1e-9, slope), 0.0, limit)
        good = (np.abs(self._radius(theta) - radius) <= 1e3 * TOLERANCE) & (self._slope(theta) > 0.0)
        if not good.all():
            raise NotInvertible(float(radius[~good].min()))
        sine, cosine = _sine_cosine(theta)
        scale = np.divide(sine, radius, out=np.ones_like(radius), where=radius > 0.0)
        return np.stack([distorted[:, 0] * scale, distorted[:, 1] * scale, cosine], axis=1)

    def _radius(self, theta: Float64) -> Float64:
        t2 = theta * theta
        return np.asarray(theta * (1.0 + t2 * (self.k1 + t2 * (self.k2 + t2 * (self.k3 + t2 * self.k4)))))

    def _slope(self, theta: Float64) -> Float64:
        t2 = theta * theta
        return np.asarray(1.0 + t2 * (3.0 * self.k1 + t2 * (5.0 * self.k2 + t2 * (7.0 * self.k3 + t2 * 9.0 * self.k4))))


Distortion = BrownConrady | KannalaBrandt


def _while_growing(undistorted: Float64, radius: Float64) -> _RadialTable:
    """Return the part of the table before the radius first stops growing or is not finite."""
    grows = np.diff(radius) > 0.0
    last = len(grows) if grows.all() else int(np.argmin(grows))
    return _RadialTable(undistorted[: last + 1], radius[: last + 1])


def _last_if_growing(radius: Float64) -> float:
    if not np.all(np.diff(radius) > 0.0):
        raise NotInvertible(float(radius.max()))
    return float(radius[-1])


def _sine_cosine(angle_rad: Float64) -> tuple[Float64, Float64]:
    sine, cosine = np.empty_like(angle_rad), np.empty_like(angle_rad)
    sin_cos(np.ascontiguousarray(angle_rad), sine, cosine)
    return sine, cosine
