"""Where the vehicle was when a picture was taken, by IMU, GPS and barometer: no truth, and nothing of the autopilot.

The inertial filter of `explore` goes from row to row of the IMU; GPS corrects position and velocity at the time of each
fix, the barometer the height. Nothing measures the heading directly: it is known at the start, and GPS velocities hold
it whenever the vehicle accelerates. The first fix is where the vehicle stands before take-off, so what a receiver is
off by as a whole cancels, and what it drifts from then on does not.
"""

from __future__ import annotations

import math
from typing import Any, Sequence

import numpy as np

from hil_companion.explore.geodesy import LocalPlane
from hil_companion.explore.inertial import InertialFilter, Moment

IMU, GPS, BARO = "imu", "gps", "baro"
TOPICS = (IMU, GPS, BARO)
_FIX_3D, _GATE = 3, 5.0
_LEAST_SIGMA_M, _MOST_SIGMA_M, _UP_SHARE = 0.05, 50.0, 1.6
_SPEED_SIGMA_MPS = 0.1
_BARO_SIGMA_M, _BARO_ZERO_FRAMES = 0.5, 10
_LOST_NS = 3_000_000_000


class OwnPose:
    """`start_W`: x, y, z [m] and yaw before take-off. `update` once for each frame, in order."""

    def __init__(self, start_W: Sequence[float]) -> None:
        x, y, z, yaw = (float(c) for c in start_W)
        self._start = np.array([x, y, z])
        self._filter = InertialFilter((x, y, z, yaw))
        self._plane: LocalPlane | None = None
        self._fix_ns: int | None = None
        self._baro_zero: list[float] = []
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
        for k, t_ns in enumerate(gps["t_capture_ns"]):
            place = (gps["latitude_deg"][k], gps["longitude_deg"][k], gps["altitude_m"][k])
            sigma_m, speed = gps["horizontal_accuracy_m"][k], gps["v_W"][k]
            good = np.isfinite((*place, sigma_m, *speed)).all() and 0.0 <= sigma_m < _MOST_SIGMA_M
            if gps["fix_type"][k] < _FIX_3D or not good:
                continue
            self._fix_ns = int(t_ns)
            if self._plane is None:
                self._plane = LocalPlane(*place)
                continue
            then = self._filter.then(int(t_ns))
            if then is None:
                continue
            # The filter is corrected where it stands now by what it was off then: a tenth of a second apart.
            sigma_m = max(_LEAST_SIGMA_M, float(sigma_m))
            variance = np.array([sigma_m, sigma_m, _UP_SHARE * sigma_m]) ** 2
            off = self._start + np.array(self._plane.enu(*place)) - np.array(then.p)
            self._filter.correct_position((0, 1, 2), off, variance, _GATE if self._settled else 0.0)
            self._filter.correct_velocity(np.array(speed, float) - np.array(then.v), np.full(3, _SPEED_SIGMA_MPS**2))

    @property
    def _settled(self) -> bool:
        return self.sigma_m < 1.0

    def _take_baro(self, baro: Any) -> None:
        heights = [h for h in baro["pressure_altitude_m"] if math.isfinite(h)]
        if not heights:
            return
        mean = sum(heights) / len(heights)
        if len(self._baro_zero) < _BARO_ZERO_FRAMES:
            self._baro_zero.append(mean)  # on the ground
        zero = sum(self._baro_zero) / len(self._baro_zero)
        then = self._filter.then(int(baro["t_capture_ns"][len(heights) // 2]))
        if then is not None:
            off = self._start[2] + mean - zero - then.p[2]
            self._filter.correct_position((2,), np.array([off]), np.array([_BARO_SIGMA_M**2]), _GATE)
