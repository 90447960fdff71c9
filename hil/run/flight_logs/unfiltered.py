"""Gyro and accelerometer without the low-pass that an autopilot put over them before it logged them.

    H(s) = 1 / (s^2 / w^2 + sqrt(2) s / w + 1),   w = 2 pi f_c        Butterworth's filter of second order
    x = B H^-1 y,   B(f) = 1 / (1 + (f / f_b)^8)                      f_b: 2.5 f_c, and at most 0.8 of half the rate

ArduPilot: LowPassFilter2p of INS_GYRO_FILTER and INS_ACCEL_FILTER, 20 Hz by default, a delay of 11 ms. As filtered, a
vehicle seems to have motors slower by a sixth and inertias smaller by 3 %: the filter bends what a delay does not.
B is symmetric in time, so that what is left of the filter delays nothing. H^-1 raises noise by (f / f_c)^2 below f_b.
"""

from __future__ import annotations

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


def unfiltered(series: Series | None, cutoff_hz: float) -> Series | None:
    """Return a series as it was before a low-pass of `cutoff_hz`; unchanged for 0 or if it is sampled too slowly.

    Stretches between gaps are taken by themselves, and continued evenly beyond their ends.
    """
    if series is None or cutoff_hz <= 0.0 or len(series) < 3:
        return series
    steps = np.diff(series.t_s)
    period_s = float(np.median(steps))
    if cutoff_hz * _LEAST_RATE * period_s > 1.0:
        return series
    kernel = _kernel(cutoff_hz, period_s)
    values = series.values.copy()
    bounds = np.r_[0, np.flatnonzero(steps > _GAP * period_s) + 1, len(series)]
    for first, last in pairwise(bounds):
        values[first:last] = _filtered(series.values[first:last], kernel)
    return Series(series.t_s, values)


def _kernel(cutoff_hz: float, period_s: float) -> Array:
    """Return the impulse response of B H^-1, of odd length about its middle."""
    half = round(_HALF_WIDTH_S / period_s)
    count = 8 * (2 * half + 1)
    f = np.fft.rfftfreq(count, period_s)
    s = 1j * f / cutoff_hz
    band_hz = min(_PASSED * cutoff_hz, _OF_HALF_RATE * 0.5 / period_s)
    response = (s * s + np.sqrt(2.0) * s + 1.0) / (1.0 + (f / band_hz) ** 8)
    impulse = np.roll(np.fft.irfft(response, count), half)[: 2 * half + 1]
    return np.asarray(impulse / impulse.sum(), np.float64)


def _filtered(values: Array, kernel: Array) -> Array:
    half = len(kernel) // 2
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(column, kernel, "valid") for column in padded.T])
