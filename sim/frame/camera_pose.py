"""Pose and velocity of a camera when it takes a picture."""

from __future__ import annotations

from dataclasses import dataclass

from signals.rotation import Rotation, applied_back
from signals.samples import Vec3


@dataclass(frozen=True)
class CameraPose:
    """Pose and velocity of the optical frame C in W."""

    p_WC: Vec3  # [m]
    R_WC: Rotation
    v_WC_W: Vec3 = (0.0, 0.0, 0.0)  # [m/s]
    w_WC_W: Vec3 = (0.0, 0.0, 0.0)  # [rad/s]

    def in_radar_frame(self, v_W: Vec3) -> Vec3:
        """Return a vector in R, the frame of a radar at the camera: x_R = z_C, y_R = -x_C, z_R = -y_C."""
        x, y, z = applied_back(self.R_WC, v_W)
        return (z, -x, -y)
