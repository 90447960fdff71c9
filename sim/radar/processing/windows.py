"""Window functions, symmetric about the middle of N samples.

    hann      1/2 - 1/2 cos x               hamming   0.54 - 0.46 cos x             x = 2 pi (n + 1/2) / N
    blackman  0.42 - 0.5 cos x + 0.08 cos 2x
    taylor    1 + 2 sum over m of F_m cos(m (x - pi)), the first side lobe at -40 dB, 5 nearly equal ones
              (Carrara, Goodman, Majewski, Spotlight Synthetic Aperture Radar, 1995, app. D.2)

Because of the symmetry, an echo has its phase and its position at the middle of the frame. The elementary functions are
those of `signals._kernel`, which give the same bits on every machine.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_log
from sim.radar.processing.parameters import WindowName

_TAYLOR_DB, _TAYLOR_LOBES = 40.0, 5
_STEPS = 64  # steps of the table between bins
_MAX_CORRELATED_BINS = 8  # bins beyond which cells are uncorrelated for any window


def window(name: WindowName, n: int) -> list[float]:
    """Return n weights; their scale is arbitrary."""
    if name == "none":
        return [1.0] * n
    if name == "taylor":
        terms = [1.0, *(2.0 * f for f in _taylor_terms())]
        # cos(m (x - pi)) = (-1)^m cos(m x)
        terms = [term if m % 2 == 0 else -term for m, term in enumerate(terms)]
    else:
        terms = {"hann": [0.5, -0.5], "hamming": [0.54, -0.46], "blackman": [0.42, -0.5, 0.08]}[name]
    weights = []
    for i in range(n):
        x = 2.0 * pi * (i + 0.5) / n
        weight = 0.0
        for m, term in enumerate(terms):
            weight += term * det_cos(m * x)
        weights.append(weight)
    return weights


def _taylor_terms() -> list[float]:
    """Return F_1 ... F_(lobes - 1)."""
    ratio = 1.0
    for _ in range(int(_TAYLOR_DB / 20.0)):
        ratio *= 10.0
    a = det_log(ratio + sqrt(ratio * ratio - 1.0)) / pi
    half = _TAYLOR_LOBES - 0.5
    s2 = _TAYLOR_LOBES * _TAYLOR_LOBES / (a * a + half * half)
    terms = []
    for m in range(1, _TAYLOR_LOBES):
        numerator, denominator = 1.0, 1.0
        for k in range(1, _TAYLOR_LOBES):
            numerator *= 1.0 - m * m / s2 / (a * a + (k - 0.5) * (k - 0.5))
            if k != m:
                denominator *= 1.0 - m * m / (k * k)
        terms.append((1.0 if m % 2 else -1.0) * numerator / (2.0 * denominator))
    return terms


def response(weights: list[float], bins: float, padded: int) -> float:
    """Return W at `bins` of a transform over `padded`: sum of w cos(2 pi bins (n - middle) / padded), a real number."""
    middle = 0.5 * (len(weights) - 1)
    total = 0.0
    for i, w in enumerate(weights):
        total += w * det_cos(2.0 * pi * bins * (i - middle) / padded)
    return total


def ratio_table(weights: list[float], padded: int) -> list[float]:
    """Return the ratio (a+ - a-) / (a- + a0 + a+) of echoes 0 ... 0.5 bins above their cell (points.py)."""
    table: list[float] = []
    for step in range(_STEPS + 1):
        d = 0.5 * step / _STEPS
        before, here, after = (abs(response(weights, b, padded)) for b in (1.0 + d, d, 1.0 - d))
        ratio = (after - before) / (before + here + after)
        # At d = 0 some windows are flat, but rounding must not make the table fall.
        table.append(max(ratio, table[-1] + 1e-12) if table else 0.0)
    return table


def side_lobes(weights: list[float], padded: int, cells: int) -> tuple[list[float], int]:
    """Return the greatest relative power beyond each distance from a peak, and the cell of the first side lobe.

    Element d = 0 ... cells holds the greatest power at `d - 1/2` or more cells from the peak, beyond the main lobe's
    edge without the main lobe.
    """
    step = 0.25
    peak = response(weights, 0.0, padded)
    power = []
    for i in range(int(padded / 2 / step) + 1):
        ratio = response(weights, i * step, padded) / peak
        power.append(ratio * ratio)
    null = next((i for i in range(1, len(power) - 1) if power[i + 1] > power[i]), len(power) - 1)
    farther, greatest = [0.0] * len(power), 0.0
    for i in range(len(power) - 1, -1, -1):
        greatest = max(greatest, power[i])
        farther[i] = greatest
    null_cell = int(null * step + 0.999)
    table = []
    for d in range(cells + 1):
        first = max(0, int((d - 0.5) / step)) if d <= null_cell else max(null, int((d - 0.5) / step))
        table.append(farther[min(first, len(farther) - 1)])
    return table, null_cell


def correlation(weights: list[float], lag: int, padded: int) -> float:
    """Return the squared correlation of noise between cells `lag` apart, which is that of their powers."""
    squares = [w * w for w in weights]
    share = response(squares, float(lag), padded) / response(squares, 0.0, padded)
    return share * share


def cells_per_independent(
    fast: list[float], slow: list[float], fast_padded: int, slow_padded: int, trains: NDArray[np.bool_]
) -> float:
    """Return the number of training cells per independent cell: the mean sum of squared correlations.

    `trains`: True for training cells, Doppler by range.
    """
    rho = []
    for weights, padded, size in ((slow, slow_padded, trains.shape[0]), (fast, fast_padded, trains.shape[1])):
        reach = _MAX_CORRELATED_BINS * max(1, padded // len(weights))
        by_lag = [correlation(weights, lag, padded) if lag <= reach else 0.0 for lag in range(size)]
        indices = np.arange(size)
        rho.append(np.array(by_lag)[np.abs(indices[:, None] - indices)])
    correlated = trains * (rho[0] @ trains @ rho[1])
    return max(1.0, float(correlated.sum()) / float(trains.sum()))
