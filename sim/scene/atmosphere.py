"""International Standard Atmosphere (ISO 2533:1975) up to 20 km: troposphere and lower stratosphere.

h = r z / (r + z)                                       geopotential height of the geometric height z
p = p0 (1 - L h / T0)^n                                 h <= 11 km
p = p1 e^{-(h - h1) g M / (R T1)}                       11 to 20 km, T1 = 216.65 K
rho = rho0 (p / p0) T0 / (T + dT)                       air that is warmer by dT than the standard, at the same pressure
"""

from __future__ import annotations

from signals._kernel import det_exp, det_log, det_pow

SEA_LEVEL_PA = 101_325.0
SEA_LEVEL_K = 288.15
ZERO_DEGC_K = 273.15
SEA_LEVEL_KGPM3 = 1.225
LAPSE_K_PER_M = 0.0065
# g M / (R L) with g 9.80665, M 0.0289644, R 8.31432 (the standard's own), L 0.0065
EXPONENT = 5.255_876
TROPOPAUSE_M, TROPOPAUSE_K = 11_000.0, 216.65
TOP_M = 20_000.0  # geopotential
LOWEST_M = -5_000.0  # geopotential
_EARTH_RADIUS_M = 6_356_766.0  # of the standard's geopotential
_TROPOPAUSE_PA = SEA_LEVEL_PA * det_pow(TROPOPAUSE_K / SEA_LEVEL_K, EXPONENT)
_SCALE_HEIGHT_M = TROPOPAUSE_K / (EXPONENT * LAPSE_K_PER_M)  # R T1 / (g M)


def geopotential_m(altitude_m: float) -> float:
    """Return the geopotential height of a geometric height above mean sea level."""
    return _EARTH_RADIUS_M * altitude_m / (_EARTH_RADIUS_M + altitude_m)


def pressure_pa(geopotential_height_m: float) -> float:
    """Return the pressure at a geopotential height from -5 to 20 km. Raises ValueError beyond."""
    h = geopotential_height_m
    if not LOWEST_M <= h <= TOP_M:
        raise ValueError(f"the standard atmosphere is modelled from {LOWEST_M:g} to {TOP_M:g} m, not at {h:g} m")
    if h <= TROPOPAUSE_M:
        return SEA_LEVEL_PA * det_pow(1.0 - LAPSE_K_PER_M * h / SEA_LEVEL_K, EXPONENT)
    return _TROPOPAUSE_PA * det_exp(-(h - TROPOPAUSE_M) / _SCALE_HEIGHT_M)


def temperature_k(geopotential_height_m: float) -> float:
    """Return the temperature of the standard at a geopotential height up to 20 km."""
    return SEA_LEVEL_K - LAPSE_K_PER_M * min(geopotential_height_m, TROPOPAUSE_M)


def density_kgpm3(altitude_m: float, warmer_k: float = 0.0) -> float:
    """Return the density at a geometric height above the sea, of air warmer than the standard by so many kelvins."""
    h = geopotential_m(altitude_m)
    share = pressure_pa(h) / SEA_LEVEL_PA
    return SEA_LEVEL_KGPM3 * share * SEA_LEVEL_K / (temperature_k(h) + warmer_k)


def pressure_altitude_m(pressure: float) -> float:
    """Return the geopotential height at a pressure > 0 [Pa], the inverse of `pressure_pa`."""
    if pressure >= _TROPOPAUSE_PA:
        return SEA_LEVEL_K / LAPSE_K_PER_M * (1.0 - det_pow(pressure / SEA_LEVEL_PA, 1.0 / EXPONENT))
    return TROPOPAUSE_M - _SCALE_HEIGHT_M * det_log(pressure / _TROPOPAUSE_PA)
