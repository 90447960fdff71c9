"""Obstacles near the vehicle, and the health of LiDAR and IMU: age of the newest sweep, time without roll and pitch.

Without a fresh sweep, or with roll and pitch unknown, the vehicle brakes; after longer loss the flight ends.

Obstacles are the points of the newest sweep at the height of the flight, corrected for the vehicle's motion without the
map, so that braking depends on the LiDAR directly. A point fired `time_offset_ns` before the capture was measured from
the vehicle's pose at that time:

    p_W = p_now - v (t_now - t_fired) + R(yaw - r (t_now - t_fired), pitch, roll) p_B

Points that are not finite, have a range near zero or lie beside their ring's cone (corrupted ranges) are left out. A
sweep with too few valid points counts as missing.

Obstacles that came too near to be seen any more (the lowest ring passes over people's heads) are remembered for
`_KEPT_S` at their last position. Whatever the newest sweep could see is not remembered.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Mapping

import numpy as np

from hil_companion.explore.mapping.slam import SlamEstimate
from hil_companion.explore.mapping.sweep import FreshSweeps, on_ring
from hil_companion.explore.outcome import IMU_LOST, LIDAR_LOST
from hil_companion.explore.planning.flight_settings import FlightSettings
from hil_companion.frame import Frame, Sample
from hil_companion.navigation.rotation import matrix_of, quaternion_of

_MIN_RANGE_M = 0.1
_KEPT_S = 2.0
_NEAR_M = 4.0
_CELL_M = 0.1
_SLOPE_MARGIN = 0.02
_OUTLIER_PERCENT = 1.0  # of the returns that may lie below the lowest ring
_MIN_POINTS = 20  # of a usable sweep
_STALE_SWEEP_S = 0.35


class BlindSpot:
    """Memory of obstacles that the LiDAR saw and cannot see any more. Call `remembered` for each sweep, in order."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, np.ndarray]] = deque()

    def remembered(self, t_ns: int, eye_W: np.ndarray, points_W: np.ndarray, level_W: np.ndarray) -> np.ndarray:
        """Return positions (n, 2) of remembered obstacles in the blind spot, and remember this sweep's near points.

        `eye_W`: the LiDAR; `points_W` (n, 3): the sweep; `level_W` (n, 3): its points at the height of the flight.
        """
        while self._kept and (t_ns - self._kept[0][0]) * 1e-9 > _KEPT_S:
            self._kept.popleft()
        lowest = float(np.percentile(_slope(points_W, eye_W)[0], _OUTLIER_PERCENT)) if len(points_W) else 0.0
        before = np.concatenate([np.zeros((0, 3)), *(points for _, points in self._kept)])
        slope, away_m = _slope(before, eye_W)
        hidden = before[(slope < lowest + _SLOPE_MARGIN) & (away_m < _NEAR_M)][:, :2]
        _, away_m = _slope(level_W, eye_W)
        near = level_W[(away_m < _NEAR_M) & (level_W[:, 2] < eye_W[2])]
        if len(near):
            _, first = np.unique(np.floor(near / _CELL_M).astype(np.int64), axis=0, return_index=True)
            self._kept.append((t_ns, near[np.sort(first)]))
        return np.asarray(hidden)


