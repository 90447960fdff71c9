"""What is near, and whether LiDAR and IMU can be flown by: age of the newest sweep, time without roll and pitch.

Without a fresh sweep, or not knowing what is level, the vehicle brakes; without for long the flight is over.

What the newest sweep shows at the height of the flight, straightened: nothing between the LiDAR and a stop but this.

A point fired `time_offset_ns` before the capture lay at its place as seen from where the vehicle was then:

    p_W = p_now - v (t_now - t_fired) + R(yaw - r (t_now - t_fired), pitch, roll) p_B

Points that are not finite, lie in the LiDAR itself (a range of zero) or beside where their ring looks (a negative one)
are left out. A sweep without any others is no sweep.

What came too near to be seen any more (the lowest ring passes over people's heads) is remembered for `_KEPT_S` where it
was; what the newest sweep could see is forgotten, since it tells.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Mapping

import numpy as np

from hil_companion.explore.outcome import IMU_LOST, LIDAR_LOST
from hil_companion.explore.rotation import matrix_of, quaternion_of
from hil_companion.explore.settings import FlightSettings
from hil_companion.explore.slam import SlamEstimate
from hil_companion.explore.sweep import FreshSweeps, on_ring
from hil_companion.frame import Frame, Sample

_LEAST_M = 0.1  # of a range
_KEPT_S = 2.0
_NEAR_M = 4.0
_CELL_M = 0.1
_SPARE = 0.02  # of slope
_LOWEST_SHARE = 1.0  # per cent of the returns that may lie lower than the lowest ring
_FEWEST_POINTS = 20  # of a sweep that shows anything
_STALE_SWEEP_S = 0.35


class BlindSpot:
    """What a LiDAR saw and cannot see any more. `unseen` once for each sweep, in order."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, np.ndarray]] = deque()

    def unseen(self, t_ns: int, eye_W: np.ndarray, points_W: np.ndarray, level_W: np.ndarray) -> np.ndarray:
        """x and y (n, 2) of what is remembered. `eye_W`: the LiDAR; `points_W` (n, 3): the sweep; `level_W` (n, 3):
        those at the height of the flight."""
        while self._kept and (t_ns - self._kept[0][0]) * 1e-9 > _KEPT_S:
            self._kept.popleft()
        lowest = float(np.percentile(_slope(points_W, eye_W)[0], _LOWEST_SHARE)) if len(points_W) else 0.0
        before = np.concatenate([np.zeros((0, 3)), *(points for _, points in self._kept)])
        slope, away_m = _slope(before, eye_W)
        hidden = before[(slope < lowest + _SPARE) & (away_m < _NEAR_M)][:, :2]
        _, away_m = _slope(level_W, eye_W)
        near = level_W[(away_m < _NEAR_M) & (level_W[:, 2] < eye_W[2])]
        if len(near):
            _, first = np.unique(np.floor(near / _CELL_M).astype(np.int64), axis=0, return_index=True)
            self._kept.append((t_ns, near[np.sort(first)]))
        return np.asarray(hidden)


