"""Gyro and accelerometer without the low-pass that an autopilot put over them before it logged them.

    H(f) = 1 / (1 + sqrt(2) S + S^2),  S = j tan(pi f / f_s) / tan(pi f_c / f_d)
    x = B H^-1 y,   B(f) = 1 / (1 + (f / f_b)^8)                  f_b: 2.5 f_c, and at most 0.8 of half the log's rate

H: ArduPilot's LowPassFilter2p of INS_GYRO_FILTER and INS_ACCEL_FILTER, 20 Hz by default, a delay of 11 ms:
Butterworth's filter by the bilinear transform, with coefficients for the rate f_d, run at f_s. As filtered, a vehicle
seems to have motors slower by a sixth and inertias smaller by 3 %: the filter bends what a delay does not.

B is symmetric in time, so that what is left of the filter delays nothing. What it takes from the readings it has to
take from the commands as well, else motors that follow every command seem slower: a kernel over the samples of a held
command passes through motors and vehicle as it does over the readings, as far as what it takes is small. So all signals
of a log have one band. H^-1 raises noise by (f / f_c)^2 below f_b.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.flight_log import Series

Array = NDArray[np.float64]

_PASSED = 2.5  # of the cut-off
_OF_HALF_RATE = 0.8
_HALF_WIDTH_S = 0.25  # the kernel has faded to 1e-4 by then
_GAP = 1.5  # periods
_LEAST_RATE = 4.0  # samples per period of the cut-off; below it there is nothing to restore


@dataclass(frozen=True)
class LowPass:
    """A filter of second order: cut-off, and the rates that it was designed for and runs at [Hz]."""

    cutoff_hz: float
    designed_hz: float
    rate_hz: float

    def inverse(self, f: Array) -> NDArray[np.complex128]:
        """Return H^-1 at frequencies below half of both rates."""
        s = 1j * np.tan(np.pi * f / self.rate_hz) / np.tan(np.pi * self.cutoff_hz / self.designed_hz)
        return np.asarray(1.0 + np.sqrt(2.0) * s + s * s)

    @property
    def passed_hz(self) -> float:
        """The cut-off at the rate at which it runs."""
        return self.rate_hz / np.pi * float(np.arctan(np.tan(np.pi * self.cutoff_hz / self.designed_hz)))


def band_of(filters: list[LowPass], period_s: float) -> float:
    """Return f_b of a log that has these filters and this period of its samples; 0 if there is nothing to restore."""
    highest_hz = max((x.passed_hz for x in filters), default=0.0)
    if highest_hz * _LEAST_RATE * period_s > 1.0:
        return 0.0
    return min(_PASSED * highest_hz, _OF_HALF_RATE * 0.5 / period_s)


def within_band(series: Series | None, band_hz: float, low_pass: LowPass | None = None) -> Series | None:
    """Return a series below `band_hz`, and as it was before `low_pass`; unchanged for 0.

    Stretches between gaps are taken by themselves, and continued evenly beyond their ends.
    """
    if series is None or band_hz <= 0.0 or len(series) < 3:
        return series
    steps = np.diff(series.t_s)
    period_s = float(np.median(steps))
    kernel = _kernel(band_hz, period_s, low_pass)
    values = series.values.copy()
    bounds = np.r_[0, np.flatnonzero(steps > _GAP * period_s) + 1, len(series)]
    for first, last in pairwise(bounds):
        values[first:last] = _filtered(series.values[first:last], kernel)
    return Series(series.t_s, values)


def _kernel(band_hz: float, period_s: float, low_pass: LowPass | None) -> Array:
    """Return the impulse response of B H^-1, of odd length about its middle."""
    half = round(_HALF_WIDTH_S / period_s)
    count = 8 * (2 * half + 1)
    f = np.fft.rfftfreq(count, period_s)
    response = np.ones(len(f), np.complex128)
    if low_pass is not None:
        below = f < 0.5 * low_pass.rate_hz * (1.0 - 1e-6)
        response[below] = low_pass.inverse(np.asarray(f[below], np.float64))
        response[~below] = 0.0
    response /= 1.0 + (f / band_hz) ** 8
    impulse = np.roll(np.fft.irfft(response, count), half)[: 2 * half + 1]
    return np.asarray(impulse / impulse.sum(), np.float64)


def _filtered(values: Array, kernel: Array) -> Array:
    half = len(kernel) // 2
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(column, kernel, "valid") for column in padded.T])
