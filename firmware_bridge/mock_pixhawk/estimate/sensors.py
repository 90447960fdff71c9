"""Input of HIL_SENSOR and HIL_GPS as in PX4's `simulator_mavlink`, and health of the sensors.

PX4 takes a sensor only if its whole group of `fields_updated` bits is set. The IMU passes an int16 FIFO: accel in
steps of g/2048 within +-16 g, gyro in steps of 0.061 deg/s. A sensor whose value does not change for 100 samples is
STALE. Units here: m/s2, rad/s, gauss, hPa, NED/FRD.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from firmware_bridge._native import FlightCore
from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.estimate.vibration import VibrationMetrics
from signals.units import STANDARD_GRAVITY_MPS2

IMU_BITS, MAG_BITS, BARO_BITS, DIFF_PRESSURE_BIT = 0x3F, 0x1C0, 0x1A00, 0x400

ACCEL, GYRO, MAG, BARO, GPS = range(5)
LABELS = ("ACCEL", "GYRO", "MAG", "BARO", "GPS")

STALE_SAMPLES = 100
TIMEOUT_US = (100_000, 100_000, 1_000_000, 1_000_000, 2_000_000)  # a sensor without a sample for this long is lost
# Samples over a serial line arrive less evenly: PX4's limit in HITL is half a second for accelerometer and gyro.
HITL_TIMEOUT_US = (500_000, 500_000, *TIMEOUT_US[2:])

# Shortest periods of the estimator's inputs; samples in between are skipped.
_MAG_PERIOD_US, _BARO_PERIOD_US = 10_000, 20_000

_HIL_GPS = struct.Struct("<QiiiHHHhhhHBBBH").unpack
UNKNOWN_ACCURACY = 65535
MAX_EPH_CM, MAX_EPV_CM, MIN_FIX, MIN_SATELLITES = 300, 500, 3, 6

# Barometric formula of the standard atmosphere below 11 km, as PX4's baro driver:
# h = (T0 / L) (1 - (p / p0)^(L R / g))
_T0, _LAPSE, _P0_HPA = 288.15, 6.5e-3, 1013.25
_EXPONENT = _LAPSE * 287.05 / STANDARD_GRAVITY_MPS2


# A belly that strikes the ground pushes beyond the accelerometer's +-16 g, and what is cut off is missing in the
# integral: 2 to 3 m/s of one strike, beyond the gate of GPS. PX4's EKF2 takes a larger noise for an accelerometer that
# clips or disagrees with the vertical position (BADACC_BIAS_PNOISE 4.9 m/s2), for BADACC_PROBATION 10 s. Here the noise
# density from a clipped sample on until, half a second later, the first fixes measured after it have come:
# 8 sqrt(0.1) = 2.5 m/s per GPS period of 0.1 s.
CLIPS_MPS2 = 0.99 * 16.0 * STANDARD_GRAVITY_MPS2
CLIPPED_US, CLIPPED_NOISE = 500_000, 8.0  # m/s2/sqrt(Hz)

LATE_US = 20_000
_WINDOW = 500  # samples: 2 s at 250 Hz
_BAD, _GOOD = 10, 5  # late samples in the window: bad from 2 % on, good again below 1 %
_MEAN_OVER = 256  # samples
_USUAL_US = 4_000.0  # initial mean interval
_LONGEST_US = 100_000.0  # longest interval in the mean: longer ones are pauses


class Arrivals:
    """Monitor of the regularity of the samples of one stream.

    In HITL a sample is time-stamped on arrival, so PX4 integrates a late one over the wrong interval and takes the
    error for an accelerometer bias. On PX4, 2.6 % of samples more than 20 ms late were enough.

    The board does not know when a sample was due, so lateness is estimated: an interval longer than the mean adds its
    excess, shorter ones (samples that had queued) subtract theirs, and intervals near the mean halve the lateness (the
    bench had only paused).
    """

    def __init__(self) -> None:
        self.bad = False
        self.late_samples = 0  # in the window
        self.longest_gap_us = 0
        self._last_us: int | None = None
        self._mean_us = _USUAL_US
        self._lateness_us = 0.0
        self._window: deque[bool] = deque([False] * _WINDOW, _WINDOW)

    def note(self, t_us: int) -> None:
        """Record the arrival of a sample at `t_us`."""
        last, self._last_us = self._last_us, t_us
        if last is None:
            return
        interval_us = t_us - last
        self.longest_gap_us = max(self.longest_gap_us, interval_us)
        excess_us = interval_us - self._mean_us
        self._lateness_us = max(0.0, self._lateness_us + excess_us)
        if abs(excess_us) < 0.5 * self._mean_us:
            self._lateness_us *= 0.5
        self._mean_us += (min(interval_us, _LONGEST_US) - self._mean_us) / _MEAN_OVER
        late = self._lateness_us > LATE_US
        self.late_samples += late - self._window[0]
        self._window.append(late)
        self.bad = self.late_samples >= (_GOOD if self.bad else _BAD)


class GpsFix:
    """The last HIL_GPS, in MAVLink's own units (degE7, mm, cm, cm/s)."""

    __slots__ = ("alt_mm", "cog", "eph", "epv", "fix_type", "lat", "lon", "satellites", "t_us", "vd", "ve", "vel", "vn")

    def __init__(self, payload: bytes, t_us: int) -> None:
        (_, self.lat, self.lon, self.alt_mm, self.eph, self.epv, self.vel, self.vn, self.ve, self.vd, self.cog,
         self.fix_type, self.satellites, _, _) = _HIL_GPS(payload)  # fmt: skip
        self.t_us = t_us

    @property
    def usable(self) -> bool:
        """True if PX4's estimator accepts the fix. eph and epv are accuracies in cm; 65535 (unknown) is rejected."""
        return (
            self.fix_type >= MIN_FIX
            and self.satellites >= MIN_SATELLITES
            and self.eph <= MAX_EPH_CM
            and self.epv <= MAX_EPV_CM
        )


