"""Angles and elementary functions for the autopilot's guidance, the same bits on every machine.

Python's `math.sin` and its like call the C library, whose variants differ in the last bit between CPUs: the functions
here are those of `signals/native/detmath.hpp`. All angles in rad.
"""

from __future__ import annotations

from math import floor, pi

from signals._kernel import det_asin, det_atan2, det_cos, det_exp, det_log, det_sin
from signals.units import TURN_RAD

sin, cos, asin, atan2, exp, log = det_sin, det_cos, det_asin, det_atan2, det_exp, det_log


def wrap_pi(angle_rad: float) -> float:
    """Return the same direction in [-pi, pi], for any finite angle."""
    if -pi <= angle_rad <= pi:
        return angle_rad
    return angle_rad - TURN_RAD * floor((angle_rad + pi) / TURN_RAD)
