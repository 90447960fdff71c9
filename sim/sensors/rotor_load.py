"""Load of the rotors from their speeds alone: proxies for their effect on barometer and magnetometer."""

from __future__ import annotations

from collections.abc import Sequence


def thrust_ratio(rotor_speed_radps: Sequence[float], reference_radps: float) -> float:
    """Return the mean thrust relative to that at the reference speed: thrust goes with the square of speed."""
    total = 0.0
    for speed in rotor_speed_radps:
        ratio = speed / reference_radps
        total += ratio * ratio
    return total / len(rotor_speed_radps) if rotor_speed_radps else 0.0


def power_ratio(rotor_speed_radps: Sequence[float], reference_radps: float) -> float:
    """Return the mean shaft power relative to that at the reference speed: power goes with the cube of speed."""
    total = 0.0
    for speed in rotor_speed_radps:
        ratio = speed / reference_radps
        total += ratio * ratio * ratio
    return total / len(rotor_speed_radps) if rotor_speed_radps else 0.0
