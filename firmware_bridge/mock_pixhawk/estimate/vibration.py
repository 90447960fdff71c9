"""Vibration as PX4 measures it in SITL, and sends it in VIBRATION.

PX4's driver and then its integrator take the mean of neighbouring samples (trapezoids), so with f and g the samples

    a_k = (f_k + 2 f_k-1 + f_k-2) / 4,   w_k likewise
    accel    m = 0.99 m + 0.01 |a_k - a_k-1|                       [m/s2]
    gyro     m = 0.99 m + 0.01 |w_k - w_k-1|                       [rad/s]
    coning   m = 0.99 m + 0.01 |w_k-1 x w_k| dt^2 / 12             [rad2]; PX4 takes the mean since its last status

and a line near half of the sample rate all but vanishes. PX4's VIBRATION has coning, gyro and accel in its fields x, y
and z, against MAVLink's own words. An accelerometer clips within two steps of the int16 of its driver, 16 g.
"""

from __future__ import annotations

from math import sqrt

from signals.samples import Vec3
from signals.units import STANDARD_GRAVITY_MPS2

_KEPT = 0.99
_CLIP_MPS2 = 32766 * STANDARD_GRAVITY_MPS2 / 2048.0


class Trapezoids:
    """Mean of neighbours, twice."""

    def __init__(self) -> None:
        self._last: tuple[Vec3, Vec3] | None = None

    def mean(self, value: Vec3) -> Vec3:
        """Take a sample and return the mean; before the first sample everything was as it is."""
        before, once_before = self._last or (value, value)
        once = _middle(before, value)
        self._last = (value, once)
        return _middle(once_before, once)


class VibrationMetrics:
    """Metrics of the samples since the first."""

    def __init__(self) -> None:
        self.accel_mps2 = self.gyro_radps = self.coning_rad2 = 0.0
        self.clipped = 0  # axes of samples
        self._accel, self._gyro = Trapezoids(), Trapezoids()
        self._last: tuple[int, Vec3, Vec3] | None = None

    def note(self, t_us: int, accel_mps2: Vec3, gyro_radps: Vec3) -> None:
        """Take a sample."""
        self.clipped += sum(abs(a) >= _CLIP_MPS2 for a in accel_mps2)
        a, w = self._accel.mean(accel_mps2), self._gyro.mean(gyro_radps)
        last, self._last = self._last, (t_us, a, w)
        if last is None:
            return
        dt_s = (t_us - last[0]) * 1e-6
        self.accel_mps2 = _mixed(self.accel_mps2, _apart(a, last[1]))
        self.gyro_radps = _mixed(self.gyro_radps, _apart(w, last[2]))
        (x, y, z), (p, q, r) = last[2], w
        cross = (y * r - z * q, z * p - x * r, x * q - y * p)
        self.coning_rad2 = _mixed(self.coning_rad2, _apart(cross, (0.0, 0.0, 0.0)) * dt_s * dt_s / 12.0)


def _mixed(metric: float, size: float) -> float:
    return _KEPT * metric + (1.0 - _KEPT) * size


def _middle(a: Vec3, b: Vec3) -> Vec3:
    return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]))


def _apart(a: Vec3, b: Vec3) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return sqrt((x * x + y * y) + z * z)
