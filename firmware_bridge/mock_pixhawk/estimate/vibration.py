"""Vibration as PX4 measures it in `VehicleIMU` and sends it in VIBRATION.

    accel    m = 0.99 m + 0.01 |a_k - a_k-1|        [m/s2]
    gyro     m = 0.99 m + 0.01 |w_k - w_k-1|        [rad/s]
    coning   m = 0.99 m + 0.01 |w_k x w_k-1|        [rad2/s2]

PX4's VIBRATION has coning, gyro and accel in its fields x, y and z, against MAVLink's own words. An accelerometer clips
within 0.1 % of its full scale of 16 g.
"""

from __future__ import annotations

from math import sqrt

from signals.samples import Vec3
from signals.units import STANDARD_GRAVITY_MPS2

_KEPT = 0.99
_CLIP_MPS2 = 0.999 * 16.0 * STANDARD_GRAVITY_MPS2


class VibrationMetrics:
    """Metrics of the samples since the first."""

    def __init__(self) -> None:
        self.accel_mps2 = self.gyro_radps = self.coning_rad2ps2 = 0.0
        self.clipped = 0  # axes of samples
        self._last: tuple[Vec3, Vec3] | None = None

    def note(self, accel_mps2: Vec3, gyro_radps: Vec3) -> None:
        """Take a sample."""
        self.clipped += sum(abs(a) >= _CLIP_MPS2 for a in accel_mps2)
        last, self._last = self._last, (accel_mps2, gyro_radps)
        if last is None:
            return
        (x, y, z), (p, q, r) = gyro_radps, last[1]
        cross = (y * r - z * q, z * p - x * r, x * q - y * p)
        self.accel_mps2 = _mixed(self.accel_mps2, _apart(accel_mps2, last[0]))
        self.gyro_radps = _mixed(self.gyro_radps, _apart(gyro_radps, last[1]))
        self.coning_rad2ps2 = _mixed(self.coning_rad2ps2, _apart(cross, (0.0, 0.0, 0.0)))


def _mixed(metric: float, size: float) -> float:
    return _KEPT * metric + (1.0 - _KEPT) * size


def _apart(a: Vec3, b: Vec3) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return sqrt((x * x + y * y) + z * z)
