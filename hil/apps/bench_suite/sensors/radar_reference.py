"""Radar samples straight from the equation of sim.radar.synthesis, in numpy's longest floating point type.

Slow, and independent of what it judges: nothing is expanded, separated or reduced but the phase by whole cycles. On
x86 a longdouble has 64 bits of mantissa: 1e5 cycles are good to 1e-14 of a cycle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.echoes import Echoes
from sim.radar.virtual_array import VirtualArray, as_array

Real = np.longdouble
PI = Real("3.141592653589793238462643383279502884")


def reference(
    chirp: Chirp,
    array: VirtualArray | Sequence[Vec3],
    echoes: Echoes,
    *,
    hp_cutoff_hz: float | None = None,
    aaf_cutoff_hz: float | None = None,
) -> NDArray[np.longdouble]:
    """Return (channels, chirps, samples); with complex samples a receiver has two channels."""
    array = as_array(array)
    transmits = _transmits(array, chirp.chirps)
    c, f_c, bandwidth = Real(SPEED_OF_LIGHT_MPS), Real(chirp.center_frequency_hz), Real(chirp.bandwidth_hz)
    rate, repetition = Real(chirp.sample_rate_hz), Real(chirp.repetition_s)
    slope = bandwidth * rate / chirp.samples
    m = np.arange(chirp.chirps, dtype=Real)[:, None]
    n = np.arange(chirp.samples, dtype=Real)[None, :]
    t = (m - Real(chirp.chirps - 1) / 2) * repetition + (n - Real(chirp.samples - 1) / 2) / rate
    sweep_hz = f_c - bandwidth / 2 + slope * (n / rate)
    out = np.zeros((len(array.rx_positions_m) * chirp.parts, chirp.chirps, chirp.samples), Real)
    for i in range(len(echoes.range_m)):
        distance, speed = Real(echoes.range_m[i]), Real(echoes.speed_mps[i])
        tau = 2 * (distance + speed * t) / c
        cycles = sweep_hz * tau - slope * tau * tau / 2
        beat_hz = slope * 2 * distance / c
        gain, turn = Real(echoes.amplitude[i]), Real(0)
        if hp_cutoff_hz is not None:
            gain *= beat_hz / np.sqrt(beat_hz**2 + Real(hp_cutoff_hz) ** 2)
            turn += np.arctan2(Real(hp_cutoff_hz), beat_hz)
        if aaf_cutoff_hz is not None:
            gain /= np.sqrt(1 + (beat_hz / Real(aaf_cutoff_hz)) ** 2)
            turn -= np.arctan2(beat_hz, Real(aaf_cutoff_hz))
        for t_p, (sends, shift) in zip(array.tx_positions_m, transmits, strict=True):
            for k, r_k in enumerate(array.rx_positions_m):
                leaves = echoes.direction_R[i] if echoes.out_direction_R is None else echoes.out_direction_R[i]
                places = zip(t_p, r_k, leaves, echoes.direction_R[i], strict=True)
                path = sum((Real(a) * Real(o) + Real(b) * Real(d) for a, b, o, d in places), Real(0))
                phase = cycles - path * f_c / c + shift[:, None]
                angle = 2 * PI * (phase - np.rint(phase)) + turn
                out[k * chirp.parts] += gain * sends[:, None] * np.cos(angle)
                if chirp.parts == 2:
                    out[k * 2 + 1] += gain * sends[:, None] * np.sin(angle)
    return out


def _transmits(array: VirtualArray, chirps: int) -> list[tuple[NDArray[np.longdouble], NDArray[np.longdouble]]]:
    """Return for each transmitter the chirps in which it sends, 1 or 0, and its additional phase in cycles."""
    m, count = np.arange(chirps), array.transmitters
    if array.doppler_bands:
        return [
            (np.ones(chirps, Real), (p * m % array.doppler_bands).astype(Real) / array.doppler_bands)
            for p in range(count)
        ]
    return [((m % count == p).astype(Real), np.zeros(chirps, Real)) for p in range(count)]
