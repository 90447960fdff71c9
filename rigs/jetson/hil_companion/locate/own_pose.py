"""Where the vehicle was when a picture was taken, by IMU, GPS and barometer: no truth, and nothing of the autopilot.

The inertial filter of `explore` goes from row to row of the IMU; GPS corrects position and velocity at the time of each
fix, the barometer the height. Nothing measures the heading directly: it is known at the start, and GPS velocities hold
it whenever the vehicle accelerates.
"""

from __future__ import annotations

import math
from typing import Any, Sequence

import numpy as np

from hil_companion.explore.geodesy import BaroHeights, GpsFixes
from hil_companion.explore.inertial import SPEED, XYZ, InertialFilter, Moment, Z

IMU, GPS, BARO = "imu", "gps", "baro"
TOPICS = (IMU, GPS, BARO)
_GATE = 5.0
_LEAST_SIGMA_M, _UP_SHARE = 0.05, 1.6
_SPEED_SIGMA_MPS = 0.1
_BARO_SIGMA_M = 0.5
_LOST_NS = 3_000_000_000


class OwnPose:
    """`start_W`: x, y, z [m] and yaw before take-off. `update` once for each frame, in order."""

    def __init__(self, start_W: Sequence[float]) -> None:
        x, y, z, yaw = (float(c) for c in start_W)
        self._gps, self._baro = GpsFixes(np.array([x, y, z])), BaroHeights(z)
        self._filter = InertialFilter((x, y, z, yaw))
        self._fix_ns: int | None = None
        self._t_ns = 0

    def update(self, frame: Any) -> None:
        """What the frame's sensors say, up to its time."""
        own = self._filter
        if IMU in frame:
            imu = frame[IMU]
            own.take(imu["t_capture_ns"], imu["gyro_radps"], imu["accel_mps2"])
        own.advance(int(frame.t_ns))
        self._t_ns = int(frame.t_ns)
        if GPS in frame:
            self._take_gps(frame[GPS])
        if BARO in frame:
            self._take_baro(frame[BARO])

    @property
    def ok(self) -> bool:
        """Whether positions mean anything: there has been a fix in the last three seconds."""
        return self._fix_ns is not None and self._t_ns - self._fix_ns <= _LOST_NS

    @property
    def sigma_m(self) -> float:
        """Of the position, horizontally, an axis."""
        cov = self._filter.cov
        return math.sqrt(max(0.0, float(max(cov[0, 0], cov[1, 1]))))

    def at(self, t_ns: int) -> Moment | None:
        """Pose at a time that is not long ago; None where it is not known."""
        if not self.ok:
            return None
        then = self._filter.then(int(t_ns))
        if then is None or not np.isfinite((*then.p, *then.q)).all():
            return None
        return then

    def _take_gps(self, gps: Any) -> None:
        for t_ns, p_W, v_W, sigma_m in self._gps.of(gps):
            self._fix_ns = t_ns
            then = self._filter.then(t_ns)
            if p_W is None or then is None:
                continue
            # The filter is corrected where it stands now by what it was off then: a tenth of a second apart.
            sigma_m = max(_LEAST_SIGMA_M, sigma_m)
            variance = np.array([sigma_m, sigma_m, _UP_SHARE * sigma_m]) ** 2
            off = p_W - np.array(then.p)
            self._filter.correct_states(XYZ, off, variance, _GATE if self._settled else 0.0)
            self._filter.correct_states(SPEED, v_W - np.array(then.v), np.full(3, _SPEED_SIGMA_MPS**2))

    @property
    def _settled(self) -> bool:
        return self.sigma_m < 1.0

    def _take_baro(self, baro: Any) -> None:
        height = self._baro.of(baro)
        then = None if height is None else self._filter.then(height[0])
        if height is not None and then is not None:
            off = np.array([height[1] - then.p[2]])
            self._filter.correct_states(Z, off, np.array([_BARO_SIGMA_M**2]), _GATE)
