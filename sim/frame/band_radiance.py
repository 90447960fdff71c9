"""Radiance of a black body in the band of uncooled thermal cameras, 8 to 14 micrometres, and its inverse.

    L(T) = sigma T^4 / pi (F(14 um T) - F(8 um T))
    F(lambda T) = 15 / pi^4 sum over n of exp(-n x) / n (x^3 + 3 x^2 / n + 6 x / n^2 + 6 / n^3),   x = c_2 / (lambda T)

(Chang and Rhee, Int. Comm. Heat Mass Transfer 11, 1984). Arrays go through tables: L of T at every 0.1 K, and T at
equal steps of L, with linear interpolation: below 1e-6 of L and 0.1 mK of T from 200 K on. Temperatures and radiances
beyond the tables count as their ends.

Determinism: tables by det_*, arrays by + - * / and comparisons of single elements.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_exp
from signals.units import STEFAN_BOLTZMANN_W_PER_M2_K4

Float64 = NDArray[np.float64]

BAND_UM = (8.0, 14.0)
LOWEST_K, HIGHEST_K = 120.0, 450.0
_PI = 3.141592653589793
_C2_UM_K = 14_387.76877
_PER_K = 10  # nodes
_NODES = 16_384  # of the inverse
_TERMS = 24


def share_below(wavelength_um: float, temperature_k: float) -> float:
    """Return the share F of a black body's light with shorter wavelengths."""
    x = _C2_UM_K / (wavelength_um * temperature_k)
    total = 0.0
    for n in range(_TERMS, 0, -1):
        total += det_exp(-n * x) / n * (x * x * x + 3.0 * x * x / n + 6.0 * x / (n * n) + 6.0 / (n * n * n))
    return 15.0 / _PI**4 * total


def band_radiance(temperature_k: float) -> float:
    """Return L [W / (m2 sr)] of one temperature, without a table."""
    low, high = BAND_UM
    square = temperature_k * temperature_k
    share = share_below(high, temperature_k) - share_below(low, temperature_k)
    return STEFAN_BOLTZMANN_W_PER_M2_K4 * square * square / _PI * share


class _Tables(NamedTuple):
    radiance: Float64  # of LOWEST_K and every 1 / _PER_K after it
    temperature_k: Float64  # of the lowest radiance and every `step` after it
    step: float


@cache
def _tables() -> _Tables:
    count = int((HIGHEST_K - LOWEST_K) * _PER_K) + 1
    radiance = np.array([band_radiance(LOWEST_K + k / _PER_K) for k in range(count)])
    step = float(radiance[-1] - radiance[0]) / (_NODES - 1)
    wanted = radiance[0] + step * np.arange(_NODES)
    at = np.minimum(np.searchsorted(radiance, wanted, side="right") - 1, count - 2)
    below, above = radiance[at], radiance[at + 1]
    temperature = LOWEST_K + (at + (wanted - below) / (above - below)) / _PER_K
    return _Tables(radiance, temperature, step)


def radiance_of(temperature_k: Float64) -> Float64:
    """Return L of temperatures, elementwise."""
    return _interpolated(_tables().radiance, (temperature_k - LOWEST_K) * _PER_K)


def temperature_of(radiance: Float64) -> Float64:
    """Return the temperatures of black bodies with these radiances, elementwise."""
    tables = _tables()
    return _interpolated(tables.temperature_k, (radiance - tables.radiance[0]) / tables.step)


def _interpolated(table: Float64, place: Float64) -> Float64:
    place = np.minimum(np.maximum(place, 0.0), len(table) - 1.0)
    node = np.minimum(place.astype(np.int64), len(table) - 2)
    low = table[node]
    return low + (place - node) * (table[node + 1] - low)
