"""The vehicle's pose at the time of a picture, estimated from IMU, GPS and barometer, without truth or autopilot data.

The inertial filter integrates the rows of the IMU. GPS corrects position and velocity at the time of each fix, the
barometer corrects the height. No sensor measures the heading directly: it is given at the start, and GPS velocities
correct it whenever the vehicle accelerates.
"""

from __future__ import annotations

import math
from typing import Any, Sequence

import numpy as np

from hil_companion.navigation.geodesy import BaroHeights, GpsFixes
from hil_companion.navigation.inertial import SPEED, XYZ, InertialFilter, NavState, Z

IMU, GPS, BARO = "imu", "gps", "baro"
TOPICS = (IMU, GPS, BARO)
_GATE = 5.0
_MIN_SIGMA_M, _UP_FACTOR = 0.05, 1.6  # vertical standard deviation = factor * horizontal
_SPEED_SIGMA_MPS = 0.1
_BARO_SIGMA_M = 0.5
_LOST_NS = 3_000_000_000


class OwnPose:
    """Pose estimator; call `update` for each frame, in order. `start_W`: x, y, z [m], yaw [rad] before take-off."""

    def __init__(self, start_W: Sequence[float]) -> None:
        x, y, z, yaw = (float(c) for c in start_W)
        self._gps, self._baro = GpsFixes(np.array([x, y, z])), BaroHeights(z)
        self._filter = InertialFilter((x, y, z, yaw))
        self._fix_ns: int | None = None
        self._t_ns = 0

    def update(self, frame: Any) -> None:
        """Advance the estimate to the frame's time with its sensor data."""
        own = self._filter
        if IMU in frame:
            imu = frame[IMU]
            own.add_rows(imu["t_capture_ns"], imu["gyro_radps"], imu["accel_mps2"])
        own.advance(int(frame.t_ns))
        self._t_ns = int(frame.t_ns)
        if GPS in frame:
            self._read_gps(frame[GPS])
        if BARO in frame:
            self._read_baro(frame[BARO])

    @property
    def ok(self) -> bool:
        """Return True if there was a GPS fix in the last three seconds."""
        return self._fix_ns is not None and self._t_ns - self._fix_ns <= _LOST_NS

    @property
    def sigma_m(self) -> float:
        """Return the horizontal standard deviation of the position, per axis [m]."""
        cov = self._filter.cov
        return math.sqrt(max(0.0, float(max(cov[0, 0], cov[1, 1]))))

    def at(self, t_ns: int) -> NavState | None:
        """Return the pose at a recent time; None if it is unknown."""
        if not self.ok:
            return None
        then = self._filter.state_at(int(t_ns))
        if then is None or not np.isfinite((*then.p, *then.q)).all():
            return None
        return then

    def _read_gps(self, gps: Any) -> None:
        for t_ns, p_W, v_W, sigma_m in self._gps.usable(gps):
            self._fix_ns = t_ns
            then = self._filter.state_at(t_ns)
            if p_W is None or then is None:
                continue
            # The error at the time of the fix corrects the present state, about a tenth of a second later.
            sigma_m = max(_MIN_SIGMA_M, sigma_m)
            variance = np.array([sigma_m, sigma_m, _UP_FACTOR * sigma_m]) ** 2
            off = p_W - np.array(then.p)
            self._filter.correct_states(XYZ, off, variance, _GATE if self._settled else 0.0)
            self._filter.correct_states(SPEED, v_W - np.array(then.v), np.full(3, _SPEED_SIGMA_MPS**2))

    @property
    def _settled(self) -> bool:
        return self.sigma_m < 1.0

    def _read_baro(self, baro: Any) -> None:
        height = self._baro.height(baro)
        then = None if height is None else self._filter.state_at(height[0])
        if height is not None and then is not None:
            off = np.array([height[1] - then.p[2]])
            self._filter.correct_states(Z, off, np.array([_BARO_SIGMA_M**2]), _GATE)
