"""Static reflectors in a recording, found in its mean chirp and separated from leakage. Offline.

    p_k[n] = sum over echoes of e^{a t} (c cos(2 pi b t) + d sin(2 pi b t)) + leakage,      t = (n - (N - 1) / 2) / N

for each receiver k. b is the echo's position in bins (b times the range resolution), a its growth over the chirp, and
sqrt(c^2 + d^2) its amplitude at the middle. Echoes are found one after another in the Hann spectrum, strongest first,
and fitted together by Gauss-Newton with the Hann window as weight, so that leakage in the lowest bins hardly affects
them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.radar.chirp import Chirp

Float64 = NDArray[np.float64]

FIRST_BIN = 6.0  # below this bin a reflector cannot be separated from leakage and its turn-on
STRONG_DB = 35.0  # above range-Doppler noise; side lobes of leakage and clutter of a room are weaker
MAX_ECHOES = 8
_POSITIONS_PER_BIN = 8  # of the search
_STEPS = 12
_MAX_STEP = (0.2, 0.5)  # of b [bins] and a, so that a step stays within the peak
_MAX_GROWTH = 6.0  # of a: 52 dB over the chirp


@dataclass(frozen=True)
class StaticEcho:
    """Static reflector. Sequences have one value per receiver."""

    position_bins: tuple[float, ...]
    growth: tuple[float, ...]  # a
    cosine: tuple[float, ...]  # c
    sine: tuple[float, ...]  # d
    snr_db: float  # peak over range-Doppler noise, rms over receivers
    range_m: float

    @property
    def amplitude(self) -> tuple[float, ...]:
        """Amplitude at the middle of the chirp [counts]."""
        return tuple(float(np.hypot(c, d)) for c, d in zip(self.cosine, self.sine, strict=True))


def find_static_echoes(pattern: Float64, noise: Float64, chirp: Chirp) -> list[StaticEcho]:
    """Return the echoes in the mean chirp (K, N), nearest first. `noise`: range-Doppler noise per receiver [counts]."""
    n = pattern.shape[1]
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / n)
    found: list[float] = []
    levels: list[float] = []
    parameters = np.zeros((len(pattern), 0, 4))
    residual = pattern
    while len(found) < MAX_ECHOES:
        spectrum = np.abs(np.fft.rfft(residual * window, _POSITIONS_PER_BIN * n, axis=-1)) * (2.0 / window.sum())
        level = np.sqrt(((spectrum / noise[:, None]) ** 2).mean(axis=0))
        peak = _peak(level)
        if peak is None:
            break
        found.append(peak / _POSITIONS_PER_BIN)
        levels.append(20.0 * float(np.log10(level[peak])))
        fitted = np.stack([_fit(row, window, found, parameters[k]) for k, row in enumerate(pattern)])
        # Two echoes less than a bin apart: the residual of a peak is not a sine, and more sines would not fit it.
        positions = np.sort(fitted[:, :, 0], axis=1)
        if len(found) > 1 and np.diff(positions, axis=1).min() < 1.0:
            found.pop()
            levels.pop()
            break
        parameters = fitted
        residual = pattern - np.stack([_model(n, parameters[k]) for k in range(len(pattern))])
    echoes = []
    for i, snr_db in enumerate(levels):
        b, a, c, d = (tuple(float(v) for v in parameters[:, i, j]) for j in range(4))
        echoes.append(StaticEcho(b, a, c, d, snr_db, float(np.mean(b)) * chirp.range_resolution_m))
    return sorted(echoes, key=lambda echo: echo.range_m)


def echo_pattern(echoes: list[StaticEcho], receivers: int, samples: int) -> Float64:
    """Return the part of the echoes in the mean chirp, (K, N)."""
    total = np.zeros((receivers, samples))
    for echo in echoes:
        rows = zip(echo.position_bins, echo.growth, echo.cosine, echo.sine, strict=True)
        for k, row in enumerate(rows):
            total[k] += _model(samples, np.array([row]))
    return total


def _peak(level: Float64) -> int | None:
    """Return the index of the greatest local maximum that is strong enough, in 1 / _POSITIONS_PER_BIN bins."""
    inner = level[1:-1]
    local = np.flatnonzero((inner >= level[:-2]) & (inner > level[2:])) + 1
    strong = local[(local >= FIRST_BIN * _POSITIONS_PER_BIN) & (level[local] >= 10.0 ** (STRONG_DB / 20.0))]
    return int(strong[level[strong].argmax()]) if len(strong) else None


def _fit(row: Float64, window: Float64, positions: list[float], known: Float64) -> Float64:
    """Return b, a, c, d of each echo, (echoes, 4), starting from the fit `known` and, for a new echo, its position."""
    n = len(row)
    shape = np.zeros((len(positions), 2))
    shape[:, 0] = positions
    shape[: len(known)] = known[:, :2]
    for _ in range(_STEPS):
        amplitude = _amplitudes(row, window, shape)
        model = np.column_stack([shape, amplitude])
        slope = np.concatenate([_bases(n, shape), _slopes(n, model)], axis=1)
        change = np.linalg.lstsq(slope * window[:, None], (row - _model(n, model)) * window, rcond=1e-9)[0]
        step = change[2 * len(positions) :].reshape(-1, 2)
        shape = shape + np.clip(step, [-g for g in _MAX_STEP], _MAX_STEP)
        shape[:, 1] = np.clip(shape[:, 1], -_MAX_GROWTH, _MAX_GROWTH)
    return np.column_stack([shape, _amplitudes(row, window, shape)])


def _amplitudes(row: Float64, window: Float64, shape: Float64) -> Float64:
    bases = _bases(len(row), shape)
    found = np.linalg.lstsq(bases * window[:, None], row * window, rcond=None)[0]
    return np.asarray(found, np.float64).reshape(-1, 2)


def _time(n: int) -> Float64:
    return (np.arange(n) - 0.5 * (n - 1)) / n


def _bases(n: int, shape: Float64) -> Float64:
    """Return cosine and sine of each echo, (n, 2 echoes)."""
    t = _time(n)[:, None]
    phase, growth = 2.0 * np.pi * shape[:, 0] * t, np.exp(shape[:, 1] * t)
    return np.stack([growth * np.cos(phase), growth * np.sin(phase)], axis=-1).reshape(n, -1)


def _slopes(n: int, model: Float64) -> Float64:
    """Return the derivatives of the model by b and a of each echo, (n, 2 echoes)."""
    t = _time(n)[:, None]
    phase, growth = 2.0 * np.pi * model[:, 0] * t, np.exp(model[:, 1] * t)
    cosine, sine = growth * np.cos(phase), growth * np.sin(phase)
    by_position = 2.0 * np.pi * t * (model[:, 3] * cosine - model[:, 2] * sine)
    by_growth = t * (model[:, 2] * cosine + model[:, 3] * sine)
    return np.stack([by_position, by_growth], axis=-1).reshape(n, -1)


def _model(n: int, model: Float64) -> Float64:
    if not len(model):
        return np.zeros(n)
    return _bases(n, model[:, :2]) @ model[:, 2:].reshape(-1)
