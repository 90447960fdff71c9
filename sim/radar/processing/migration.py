"""Correction of a peak's position for range migration, which smears the peak over the frame.

An echo that moves by c cells of range from one pulse to the next has, at x cells of range and y cells of speed from
its place, with mu the pulse's number from the middle and W_f the spectrum of the window over the samples,

    R(x, y) = sum over mu of w_slow[mu] W_f(x - c mu) exp(-2 pi i y mu / M')

The position between cells is read from the cells beside the peak as if c were 0 (points.py). That reading, applied to
|R|, differs from the place that R was made for; the difference is taken off, a few times, because it depends on the
place. A transmitter whose turn is delta repetitions later sees the echo c delta cells farther, so its channels have the
phase of R(x - c delta, y). Cosines and arc tangents are those of detmath.hpp, and sums are in the order of the samples.

Only for complex samples: with real ones the mirror image's side lobes limit the accuracy.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from signals.units import TURN_RAD
from sim._kernels import arc_tangents, cosines_and_sines

Float64 = NDArray[np.float64]
Reading = Callable[[Float64, Float64, Float64], Float64]  # offset from the amplitudes before, at and after the peak

MIN_CELLS = 0.02  # over the frame; less smear has no effect above 1e-5 cells
_ROUNDS = 4
_STEPS = 128  # of the table of W_f in a cell
_REACH = 24  # cells in the table


class Migration:
    """Correction for the windows of one radar's maps."""

    def __init__(self, fast_window: list[float], fast_padded: int, slow_window: list[float], slow_padded: int) -> None:
        n, position = len(fast_window), np.arange(_REACH * _STEPS + 2) / _STEPS
        # Counted from the middle of the samples, the spectrum of a symmetric window is real.
        table = np.full(len(position), fast_window[n // 2] if n % 2 else 0.0)
        for i in range(n // 2):
            turns = position * ((0.5 * (n - 1) - i) / fast_padded)
            table = table + 2.0 * fast_window[i] * _cos_sin((turns - np.rint(turns)) * TURN_RAD)[0]
        table[-1] = 0.0  # beyond the table
        self._table = table
        self._slow = np.array(slow_window)
        self._mu = np.arange(len(slow_window)) - 0.5 * (len(slow_window) - 1)
        self._turn = TURN_RAD * self._mu / slow_padded

    @property
    def pulses(self) -> int:
        return len(self._slow)

    def corrected(
        self, off: tuple[Float64, Float64], cells_per_pulse: Float64, read: tuple[Reading, Reading]
    ) -> tuple[Float64, Float64]:
        """Return offsets in range and speed, (n,) each, from those read; `read`: how they were read, in this order."""
        moved = np.abs(cells_per_pulse) * self.pulses > MIN_CELLS
        range_off, speed_off = off[0].copy(), off[1].copy()
        if not moved.any():
            return range_off, speed_off
        read_range, read_speed, c = off[0][moved], off[1][moved], cells_per_pulse[moved]
        x, y = read_range, read_speed
        for _ in range(_ROUNDS):
            here = self._amplitude(-x, -y, c)
            seen_x = read[0](self._amplitude(-1.0 - x, -y, c), here, self._amplitude(1.0 - x, -y, c))
            seen_y = read[1](self._amplitude(-x, -1.0 - y, c), here, self._amplitude(-x, 1.0 - y, c))
            x, y = read_range - (seen_x - x), read_speed - (seen_y - y)
        range_off[moved] += x - read_range
        speed_off[moved] += y - read_speed
        return range_off, speed_off

    def phases(self, off: tuple[Float64, Float64], cells_per_pulse: Float64, later: float) -> Float64:
        """Return the phase of R in cycles, (n,), for a transmitter whose turn is `later` repetitions off the middle."""
        phase = np.zeros(len(cells_per_pulse))
        moved = np.abs(cells_per_pulse) * self.pulses > MIN_CELLS
        if moved.any():
            x, y, c = off[0][moved], off[1][moved], cells_per_pulse[moved]
            re, im = self._response(-x - c * later, -y, c)
            angle = np.empty(len(re))
            arc_tangents(im, re, angle)
            phase[moved] = angle / TURN_RAD
        return phase

    def _amplitude(self, x: Float64, y: Float64, c: Float64) -> Float64:
        """Return |R| of each echo."""
        re, im = self._response(x, y, c)
        return np.asarray(np.sqrt(re * re + im * im))

    def _response(self, x: Float64, y: Float64, c: Float64) -> tuple[Float64, Float64]:
        """Return the real and the imaginary part of R."""
        last = len(self._table) - 2
        position = np.minimum(np.abs(x[:, None] - c[:, None] * self._mu) * _STEPS, float(last))
        node = np.minimum(position.astype(np.int64), last - 1)
        low = self._table[node]
        weight = self._slow * (low + (position - node) * (self._table[node + 1] - low))
        weight[position >= last] = 0.0
        cosine, sine = _cos_sin((y[:, None] * self._turn).reshape(-1))
        return _sums(weight * cosine.reshape(weight.shape)), -_sums(weight * sine.reshape(weight.shape))


def _cos_sin(angle_rad: Float64) -> tuple[Float64, Float64]:
    cosine, sine = np.empty(len(angle_rad)), np.empty(len(angle_rad))
    cosines_and_sines(angle_rad, cosine, sine)
    return cosine, sine


def _sums(rows: Float64) -> Float64:
    """Return the sum of each row, in the order of its columns."""
    return np.ascontiguousarray(np.add.accumulate(rows, axis=1)[:, -1])
