"""Constant false-alarm rate (CFAR) detection of cells of a map above the noise around them.

With noise alone, a cell is the mean of K receivers' powers: Gamma with shape K and mean s. The noise at a cell under
test is estimated from its training cells: the cells within guard + train in rows and in columns, without those within
guard in both. Rows wrap round (Doppler is periodic), columns do not, so there are fewer training cells at the edges.

    CA  mean of n cells: Gamma with shape a = K n. A cell exceeds alpha times that mean with probability
          P(G_K > t G_a) = P(Beta(a, K) < 1 / (1 + t)),   t = alpha K / a
        for K = 1 this is (1 + alpha / n)^-n, so alpha = n (P^(-1/n) - 1).
    OS  the k-th smallest of n: its distribution is Beta(k, n - k + 1) of the gamma's distribution function, and
          P = integral of p(y) Q_K(alpha K y) dy,     for K = 1:  P = product over i < k of (n - i) / (n - i + alpha)
        The estimate is divided by the quantile k / n of the gamma distribution of mean 1, so that it is the mean power.

A window and zero-padding correlate neighbouring cells. Therefore n is divided by `cells_per_independent`, the mean
number of cells per independent cell (the sum of the squared correlations), and k keeps its share of n.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from sim.radar.processing.parameters import Processing
from sim.radar.processing.range_doppler import RangeDoppler
from sim.radar.processing.windows import cells_per_independent

# Integration of OS in steps of equal ratio: values far below the mean contribute to small probabilities as much as
# values near it.
_PANELS = 4000
_LOG_MIN_VALUE = -25.0
_LOG_MAX_FACTOR = 28.0

Float64 = NDArray[np.float64]
Indices = NDArray[np.intp]


class Cfar:
    """CFAR detector of one radar's maps."""

    def __init__(self, maps: RangeDoppler, receivers: int, processing: Processing) -> None:
        """Raises ValueError for a map that is too small."""
        p = self._p = processing.cfar
        problem = p.problem_with(maps.rows, maps.columns)
        if problem:
            raise ValueError(problem)
        self._shape = (maps.rows, maps.columns)
        self._half = half_rows, half_columns = p.guard_doppler + p.train_doppler, p.guard_range + p.train_range
        doppler, ranges = np.ogrid[-half_rows : half_rows + 1, -half_columns : half_columns + 1]
        self._trains = (abs(doppler) > p.guard_doppler) | (abs(ranges) > p.guard_range)
        self.cells_per_independent = cells_per_independent(
            maps.fast_window, maps.slow_window, maps.fast_padded, maps.slow_padded, self._trains
        )
        # Not training cells: rows in which clutter removal also removed noise, and the first columns.
        self._quiet = np.zeros(self._shape, dtype=bool)
        self._quiet[maps.quiet_rows] = True
        self._quiet[:, : maps.quiet_columns] = True
        windows = self._windows(np.zeros(self._shape, np.float32))
        self._count = np.array([[np.count_nonzero(~np.isnan(w[self._trains])) for w in row] for row in windows])
        self._factor, self._quantile = np.ones(self._shape), 1.0
        if p.kind == "os":
            self._quantile = _gamma_quantile(receivers, p.rank)
        for n in np.unique(self._count):
            independent = max(1.0, n / self.cells_per_independent)
            if p.kind == "os":
                factor = self._quantile * order_statistic_factor(independent, p.rank, receivers, p.false_alarm)
            else:
                factor = cell_averaging_factor(independent, receivers, p.false_alarm)
            # Rounded, because the last bits of the C library's exp and log depend on the CPU.
            self._factor[self._count == n] = float(f"{factor:.10g}")

    def _windows(self, power: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the training cells of each cell, (rows, columns, 2 half rows + 1, 2 half columns + 1); NaN: none."""
        half_rows, half_columns = self._half
        usable = np.where(self._quiet, np.float32(np.nan), power)
        wrapped = np.pad(usable, ((half_rows, half_rows), (0, 0)), mode="wrap")
        padded = np.pad(wrapped, ((0, 0), (half_columns, half_columns)), constant_values=np.nan)
        return sliding_window_view(padded, self._trains.shape)

    def noise(self, power: NDArray[np.float32], rows: Indices, columns: Indices) -> Float64:
        """Return the estimated mean power at some cells; NaN without training cells."""
        cells = self._windows(power)[rows, columns][:, self._trains]
        count = self._count[rows, columns]
        with np.errstate(invalid="ignore"):
            if self._p.kind == "ca":
                mean: Float64 = np.nansum(cells, axis=1, dtype=np.float64) / count
                return mean
            cells.sort(axis=1)  # NaN last
            k = np.clip(np.floor(self._p.rank * count + 0.5).astype(np.intp), 1, np.maximum(count, 1))
            found: Float64 = cells[np.arange(len(cells)), k - 1].astype(np.float64) / self._quantile
            return found

    def threshold(self, rows: Indices, columns: Indices) -> Float64:
        """Return the threshold of cells as a factor of the noise."""
        return self._factor[rows, columns]

    def detect(self, power: NDArray[np.float32]) -> tuple[NDArray[np.bool_], Float64]:
        """Return True for cells above their threshold, and the noise power at each (NaN without training cells)."""
        if power.shape != self._shape:
            raise ValueError("the map is {} x {}, not {} x {}".format(*power.shape, *self._shape))
        rows, columns = (indices.ravel() for indices in np.indices(self._shape))
        noise = self.noise(power, rows, columns).reshape(self._shape)
        return power > self._factor * noise, noise


def cell_averaging_factor(cells: float, receivers: int, false_alarm: float) -> float:
    """Return alpha of CA for the mean of `cells`."""
    from scipy.special import betaincinv

    a = receivers * cells
    return float(cells * (1.0 / betaincinv(a, receivers, false_alarm) - 1.0))


@cache
def order_statistic_factor(cells: float, rank: float, receivers: int, false_alarm: float) -> float:
    """Return alpha of OS as a factor of the k-th smallest value, k = `rank` * `cells`."""
    from scipy.optimize import brentq
    from scipy.special import gammainc, gammaincc

    k = rank * cells  # Beta(k, cells - k + 1)
    x = np.exp(np.linspace(_LOG_MIN_VALUE, math.log(40.0 + 4.0 * receivers), _PANELS))
    with np.errstate(divide="ignore"):  # of weights that are zero
        log_weight = (k - 1.0) * np.log(gammainc(receivers, x)) + (cells - k) * np.log(gammaincc(receivers, x))
    log_weight += receivers * np.log(x) - x
    weight = np.exp(log_weight - log_weight.max())

    def excess(log_alpha: float) -> float:
        return float(np.average(gammaincc(receivers, math.exp(log_alpha) * x), weights=weight)) - false_alarm

    return math.exp(brentq(excess, -_LOG_MAX_FACTOR, _LOG_MAX_FACTOR, xtol=1e-12))


def _gamma_quantile(shape: int, probability: float) -> float:
    """Return the quantile of Gamma(shape) / shape, whose mean is 1."""
    from scipy.special import gammaincinv

    return float(f"{gammaincinv(shape, probability) / shape:.10g}")
