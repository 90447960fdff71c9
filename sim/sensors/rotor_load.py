"""How hard the rotors work, from their speeds alone: proxies for what disturbs barometer and magnetometer."""

from __future__ import annotations

from collections.abc import Sequence


def thrust_ratio(rotor_speed_radps: Sequence[float], reference_radps: float) -> float:
    """Mean thrust as a fraction of that at the reference speed: thrust goes with the square of speed."""
    total = 0.0
    for speed in rotor_speed_radps:
        ratio = speed / reference_radps
        total += ratio * ratio
    return total / len(rotor_speed_radps) if rotor_speed_radps else 0.0


def power_ratio(rotor_speed_radps: Sequence[float], reference_radps: float) -> float:
    """Mean shaft power, and so battery current, as a fraction of that at the reference speed: it goes with the cube."""
    total = 0.0
    for speed in rotor_speed_radps:
        ratio = speed / reference_radps
        total += ratio * ratio * ratio
    return total / len(rotor_speed_radps) if rotor_speed_radps else 0.0