def _slope(points_W: np.ndarray, eye_W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return slope (rise over horizontal distance) and horizontal distance of each point."""
    d = points_W - eye_W
    away_m = np.hypot(d[:, 0], d[:, 1])
    return d[:, 2] / np.maximum(away_m, 0.05), away_m


@dataclass(frozen=True, eq=False)
class Nearby:
    """Points of one sweep in W, by the vehicle's estimated pose."""

    t_ns: int  # of the capture
    level_W: np.ndarray  # (n, 2) obstacles at the height of the vehicle, with the remembered ones in the blind spot
    usable: int  # number of valid points at any height
    points_W: np.ndarray  # (n, 3) all valid points

    def nearest(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """Return distance and offset (dx, dy) of the nearest obstacle; infinite distance without any."""
        if not len(self.level_W):
            return math.inf, 0.0, 0.0
        dx, dy = self.level_W[:, 0] - x_m, self.level_W[:, 1] - y_m
        squared = dx * dx + dy * dy
        i = int(np.argmin(squared))
        return math.sqrt(float(squared[i])), float(dx[i]), float(dy[i])


class SweepReader:
    """Converts sweeps of one LiDAR to obstacles in a band of half height `slab_m`; `calibration` is the bench's."""

    def __init__(self, calibration: Mapping[str, Any] | None, slab_m: float) -> None:
        entries = calibration or {}
        self._p_BL = np.asarray(entries.get("p_BC", (0.0, 0.0, 0.0)), float)
        self._R_BL = matrix_of(entries.get("q_BC", (1.0, 0.0, 0.0, 0.0)))
        self._elevation_deg = tuple(float(e) for e in entries.get("elevation_deg", ()))
        self._slab_m = slab_m
        self._blind_spot = BlindSpot()

    def read(self, sample: Sample, at: SlamEstimate, yaw_rate_radps: float, height_m: float) -> Nearby:
        """Convert a sweep. Obstacles count at about the vehicle's height, and at the flight's height if it is near."""
        points_L = np.asarray(sample["points_L"], float).reshape(-1, 3)
        offset_ns = np.asarray(sample["time_offset_ns"], float).reshape(-1)
        ring = np.asarray(sample["ring"]).reshape(-1).astype(np.int64) if "ring" in sample else None
        n = min(len(points_L), len(offset_ns), len(points_L) if ring is None else len(ring))
        points_L, offset_ns = points_L[:n], offset_ns[:n]
        with np.errstate(over="ignore", invalid="ignore"):
            squared_m2 = (points_L * points_L).sum(axis=1)
        good = np.isfinite(squared_m2) & (squared_m2 > _MIN_RANGE_M * _MIN_RANGE_M)
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
        hidden = self._blind_spot.remembered(sample.t_capture_ns, eye_W, points_W, points_W[kept])
        level_W = np.concatenate([points_W[kept, :2], hidden])
        return Nearby(sample.t_capture_ns, level_W, len(points_L), points_W)


class Senses:
    """Health of LiDAR and IMU and the newest sweep; call `update` for every frame with a known position."""

    def __init__(self, settings: FlightSettings, calibration: Mapping[str, Any] | None, *, lidar: str) -> None:
        self.near: Nearby | None = None  # the newest usable sweep
        self._settings, self._lidar = settings, lidar
        self._reader = SweepReader(calibration, settings.slab_m)
        self._fresh = FreshSweeps()
        self._begun_ns: int | None = None
        self._level_ns: int | None = None

    def update(self, frame: Frame, estimate: SlamEstimate) -> None:
        """Update with a frame and its estimate."""
        self._begun_ns = frame.t_ns if self._begun_ns is None else self._begun_ns
        if estimate.imu_ok:
            self._level_ns = frame.t_ns
        if self._lidar not in frame:
            return
        sweep = frame[self._lidar]
        if not self._fresh.is_new(sweep, now_ns=frame.t_ns, p_W=np.asarray(estimate.p_W, float)):
            return
        rate = 0.0
        if "imu" in frame:
            rows = np.asarray(frame["imu"]["gyro_radps"], float).reshape(-1, 3)
            rate = float(np.mean(rows[:, 2])) if len(rows) and np.isfinite(rows).all() else 0.0
        near = self._reader.read(sweep, estimate, rate, self._settings.height_m)
        if near.usable >= _MIN_POINTS:
            self.near = near

    def ready(self, t_ns: int) -> bool:
        """Return True if both sensors can be relied on now."""
        return self.sees(t_ns) and self._level_ns == t_ns

    def sees(self, t_ns: int) -> bool:
        """Return True if the newest sweep is fresh."""
        return self.near is not None and self._blind_s(t_ns) <= _STALE_SWEEP_S

    def lost(self, t_ns: int) -> tuple[str, str] | None:
        """Return outcome and reason if a sensor has been lost for too long, else None."""
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
