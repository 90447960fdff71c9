"""Correction of a peak's position for range migration, which smears the peak over the frame.

An echo that moves by c cells of range from one pulse to the next has, at x cells of range and y cells of speed from
its place, with mu the pulse's number from the middle and W_f the spectrum of the window over the samples,

    R(x, y) = sum over mu of w_slow[mu] W_f(x - c mu) exp(-2 pi i y mu / M')

The position between cells is read from the cells beside the peak as if c were 0 (points.py). That reading, applied to
|R|, differs from the place that R was made for; the difference is taken off, a few times, because it depends on the
place. A transmitter whose turn is delta repetitions later sees the echo c delta cells farther, so its channels have the
phase of R(x - c delta, y). Both are rounded, so that the last bits of cosines do not matter.

Only for complex samples: with real ones the mirror image's side lobes limit the accuracy.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Reading = Callable[[Float64, Float64, Float64], Float64]  # offset from the amplitudes before, at and after the peak

MIN_CELLS = 0.02  # over the frame; less smear has no effect above 1e-5 cells
_ROUNDS = 4
_STEPS = 128  # of the table of W_f in a cell
_REACH = 24  # cells in the table
_DIGITS = 9


class Migration:
    """Correction for the windows of one radar's maps."""

    def __init__(self, fast_window: list[float], fast_padded: int, slow_window: list[float], slow_padded: int) -> None:
        n, size = len(fast_window), fast_padded * _STEPS
        spectrum = np.fft.rfft(np.array(fast_window), size)[: _REACH * _STEPS + 1]
        position = np.arange(len(spectrum)) / _STEPS
        # Counted from the middle of the samples, the spectrum of a symmetric window is real.
        self._table = np.real(spectrum * np.exp(1j * math.pi * position * (n - 1) / fast_padded))
        self._slow = np.array(slow_window)
        self._mu = np.arange(len(slow_window)) - 0.5 * (len(slow_window) - 1)
        self._turn = 2.0 * math.pi * self._mu / slow_padded

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
        range_off[moved] += np.round(x - read_range, _DIGITS)
        speed_off[moved] += np.round(y - read_speed, _DIGITS)
        return range_off, speed_off

    def phases(self, off: tuple[Float64, Float64], cells_per_pulse: Float64, later: float) -> Float64:
        """Return the phase of R in cycles, (n,), for a transmitter whose turn is `later` repetitions off the middle."""
        phase = np.zeros(len(cells_per_pulse))
        moved = np.abs(cells_per_pulse) * self.pulses > MIN_CELLS
        if moved.any():
            x, y, c = off[0][moved], off[1][moved], cells_per_pulse[moved]
            re, im = self._response(-x - c * later, -y, c)
            phase[moved] = np.round(np.arctan2(im, re) / (2.0 * math.pi), _DIGITS)
        return phase

    def _amplitude(self, x: Float64, y: Float64, c: Float64) -> Float64:
        """Return |R| of each echo."""
        re, im = self._response(x, y, c)
        return np.asarray(np.sqrt(re * re + im * im))

    def _response(self, x: Float64, y: Float64, c: Float64) -> tuple[Float64, Float64]:
        """Return the real and the imaginary part of R."""
        position = np.abs(x[:, None] - c[:, None] * self._mu) * _STEPS
        weight = self._slow * np.interp(position, np.arange(len(self._table)), self._table, right=0.0)
        angle = y[:, None] * self._turn
        return np.sum(weight * np.cos(angle), axis=1), -np.sum(weight * np.sin(angle), axis=1)
