"""Rotation from body to world."""

from __future__ import annotations

from hil.signals.samples import Quat, Vec3
from sim._kernels import rotate_into_body


def rotate_into_world(q_WB: Quat, v_B: Vec3) -> Vec3:
    """R(q_WB) v_B for a unit quaternion: the inverse rotation by the conjugate."""
    w, x, y, z = q_WB
    return rotate_into_body((w, -x, -y, -z), v_B)
