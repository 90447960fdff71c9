"""Pose and velocity of a camera when it takes a picture."""

from __future__ import annotations

from dataclasses import dataclass

from signals.rotation import Rotation
from signals.samples import Vec3


@dataclass(frozen=True)
class CameraPose:
    """Pose and velocity of the optical frame C in W."""

    p_WC: Vec3  # [m]
    R_WC: Rotation
    v_WC_W: Vec3 = (0.0, 0.0, 0.0)  # [m/s]
    w_WC_W: Vec3 = (0.0, 0.0, 0.0)  # [rad/s]
