"""Angles and elementary functions for the autopilot's guidance, the same bits on every machine.

Python's `math.sin` and its like call the C library, whose variants differ in the last bit between CPUs: the functions
here are those of `hil/signals/native/detmath.hpp`. All angles in rad.
"""

from __future__ import annotations

from math import floor, pi

from firmware_bridge import _native
from hil.signals.units import TURN_RAD

sin, cos, asin, atan2 = _native.det_sin, _native.det_cos, _native.det_asin, _native.det_atan2
exp, log = _native.det_exp, _native.det_log


def wrap_pi(angle_rad: float) -> float:
    """The same direction in [-pi, pi]; any finite angle."""
    if -pi <= angle_rad <= pi:
        return angle_rad
    return angle_rad - TURN_RAD * floor((angle_rad + pi) / TURN_RAD)


def euler_from_quaternion(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Roll, pitch, yaw (z-y'-x'' sequence) of the unit quaternion q_NF: body FRD to NED."""
    roll = atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))  # rounding may leave the range
    yaw = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw
