"""Turns of whole series from NED and FRD, in which PX4 and ArduPilot log, to ENU and FLU.

signals/frames.py has the same maps for one sample, and their derivation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float64]

_SQRT_HALF = 0.70710678118654752440


def enu_from_ned(rows: Rows) -> Rows:
    """Return vectors [n, 3] of the world in ENU: (y, x, -z)."""
    return np.stack([rows[:, 1], rows[:, 0], -rows[:, 2]], axis=1)


def flu_from_frd(rows: Rows) -> Rows:
    """Return vectors [n, 3] of the body in FLU: (x, -y, -z)."""
    return rows * np.array([1.0, -1.0, -1.0])


def q_WB_from_q_NF(q_NF: Rows) -> Rows:
    """Return attitudes FLU->ENU [n, 4] of attitudes FRD->NED, w-x-y-z. The map is its own inverse."""
    w, x, y, z = q_NF.T
    return _SQRT_HALF * np.stack([w + z, x + y, x - y, w - z], axis=1)


def quaternion_of_euler(roll_pitch_yaw_rad: Rows) -> Rows:
    """Return quaternions w-x-y-z [n, 4] of angles [n, 3], intrinsic z-y'-x''."""
    half = 0.5 * roll_pitch_yaw_rad
    (cr, cp, cy), (sr, sp, sy) = np.cos(half).T, np.sin(half).T
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=1,
    )
