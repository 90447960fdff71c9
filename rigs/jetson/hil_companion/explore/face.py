"""What planning and steering need to know of where the vehicle is, whoever finds it out."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from hil_companion.explore.grid import GridView


class Estimate(Protocol):
    """Pose, velocity and map at one frame."""

    t_ns: int
    p_W: np.ndarray  # (3,) [m]
    v_W: np.ndarray  # (3,) [m/s]
    yaw_rad: float
    roll: float
    pitch: float
    covariance_xy: np.ndarray  # (2, 2) [m2]
    lidar_ok: bool
    imu_ok: bool  # roll and pitch are known
    grid: GridView


class Localiser(Protocol):
    """Called once with every frame, in order."""

    def update(self, frame: Any) -> Estimate: ...