def _slope(points_W: np.ndarray, eye_W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Up over level, and level distance."""
    d = points_W - eye_W
    away_m = np.hypot(d[:, 0], d[:, 1])
    return d[:, 2] / np.maximum(away_m, 0.05), away_m


@dataclass(frozen=True, eq=False)
class Nearby:
    """`level_W` (n, 2): what stands at the height of the vehicle, in the world as the estimate has it, and what it is
    too near to see any more."""

    t_ns: int  # of the capture
    level_W: np.ndarray
    usable: int  # points of the sweep, at any height
    points_W: np.ndarray  # (n, 3) all of them

    def nearest(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """Distance of the nearest point, and where it is from there; infinite where there is none."""
        if not len(self.level_W):
            return math.inf, 0.0, 0.0
        dx, dy = self.level_W[:, 0] - x_m, self.level_W[:, 1] - y_m
        squared = dx * dx + dy * dy
        i = int(np.argmin(squared))
        return math.sqrt(float(squared[i])), float(dx[i]), float(dy[i])


class Sweeps:
    """Reads sweeps of one LiDAR, placed on the vehicle as the bench says (`calibration`)."""

    def __init__(self, calibration: Mapping[str, Any] | None, slab_m: float) -> None:
        told = calibration or {}
        self._p_BL = np.asarray(told.get("p_BC", (0.0, 0.0, 0.0)), float)
        self._R_BL = matrix_of(told.get("q_BC", (1.0, 0.0, 0.0, 0.0)))
        self._elevation_deg = tuple(float(e) for e in told.get("elevation_deg", ()))
        self._slab_m = slab_m
        self._blind_spot = BlindSpot()

    def read(self, sample: Sample, at: SlamEstimate, yaw_rate_radps: float, height_m: float) -> Nearby:
        """`height_m`: of the flight. What is looked at lies round the vehicle's own height and round this one."""
        points_L = np.asarray(sample["points_L"], float).reshape(-1, 3)
        offset_ns = np.asarray(sample["time_offset_ns"], float).reshape(-1)
        ring = np.asarray(sample["ring"]).reshape(-1).astype(np.int64) if "ring" in sample else None
        n = min(len(points_L), len(offset_ns), len(points_L) if ring is None else len(ring))
        points_L, offset_ns = points_L[:n], offset_ns[:n]
        with np.errstate(over="ignore", invalid="ignore"):
            squared_m2 = (points_L * points_L).sum(axis=1)
        good = np.isfinite(squared_m2) & (squared_m2 > _LEAST_M * _LEAST_M)
        if self._elevation_deg and ring is not None:
            good &= on_ring(points_L, ring[:n], self._elevation_deg)
        points_L, offset_ns = points_L[good], offset_ns[good]
        ago_s = ((at.t_ns - sample.t_capture_ns) - offset_ns) * 1e-9
        points_B = points_L @ self._R_BL.T + self._p_BL
        level = points_B @ matrix_of(quaternion_of(at.roll, at.pitch, 0.0)).T
        p_W = np.asarray(at.p_W, float)
        up = float(p_W[2]) + level[:, 2]
        low, high = sorted((float(p_W[2]), height_m))
        kept = (
            (up > low - self._slab_m) & (up < high + self._slab_m)
            if high - low < self._slab_m
            else (np.abs(level[:, 2]) < self._slab_m)
        )
        yaw = at.yaw_rad - yaw_rate_radps * ago_s
        c, s = np.cos(yaw), np.sin(yaw)
        v_W = np.asarray(at.v_W, float)
        x = p_W[0] - v_W[0] * ago_s + c * level[:, 0] - s * level[:, 1]
        y = p_W[1] - v_W[1] * ago_s + s * level[:, 0] + c * level[:, 1]
        points_W = np.stack([x, y, up], axis=1)
        eye_W = p_W + np.array([0.0, 0.0, self._p_BL[2]])
        hidden = self._blind_spot.unseen(sample.t_capture_ns, eye_W, points_W, points_W[kept])
        level_W = np.concatenate([points_W[kept, :2], hidden])
        return Nearby(sample.t_capture_ns, level_W, len(points_L), points_W)


class Senses:
    """`look` at every frame whose position is known."""

    def __init__(
        self, settings: FlightSettings, calibration: Mapping[str, Any] | None, *, lidar: str, imu: str
    ) -> None:
        self.near: Nearby | None = None  # the newest usable sweep
        self._settings, self._lidar, self._imu = settings, lidar, imu
        self._sweeps = Sweeps(calibration, settings.slab_m)
        self._fresh = FreshSweeps()
        self._begun_ns: int | None = None
        self._level_ns: int | None = None

    def look(self, frame: Frame, estimate: SlamEstimate) -> None:
        """Take what this frame says."""
        self._begun_ns = frame.t_ns if self._begun_ns is None else self._begun_ns
        if estimate.imu_ok:
            self._level_ns = frame.t_ns
        if self._lidar not in frame:
            return
        sweep = frame[self._lidar]
        if not self._fresh.take(sweep, now_ns=frame.t_ns, p_W=np.asarray(estimate.p_W, float)):
            return
        rate = 0.0
        if self._imu in frame:
            rows = np.asarray(frame[self._imu]["gyro_radps"], float).reshape(-1, 3)
            rate = float(np.mean(rows[:, 2])) if len(rows) and np.isfinite(rows).all() else 0.0
        near = self._sweeps.read(sweep, estimate, rate, self._settings.height_m)
        if near.usable >= _FEWEST_POINTS:
            self.near = near

    def ready(self, t_ns: int) -> bool:
        """Whether it can be flown by them now."""
        return self.sees(t_ns) and self._level_ns == t_ns

    def sees(self, t_ns: int) -> bool:
        """Whether the newest sweep tells what is near."""
        return self.near is not None and self._blind_s(t_ns) <= _STALE_SWEEP_S

    def lost(self, t_ns: int) -> tuple[str, str] | None:
        """An outcome and why, where they have been away for too long."""
        s = self._settings
        blind_s = self._blind_s(t_ns)
        if blind_s > s.lidar_lost_s:
            return LIDAR_LOST, f"no usable sweep for {blind_s:.1f} s"
        since_ns = self._level_ns if self._level_ns is not None else self._begun_ns
        tilted_s = (t_ns - (since_ns if since_ns is not None else t_ns)) * 1e-9
        if tilted_s > s.imu_lost_s:
            return IMU_LOST, f"roll and pitch not known for {tilted_s:.1f} s"
        return None

    def _blind_s(self, t_ns: int) -> float:
        since_ns = self._begun_ns if self.near is None else self.near.t_ns
        return (t_ns - (since_ns if since_ns is not None else t_ns)) * 1e-9
