"""Whether LiDAR and IMU can be flown by: what the newest sweep shows, how old it is, how long roll and pitch are lost.

Without a fresh sweep, or not knowing what is level, the vehicle brakes; without for long the flight is over.
"""

from __future__ import annotations

from typing import Any, Mapping

import numpy as np

from hil_companion.explore.fresh import FreshSweeps
from hil_companion.explore.grid import Estimate
from hil_companion.explore.nearby import Nearby, Sweeps
from hil_companion.explore.outcome import IMU_LOST, LIDAR_LOST
from hil_companion.explore.settings import FlightSettings
from hil_companion.frame import Frame

_FEWEST_POINTS = 20  # of a sweep that shows anything
_STALE_SWEEP_S = 0.35


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

    def look(self, frame: Frame, estimate: Estimate) -> None:
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
