"""International Standard Atmosphere (ISO 2533:1975), troposphere."""

from __future__ import annotations

from signals._kernel import det_pow

SEA_LEVEL_PA = 101_325.0
SEA_LEVEL_K = 288.15
LAPSE_K_PER_M = 0.0065
# g M / (R L) with g 9.80665, M 0.0289644, R 8.31447, L 0.0065
EXPONENT = 5.255_876
TROPOPAUSE_M = 11_000.0


def pressure_pa(altitude_m: float) -> float:
    """Return p = p0 (1 - L h / T0)^n at height h above mean sea level, for h <= 11 km; constant above."""
    h = altitude_m if altitude_m < TROPOPAUSE_M else TROPOPAUSE_M
    return SEA_LEVEL_PA * det_pow(1.0 - LAPSE_K_PER_M * h / SEA_LEVEL_K, EXPONENT)


def pressure_altitude_m(pressure: float) -> float:
    """Return the height above mean sea level [m] at a pressure [Pa], the inverse of `pressure_pa`."""
    return SEA_LEVEL_K / LAPSE_K_PER_M * (1.0 - det_pow(pressure / SEA_LEVEL_PA, 1.0 / EXPONENT))
