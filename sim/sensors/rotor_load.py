"""Thrust and power of the rotors, estimated from their speeds, for the errors of barometer and magnetometer."""

from __future__ import annotations

from collections.abc import Sequence


def thrust_ratio(rotor_speed_radps: Sequence[float], reference_radps: float) -> float:
    """Return the mean thrust relative to the thrust at the reference speed; thrust grows with the square of speed."""
    total = 0.0
    for speed in rotor_speed_radps:
        ratio = speed / reference_radps
        total += ratio * ratio
    return total / len(rotor_speed_radps) if rotor_speed_radps else 0.0


def power_ratio(rotor_speed_radps: Sequence[float], reference_radps: float) -> float:
    """Return the mean shaft power relative to the power at the reference speed; power grows with the cube of speed."""
    total = 0.0
    for speed in rotor_speed_radps:
        ratio = speed / reference_radps
        total += ratio * ratio * ratio
    return total / len(rotor_speed_radps) if rotor_speed_radps else 0.0
