"""Vectors of three, unit quaternions w-x-y-z and rotation matrices (nine numbers, row by row).

    q_WC = product(q_WB, q_BC)        v_W = R_WB v_B,  R_WB = matrix_of(q_WB)

Components are numbers or arrays of one shape; a function then works on all elements at once, with the same operations
in the same order. `signals._kernel` rotates vectors by quaternions and returns angles.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import sqrt
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_atan2
from signals.samples import Quat, Vec3

T = TypeVar("T", float, NDArray[np.float64])

Rotation = tuple[float, float, float, float, float, float, float, float, float]
NO_TURN: Quat = (1.0, 0.0, 0.0, 0.0)


def product(a: Iterable[T], b: Iterable[T]) -> tuple[T, T, T, T]:
    """Return the Hamilton product: rotation b first, then a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: Quat) -> Quat:
    """Return the inverse rotation."""
    return (q[0], -q[1], -q[2], -q[3])


def matrix_of(q: Iterable[T]) -> tuple[T, T, T, T, T, T, T, T, T]:
    """Return the rotation matrix of a unit quaternion."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


def applied(R: Sequence[float], v: Iterable[T]) -> tuple[T, T, T]:
    """Return R v; `R` is nine numbers."""
    x, y, z = v
    return (R[0] * x + R[1] * y + R[2] * z, R[3] * x + R[4] * y + R[5] * z, R[6] * x + R[7] * y + R[8] * z)


def applied_back(R: Sequence[float], v: Iterable[T]) -> tuple[T, T, T]:
    """Return R^T v; `R` is nine numbers."""
    x, y, z = v
    return (R[0] * x + R[3] * y + R[6] * z, R[1] * x + R[4] * y + R[7] * z, R[2] * x + R[5] * y + R[8] * z)


def applied_to_rows(R: NDArray[np.float64], rows: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return R v of vectors (..., 3); `R` is (3, 3), or (n, 3, 3) for n vectors.

    Sums are written out: their order in a matrix product depends on the machine.
    """
    return (R[..., 0] * rows[..., :1] + R[..., 1] * rows[..., 1:2]) + R[..., 2] * rows[..., 2:]


def cos_tilt_of(q_WB: Quat) -> float:
    """Return the cosine of the tilt: the z component in W of the z axis of B."""
    return 1.0 - 2.0 * (q_WB[1] * q_WB[1] + q_WB[2] * q_WB[2])


def cos_nose_up_of(q_WB: Quat) -> float:
    """Return the sine of the nose's elevation: the z component in W of the x axis of B."""
    return 2.0 * (q_WB[1] * q_WB[3] - q_WB[0] * q_WB[2])


def yaw_of(q: Quat) -> float:
    """Return the heading of the x axis, from the first axis towards the second [rad]."""
    w, x, y, z = q
    return det_atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def minus(a: Vec3, b: Vec3) -> Vec3:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def dot(a: Iterable[T], b: Iterable[T]) -> T:
    """Return a . b."""
    (ax, ay, az), (bx, by, bz) = a, b
    return ax * bx + ay * by + az * bz


def cross(a: Iterable[T], b: Iterable[T]) -> tuple[T, T, T]:
    """Return a x b."""
    (ax, ay, az), (bx, by, bz) = a, b
    return (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def norm(a: Vec3) -> float:
    """Return |a|."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def quaternion_norm(q: Quat) -> float:
    """Return |q|."""
    w, x, y, z = q
    return sqrt(w * w + x * x + y * y + z * z)


def unit(a: Vec3) -> Vec3:
    """Return a / |a|; +z for a vector without a direction."""
    length = norm(a)
    return (a[0] / length, a[1] / length, a[2] / length) if length > 1e-9 else (0.0, 0.0, 1.0)
