"""Rotations as 3x3 arrays and unit quaternions w-x-y-z."""

from __future__ import annotations

import math
from typing import Any, TypeVar

import numpy as np


def matrix_of(q: Any) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a unit quaternion; (3, 3, n) for components (4, n)."""
    w, x, y, z = q
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def turned(q: tuple[float, float, float, float], x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return q exp((x, y, z) / 2), normalised: the attitude after a turn (x, y, z) [rad] in its own frame."""
    angle = math.sqrt(x * x + y * y + z * z)
    s = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    c, x, y, z = math.cos(0.5 * angle), x * s, y * s, z * s
    w, a, b, d = q
    r = (w * c - a * x - b * y - d * z, w * x + a * c + b * z - d * y,
         w * y - a * z + b * c + d * x, w * z + a * y - b * x + d * c)  # fmt: skip
    n = 1.0 / math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3])
    return r[0] * n, r[1] * n, r[2] * n, r[3] * n


def product(
    a: tuple[float, float, float, float], b: tuple[float, float, float, float]
) -> tuple[float, float, float, float]:
    """Return the quaternion product a b."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def roll_pitch_yaw(R: np.ndarray) -> tuple[float, float, float]:
    """Return the angles [rad] of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = math.asin(max(-1.0, min(1.0, -float(R[2, 0]))))
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])


def quaternion_of(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion of Rz(yaw) Ry(pitch) Rx(roll)."""
    q = (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))
    return turned(turned(q, 0.0, pitch, 0.0), roll, 0.0, 0.0)


Angle = TypeVar("Angle", float, np.ndarray)


def wrapped(angle: Angle) -> Angle:
    """Return the angle within -pi .. pi."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def skew(v: np.ndarray) -> np.ndarray:
    """Return the matrix of the cross product with v."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
