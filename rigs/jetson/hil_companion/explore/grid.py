"""The occupancy grid as others see it: log-odds by cell, 0 where nothing is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

OCCUPIED, FREE = 0.8, -0.5  # log-odds beyond which a cell counts as one of them


@dataclass(frozen=True)
class GridView:
    """Rows go north (y), columns east (x). A copy of its own that no later update touches."""

    log_odds: np.ndarray  # (H, W) float32
    origin_W: tuple[float, float]  # x, y of the corner of cell (0, 0)
    cell_m: float
    version: int  # another one for another content

    @property
    def occupied(self) -> np.ndarray:
        return self.log_odds > OCCUPIED

    @property
    def free(self) -> np.ndarray:
        return self.log_odds < FREE

    @property
    def unknown(self) -> np.ndarray:
        return (self.log_odds <= OCCUPIED) & (self.log_odds >= FREE)

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a place; may lie outside."""
        return (
            int(np.floor((y - self.origin_W[1]) / self.cell_m)),
            int(np.floor((x - self.origin_W[0]) / self.cell_m)),
        )

    def centres(self, mask: np.ndarray) -> np.ndarray:
        """x, y (n, 2) of the middles of the cells of a mask."""
        rows, columns = np.nonzero(mask)
        xy: Any = np.stack([columns, rows], axis=-1)
        return (xy + 0.5) * self.cell_m + np.array(self.origin_W)


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
