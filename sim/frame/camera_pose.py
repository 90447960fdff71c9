"""Where a camera is and how it moves, when it takes a picture."""

from __future__ import annotations

from dataclasses import dataclass

from hil.signals.samples import Quat, Vec3

Rotation = tuple[float, float, float, float, float, float, float, float, float]  # row by row


@dataclass(frozen=True)
class CameraPose:
    """Pose and velocity of the optical frame C in W."""

    p_WC: Vec3  # [m]
    R_WC: Rotation
    v_WC_W: Vec3 = (0.0, 0.0, 0.0)  # [m/s]
    w_WC_W: Vec3 = (0.0, 0.0, 0.0)  # [rad/s]


def rotation_of(q: Quat) -> Rotation:
    """Rotation matrix of a unit quaternion."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


def product(a: Quat, b: Quat) -> Quat:
    """Hamilton product: first b, then a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def turned(R: Rotation, v: Vec3) -> Vec3:
    """R v."""
    x, y, z = v
    return (R[0] * x + R[1] * y + R[2] * z, R[3] * x + R[4] * y + R[5] * z, R[6] * x + R[7] * y + R[8] * z)


def cross(a: Vec3, b: Vec3) -> Vec3:
    """a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
