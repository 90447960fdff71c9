"""Point targets as a radar records them, from the phase of the model, for tests of the processing chain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp

CHIRP = Chirp(
    center_frequency_hz=60.8e9, bandwidth_hz=0.4e9, samples=64, sample_rate_hz=2e6, chirps=64, repetition_s=390.975e-6
)
L_ARRAY = ((0.0, 2.5e-3, 0.0), (0.0, 0.0, 2.5e-3), (0.0, 0.0, 0.0))
Target = tuple[float, float, float, float, float]  # range_m, speed_mps, azimuth_deg, elevation_deg, amplitude


def direction(azimuth_deg: float, elevation_deg: float) -> NDArray[np.float64]:
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def signal_of(
    targets: Sequence[Target], chirp: Chirp = CHIRP, rx: Sequence[Sequence[float]] = L_ARRAY
) -> NDArray[np.float64]:
    """Return (receivers, chirps, samples), without noise or offset."""
    n, m = np.arange(chirp.samples)[None, :], np.arange(chirp.chirps)[:, None]
    t_n = n / chirp.sample_rate_hz
    t = (m - (chirp.chirps - 1) / 2) * chirp.repetition_s + (n - (chirp.samples - 1) / 2) / chirp.sample_rate_hz
    f0, slope = chirp.start_frequency_hz, chirp.slope_hz_per_s
    out = np.zeros((len(rx), chirp.chirps, chirp.samples))
    for range_m, speed_mps, azimuth_deg, elevation_deg, amplitude in targets:
        tau = 2.0 * (range_m + speed_mps * t) / SPEED_OF_LIGHT_MPS
        phase = 2.0 * np.pi * (f0 * tau % 1.0 + slope * t_n * tau - 0.5 * slope * tau**2)
        d = direction(azimuth_deg, elevation_deg)
        for k, r in enumerate(rx):
            out[k] += amplitude * np.cos(phase - 2.0 * np.pi * np.dot(r, d) / chirp.wavelength_m)
    return out


def counts(
    signal: NDArray[np.float64], *, noise: float = 0.0, seed: int = 0, offset: float = 2048.0
) -> NDArray[np.uint16]:
    """Return the signal rounded to counts, with white noise."""
    rng = np.random.default_rng(seed)
    return np.floor(signal + offset + noise * rng.standard_normal(signal.shape) + 0.5).astype(np.uint16)
