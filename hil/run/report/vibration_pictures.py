"""Spectra of vibration for the report.

One-sided power spectral density by Welch's method (IEEE Trans. Audio Electroacoustics 15, 1967): Hann windows that
overlap by half. What lies above half the sample rate appears folded, as in the samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.run.report import figures

_WINDOW = 512  # samples


def density(values: NDArray[np.float64], rate_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies [Hz] and the one-sided density of each column, in its unit squared per Hz."""
    window = np.hanning(_WINDOW + 1)[:-1, None]
    starts = range(0, len(values) - _WINDOW + 1, _WINDOW // 2)
    power = np.zeros((_WINDOW // 2 + 1, values.shape[1]))
    for start in starts:
        part = values[start : start + _WINDOW]
        power += np.abs(np.fft.rfft((part - part.mean(axis=0)) * window, axis=0)) ** 2
    power *= 2.0 / (len(starts) * rate_hz * float((window**2).sum()))
    power[[0, -1]] *= 0.5
    hz: NDArray[np.float64] = np.linspace(0.0, 0.5 * rate_hz, _WINDOW // 2 + 1, dtype=np.float64)
    return hz, power


def vibration_pictures(
    out: Path, samples: Mapping[str, NDArray[np.float64]], rates_hz: Mapping[str, float]
) -> list[tuple[str, Path]]:
    """Draw the spectrum of specific force and rate of each IMU (n, 6) into a file of its own."""
    pictures = []
    for name, values in samples.items():
        hz, power = density(values, rates_hz[name])
        root = np.sqrt(power)
        figure = figures.spectrum_figure(hz[1:], root[1:, :3], root[1:, 3:], name)
        path = figures.save(figure, out / f"vibration_{name}.png")
        pictures.append((f"Spectrum of the samples of {name} over the whole flight", path))
    return pictures
