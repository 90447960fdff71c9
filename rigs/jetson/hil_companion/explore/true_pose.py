"""The true pose in place of SLAM, and a plain occupancy grid made with it: to try planning and flying alone.

    hil run rigs/explore.yaml --set companion.settings.localiser=truth

The grid is of what sweeps show within `slab_m` of the flight's height: cells in the polygon that the returns span are
free by one sweep more, those of the returns occupied by one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Mapping

import cv2
import numpy as np

from hil_companion.errors import CutError
from hil_companion.explore.grid import GridView
from hil_companion.explore.rotation import matrix_of, roll_pitch_yaw
from hil_companion.frame import Frame

_CELL_M = 0.25
_REACH_M = 40.0
_BEAMS = 720
_OPEN_M = 8.0  # free where no return says otherwise: below the horizon, beams leave the slab this far away
_LOST_NS = 350_000_000  # without a usable sweep for so long, the LiDAR is lost
_HIT, _MISS, _MOST = 0.9, -0.4, 5.0


@dataclass(frozen=True, eq=False)
class TrueEstimate:
    t_ns: int
    p_W: np.ndarray
    v_W: np.ndarray
    yaw_rad: float
    roll: float
    pitch: float
    covariance_xy: np.ndarray
    lidar_ok: bool
    grid: GridView
    imu_ok: bool = True


class TruePose:
    """`half_m`: the grid reaches so far from the origin."""

    def __init__(
        self,
        calibration: Mapping[str, Any] | None,
        height_m: float,
        *,
        slab_m: float = 1.0,
        half_m: float = 120.0,
        lidar: str = "lidar",
    ) -> None:
        told = calibration or {}
        self._lidar = lidar
        self._p_BL = np.asarray(told.get("p_BC", (0.0, 0.0, 0.0)), float)
        self._R_BL = matrix_of(told.get("q_BC", (1.0, 0.0, 0.0, 0.0)))
        self._height_m, self._slab_m = height_m, slab_m
        size = int(2 * half_m / _CELL_M)
        self._mapped_ns: int | None = None
        self._grid = GridView(np.zeros((size, size), np.float32), (-half_m, -half_m), _CELL_M, 0)

    def update(self, frame: Frame) -> TrueEstimate:
        if "truth" not in frame:
            raise CutError("explore: localiser 'truth' needs the topic truth; the bench sends none")
        truth = frame["truth"]
        p_W, v_W = np.asarray(truth["p_WB"], float), np.asarray(truth["v_WB_W"], float)
        R_WB = matrix_of(truth["q_WB"])
        roll, pitch, yaw = roll_pitch_yaw(R_WB)
        at_height = abs(p_W[2] - self._height_m) < self._slab_m
        if at_height and self._lidar in frame and self._map(frame, p_W, v_W, R_WB):
            self._mapped_ns = frame.t_ns
        ok = self._mapped_ns is not None and frame.t_ns - self._mapped_ns <= _LOST_NS
        return TrueEstimate(frame.t_ns, p_W, v_W, yaw, roll, pitch, np.eye(2) * 1e-4, ok, self._grid)

    def _map(self, frame: Frame, p_W: np.ndarray, v_W: np.ndarray, R_WB: np.ndarray) -> bool:
        sweep = frame[self._lidar]
        points = np.asarray(sweep["points_L"], float).reshape(-1, 3)
        offset_ns = np.asarray(sweep["time_offset_ns"], float).reshape(-1)
        good = np.isfinite(points).all(axis=1)
        if not good.any():
            return False
        points, offset_ns = points[good], offset_ns[good]
        ago_s = ((frame.t_ns - sweep.t_capture_ns) - offset_ns) * 1e-9
        points_W = (points @ self._R_BL.T + self._p_BL) @ R_WB.T + p_W - v_W * ago_s[:, None]
        d = points_W[:, :2] - p_W[:2]
        far = np.hypot(d[:, 0], d[:, 1])
        level = (np.abs(points_W[:, 2] - p_W[2]) < self._slab_m) & (far < _REACH_M)
        beam = np.floor((np.arctan2(d[:, 1], d[:, 0]) / (2.0 * math.pi) + 0.5) * _BEAMS).astype(int) % _BEAMS
        free_m = np.full(_BEAMS, _OPEN_M)
        for wanted, cap in ((~level, _OPEN_M), (level, _REACH_M)):
            nearest = np.full(_BEAMS, np.inf)
            np.minimum.at(nearest, beam[wanted], far[wanted])
            free_m = np.where(np.isfinite(nearest), np.minimum(nearest, cap), free_m)
        # A beam between two that met a wall met it too.
        free_m = np.minimum(free_m, np.minimum(np.roll(free_m, 1), np.roll(free_m, -1)))
        angle = ((np.arange(_BEAMS) + 0.5) / _BEAMS - 0.5) * 2.0 * math.pi
        edge = p_W[:2] + free_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        grid = self._grid
        corner = np.asarray(grid.origin_W)
        free = np.zeros(grid.log_odds.shape, np.uint8)
        cv2.fillPoly(free, [np.floor((edge - corner) / grid.cell_m).astype(np.int32)], 1)
        hit = np.zeros(grid.log_odds.shape, bool)
        cells = np.floor((points_W[level, :2] - corner) / grid.cell_m).astype(int)
        inside = ((cells >= 0) & (cells < grid.log_odds.shape[0])).all(axis=1)
        hit[cells[inside, 1], cells[inside, 0]] = True
        log_odds = grid.log_odds + np.where(hit, np.float32(_HIT), np.float32(_MISS) * free)
        self._grid = GridView(
            np.clip(log_odds, -_MOST, _MOST).astype(np.float32), grid.origin_W, grid.cell_m, grid.version + 1
        )
        return True
