"""The same frame by finufft (Barnett, Magland, af Klinteberg, SIAM J. Sci. Comput. 41, 2019), for comparison.

It is given the same decomposition: the separable part of the phase as a type-1 transform in (chirp, sample), and range
migration by as many nodes in speed as the tolerance needs; one call transforms all nodes and receivers over the same
points. Weights are made with numpy; `transform_s` is the time of finufft
alone, the floor of whatever could be built on it.
"""

from __future__ import annotations

import time
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.echoes import Echoes
from sim.sensors.radar_parameters import RadarParameters

Float64 = NDArray[np.float64]
Complex128 = NDArray[np.complex128]
_TURN = 2.0 * np.pi


def finufft_module() -> Any | None:
    """finufft, or None where it is not installed."""
    try:
        return import_module("finufft")
    except ImportError:
        return None


def if_response(chirp: Chirp, range_m: Float64, hp_cutoff_hz: float | None, aaf_cutoff_hz: float | None) -> Complex128:
    """H(f) at the beat frequency of each range."""
    f = chirp.slope_hz_per_s * 2.0 * range_m / SPEED_OF_LIGHT_MPS
    gain = np.ones(len(f), np.complex128)
    if hp_cutoff_hz is not None:
        gain *= 1j * f / (hp_cutoff_hz + 1j * f)
    if aaf_cutoff_hz is not None:
        gain /= 1.0 + 1j * f / aaf_cutoff_hz
    return gain


class FinufftRadar:
    """A radar frame by `nodes` transforms a receiver."""

    def __init__(self, p: RadarParameters, *, tolerance: float, nodes: int) -> None:
        self._finufft = import_module("finufft")
        self._chirp, self._rx = p.chirp, np.asarray(p.antenna.rx_positions_m, np.float64)
        self._cutoffs = p.receiver.hp_cutoff_hz, p.receiver.aaf_cutoff_hz
        self._tolerance, self._nodes = tolerance, nodes
        self.transform_s = 0.0  # of the last frame

    def synthesize(self, echoes: Echoes, out: Float64) -> None:
        """As Synthesizer.synthesize."""
        c, k, n_rx = self._chirp, self._nodes, len(self._rx)
        tau, rate = 2.0 * echoes.range_m / SPEED_OF_LIGHT_MPS, 2.0 * echoes.speed_mps / SPEED_OF_LIGHT_MPS
        slope, t0 = c.slope_hz_per_s, 0.5 * (c.samples - 1) / c.sample_rate_hz
        carrier = c.start_frequency_hz + slope * t0 - slope * tau
        slow = rate * c.repetition_s * carrier
        fast = (rate * carrier + slope * tau) / c.sample_rate_hz
        phase = np.remainder(c.start_frequency_hz * tau + slope * t0 * tau - 0.5 * slope * tau * tau, 1.0)
        phase += 0.5 * (slow + fast)  # samples lie half way between the modes of the transform
        slow, fast = np.remainder(slow, 1.0), np.remainder(fast, 1.0)
        weight = echoes.amplitude * if_response(c, echoes.range_m, *self._cutoffs) * np.exp(1j * _TURN * phase)
        steering = np.exp(-1j * _TURN / c.wavelength_m * (self._rx @ echoes.direction_R.T))
        low, high = float(echoes.speed_mps.min()), float(echoes.speed_mps.max())
        at = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (2 * np.arange(k) + 1) / (2 * k))
        from scipy.interpolate import BarycentricInterpolator  # with the rival, optional

        basis = BarycentricInterpolator(at, np.eye(k))(echoes.speed_mps).T  # one at a node, nothing at the others
        weights = (basis[:, None, :] * (steering * weight)[None, :, :]).reshape(k * n_rx, -1)
        real, whole = (np.float64, np.complex128) if self._tolerance < 1e-5 else (np.float32, np.complex64)
        x, y = (_TURN * slow).astype(real), (_TURN * fast).astype(real)
        weights = np.ascontiguousarray(weights, whole)
        began = time.perf_counter()
        modes = self._finufft.nufft2d1(
            x,
            y,
            weights if k * n_rx > 1 else weights[0],
            (c.chirps, c.samples),
            eps=self._tolerance,
            isign=1,
            nthreads=1,
        )
        self.transform_s = time.perf_counter() - began
        modes = np.asarray(modes, np.complex128).reshape(k, n_rx, c.chirps, c.samples)
        out[:] = np.einsum("kmn,krmn->rmn", self._remainder(at), modes).real

    def _remainder(self, speed_mps: Float64) -> Complex128:
        """What the transform leaves out, for each of the speeds: exp(2 pi i (S t' t tau' - S t^2 tau'^2 / 2))."""
        c = self._chirp
        fast_s = (np.arange(c.samples) - 0.5 * (c.samples - 1)) / c.sample_rate_hz
        t_s = (np.arange(c.chirps) - 0.5 * (c.chirps - 1))[:, None] * c.repetition_s + fast_s
        rate = (2.0 * speed_mps / SPEED_OF_LIGHT_MPS)[:, None, None]
        cycles = c.slope_hz_per_s * (rate * fast_s * t_s - 0.5 * (rate * t_s) ** 2)
        return np.asarray(np.exp(1j * _TURN * cycles))