def pressure_altitude_m(pressure_hpa: float) -> float:
    """Return the altitude in the standard atmosphere at `pressure_hpa` > 0."""
    return (_T0 / _LAPSE) * (1.0 - el.exp(_EXPONENT * el.log(pressure_hpa / _P0_HPA)))


class SensorIntake:
    """Input of the estimator, with one health record per sensor."""

    def __init__(self, estimator: FlightCore, timeout_us: Sequence[int] = TIMEOUT_US) -> None:
        self._estimator = estimator
        self._timeout_us = timeout_us
        self.arrivals = Arrivals()  # of IMU samples; used in HITL only
        self._last: list[bytes] = [b""] * 5  # bytes of the last sample
        self._same = [0] * 5  # equal samples in a row
        self.last_us: list[int | None] = [None] * 5
        self.incomplete_groups = 0
        self.not_finite = 0
        self.gps: GpsFix | None = None
        self.differential_hpa: float | None = None  # of the pitot tube; None: no sample came
        self.differential_us: int | None = None  # its time
        self.vibration: VibrationMetrics | None = None  # measured from the first request for VIBRATION on
        self._next_mag_us = 0
        self._next_baro_us = 0
        self._noise: tuple[int, Callable[[], float]] | None = None  # EKF_ACC_NOISE: index and value
        self._clipped_until_us = 0
        self._doubts = False  # the wider noise is set

    def doubt_clipped(self, index: int, noise: Callable[[], float]) -> None:
        """Doubt an accelerometer that clips. `index`, `noise()`: of EKF_ACC_NOISE, which is the noise otherwise."""
        self._noise = (index, noise)

    def _watch_clipping(
        self, t_us: int, force_mps2: tuple[float, float, float], index: int, noise: Callable[[], float]
    ) -> None:
        x, y, z = force_mps2
        if abs(x) >= CLIPS_MPS2 or abs(y) >= CLIPS_MPS2 or abs(z) >= CLIPS_MPS2:
            self._clipped_until_us = t_us + CLIPPED_US
        doubts = t_us < self._clipped_until_us
        if doubts != self._doubts:
            self._doubts = doubts
            self._estimator.set_param(index, CLIPPED_NOISE if doubts else noise())

    def stale(self, sensor: int) -> bool:
        """Return True if the last `STALE_SAMPLES` samples were equal."""
        return self._same[sensor] >= STALE_SAMPLES

    def lost(self, sensor: int, now_us: int) -> bool:
        """Return True if the last sample is older than the timeout, or none ever came."""
        last = self.last_us[sensor]
        return last is None or now_us - last > self._timeout_us[sensor]

    def lost_since_us(self, sensor: int, now_us: int) -> int:
        """Return the time since the last sample; 0 if none ever came."""
        last = self.last_us[sensor]
        return 0 if last is None else now_us - last

    def healthy(self, sensor: int, now_us: int) -> bool:
        """Return True if the sensor is present and not stale and, for GPS, its fix usable."""
        if self.lost(sensor, now_us) or self.stale(sensor):
            return False
        return sensor != GPS or (self.gps is not None and self.gps.usable)

    def _note(self, sensor: int, sample: bytes, t_us: int) -> None:
        if sample == self._last[sensor]:
            self._same[sensor] += 1
        else:
            self._last[sensor] = sample
            self._same[sensor] = 0
        self.last_us[sensor] = t_us

    def take(self, t_us: int, values: tuple[Any, ...], payload: bytes) -> bool:
        """Take a HIL_SENSOR (`values`: all fields, `payload`: its bytes). Return True if the estimator made a step."""
        (_, ax, ay, az, gx, gy, gz, mx, my, mz, pressure, difference, _, _, fields, _) = values
        stepped = False
        if fields & IMU_BITS == IMU_BITS:
            if payload[8:20] == self._last[ACCEL]:
                self._same[ACCEL] += 1
            else:
                self._last[ACCEL] = payload[8:20]
                self._same[ACCEL] = 0
            if payload[20:32] == self._last[GYRO]:
                self._same[GYRO] += 1
            else:
                self._last[GYRO] = payload[20:32]
                self._same[GYRO] = 0
            self.last_us[ACCEL] = self.last_us[GYRO] = t_us
            if self._noise is not None:
                self._watch_clipping(t_us, (ax, ay, az), *self._noise)
            stepped = self._estimator.step_fifo(t_us, gx, gy, gz, ax, ay, az)
            self.not_finite += not stepped
            if self.vibration is not None and stepped:
                self.vibration.note(t_us, (ax, ay, az), (gx, gy, gz))
        elif fields & IMU_BITS:
            self.incomplete_groups += 1
        if fields & MAG_BITS:
            if fields & MAG_BITS != MAG_BITS:
                self.incomplete_groups += 1
            else:
                self._note(MAG, payload[32:44], t_us)
                if t_us >= self._next_mag_us:
                    self._next_mag_us = t_us + _MAG_PERIOD_US
                    if mx * mx + my * my + mz * mz < 1e6:  # also false for NaN
                        self._estimator.update_mag(t_us, mx, my, mz)
                    else:
                        self.not_finite += 1
        if fields & BARO_BITS:
            if fields & BARO_BITS != BARO_BITS:
                self.incomplete_groups += 1
            else:
                self._note(BARO, payload[44:48], t_us)
                if t_us >= self._next_baro_us:
                    self._next_baro_us = t_us + _BARO_PERIOD_US
                    if 1.0 < pressure < 2000.0:
                        self._estimator.update_baro(t_us, pressure_altitude_m(pressure))
                    else:
                        self.not_finite += 1
        if fields & DIFF_PRESSURE_BIT:
            if -1000.0 < difference < 1000.0:  # also false for NaN
                self.differential_hpa, self.differential_us = difference, t_us
            else:
                self.not_finite += 1
        return stepped

    def take_gps(self, payload: bytes, now_us: int) -> None:
        """Take a HIL_GPS, time-stamped on arrival as in PX4."""
        fix = GpsFix(payload, now_us)
        self.gps = fix
        self.last_us[GPS] = now_us
        if not fix.usable or not (abs(fix.lat) <= 900_000_000 and abs(fix.lon) <= 1_800_000_000):
            return
        self._estimator.update_gps(
            now_us,
            fix.lat / 1e7,
            fix.lon / 1e7,
            fix.alt_mm / 1e3,
            fix.vn / 100.0,
            fix.ve / 100.0,
            fix.vd / 100.0,
            fix.eph / 100.0,
            fix.epv / 100.0,
        )
