"""What planning and steering need to know of where the vehicle is, whoever finds it out."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


class GridView(Protocol):
    """An occupancy grid: `log_odds[row, column]`, row along y, 0 where nothing is known, above 0 occupied."""

    log_odds: np.ndarray  # (H, W) float32
    origin_W: tuple[float, float]  # of the corner of cell (0, 0) [m]
    cell_m: float
    version: int  # another one for another content


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
    grid: GridView


class Localiser(Protocol):
    """Called once with every frame, in order."""

    def update(self, frame: Any) -> Estimate: ...
