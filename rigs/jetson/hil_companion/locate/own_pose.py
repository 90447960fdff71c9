"""The vehicle's pose at the time of a picture, estimated from IMU, GPS and barometer, without truth or autopilot data.

The inertial filter integrates the rows of the IMU. GPS corrects position and velocity at the time of each fix, the
barometer corrects the height. The filter's state is that of the newest fix, and the IMU's rows since then lead to the
picture's time: if the error at each fix corrected a later state, the fixes of one frame would correct the same error
again and again.

No sensor measures the heading directly: it is given at the start, and GPS velocities correct it whenever the vehicle
accelerates. A search turns the vehicle some twenty times, mostly one way, and each turn adds its share of the gyro's
scale error, 0.7 degrees at 0.2 %. So the filter estimates the scales. Until it leaves its start, the vehicle does not
turn, so that the mean of the gyro is its bias (zero angular rate update; Groves 2013, Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems, 15.3). Without it, the heading drifts by two degrees in a vertical climb.
"""

from __future__ import annotations

import math
from typing import Any, Sequence

import numpy as np

from hil_companion.navigation.geodesy import BaroHeights, Fix, GpsFixes
from hil_companion.navigation.inertial import BG, GAP_S, SPEED, XYZ, YAW, InertialFilter, NavState, Z

IMU, GPS, BARO = "imu", "gps", "baro"
TOPICS = (IMU, GPS, BARO)
_GATE = 5.0
_MIN_SIGMA_M, _UP_FACTOR = 0.05, 1.6  # vertical standard deviation = factor * horizontal
_SPEED_SIGMA_MPS = 0.1
_BARO_SIGMA_M = 0.5
_LOST_NS = 3_000_000_000
_GAP_NS = round(GAP_S * 1e9)
_BEHIND_NS = 300_000_000  # the filter is at most this much older than the frame; a later fix corrects the present state
_GYRO_SCALE = 0.003  # standard deviation of what is left of the gyro's scale error after calibration
_REST_M, _REST_MPS, _REST_RADPS = 0.3, 0.3, 0.1  # at rest: within this distance of the start, below these rates
_REST_GYRO_RAD_PER_RTS = 5e-4


class OwnPose:
    """Pose estimator; call `update` for each frame, in order. `start_W`: x, y, z [m], yaw [rad] before take-off."""

    def __init__(self, start_W: Sequence[float]) -> None:
        x, y, z, yaw = (float(c) for c in start_W)
        self._gps, self._baro = GpsFixes(np.array([x, y, z])), BaroHeights(z)
        self._filter = InertialFilter((x, y, z, yaw), scale_sigma=_GYRO_SCALE)
        self._start_W = np.array([x, y, z])
        self._at_start = True
        self._fix_ns: int | None = None
        self._t_ns = 0

    def update(self, frame: Any) -> None:
        """Advance the estimate to the frame's time with its sensor data."""
        own = self._filter
        if IMU in frame:
            imu = frame[IMU]
            own.add_rows(imu["t_capture_ns"], imu["gyro_radps"], imu["accel_mps2"])
        fixes = self._gps.usable(frame[GPS]) if GPS in frame else []
        height = self._baro.height(frame[BARO]) if BARO in frame else None
        measurements: list[tuple[int, Any]] = [(fix.t_ns, fix) for fix in fixes]
        measurements += [] if height is None else [height]
        for t_ns, measured in sorted(measurements, key=_time):
            then = self._at_measurement(t_ns)
            if isinstance(measured, Fix):
                self._fix_ns = t_ns
                self._correct_by_fix(measured, then)
            elif then is not None:
                own.correct_states(Z, np.array([measured - then.p[2]]), np.array([_BARO_SIGMA_M**2]), _GATE)
        self._advance(int(frame.t_ns) - _BEHIND_NS)
        if self._at_start and IMU in frame:
            self._correct_gyro_at_rest(np.asarray(imu["gyro_radps"], float), (int(frame.t_ns) - self._t_ns) * 1e-9)
        self._t_ns = int(frame.t_ns)

    @property
    def ok(self) -> bool:
        """Return True if there was a GPS fix in the last three seconds."""
        return self._fix_ns is not None and self._t_ns - self._fix_ns <= _LOST_NS

    @property
    def sigma_m(self) -> float:
        """Return the horizontal standard deviation of the position, per axis [m]."""
        cov = self._filter.cov
        return math.sqrt(max(0.0, float(max(cov[0, 0], cov[1, 1]))))

    @property
    def yaw_sigma_rad(self) -> float:
        """Return the standard deviation of the heading."""
        return math.sqrt(max(0.0, float(self._filter.cov[YAW[0], YAW[0]])))

    def at(self, t_ns: int) -> NavState | None:
        """Return the pose at a recent time; None if it is unknown."""
        if not self.ok:
            return None
        then = self._state_at(int(t_ns))
        if then is None or not np.isfinite((*then.p, *then.q)).all():
            return None
        return then

    def _correct_gyro_at_rest(self, gyro_radps: np.ndarray, over_s: float) -> None:
        """Correct the gyro's bias by its mean over the last rows; (n, 3)."""
        own = self._filter
        moved_m, speed_mps = float(np.linalg.norm(own.p - self._start_W)), float(np.linalg.norm(own.v))
        self._at_start = moved_m < _REST_M and speed_mps < _REST_MPS
        if not self._at_start or over_s <= 0.0 or not gyro_radps.size or np.abs(gyro_radps).max() > _REST_RADPS:
            return
        H = own.no_errors(3)
        H[:, BG] = np.eye(3)
        own.correct(H, gyro_radps.mean(axis=0) - own.gyro_bias, np.full(3, _REST_GYRO_RAD_PER_RTS**2 / over_s))

    def _advance(self, to_ns: int) -> None:
        """Advance the filter to the newest row of the IMU up to `to_ns`, or to that time if the IMU is silent."""
        own = self._filter
        row_ns = own.row_before(to_ns)
        if row_ns is None or to_ns - row_ns > _GAP_NS:
            row_ns = to_ns
        if own.t_ns is None or row_ns > own.t_ns:
            own.advance(row_ns)

    def _at_measurement(self, t_ns: int) -> NavState | None:
        """Return the state at the time of a measurement, to which the filter advances unless it is later already."""
        self._advance(t_ns)
        return self._state_at(t_ns)

    def _state_at(self, t_ns: int) -> NavState | None:
        own = self._filter
        return own.predict(t_ns) if own.t_ns is not None and t_ns > own.t_ns else own.state_at(t_ns)

    def _correct_by_fix(self, fix: Fix, then: NavState | None) -> None:
        if fix.p_W is None or then is None:
            return
        sigma_m = max(_MIN_SIGMA_M, fix.sigma_m)
        variance = np.array([sigma_m, sigma_m, _UP_FACTOR * sigma_m]) ** 2
        self._filter.correct_states(XYZ, fix.p_W - np.array(then.p), variance, _GATE if self._settled else 0.0)
        self._filter.correct_states(SPEED, fix.v_W - np.array(then.v), np.full(3, _SPEED_SIGMA_MPS**2))

    @property
    def _settled(self) -> bool:
        return self.sigma_m < 1.0


def _time(entry: tuple[int, Any]) -> int:
    return entry[0]
