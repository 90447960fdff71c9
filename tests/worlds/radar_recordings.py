"""Radar impairments with round numbers, and recordings made from them, for tests that know the truth."""

from __future__ import annotations

from math import cos, exp, pi
from typing import Any

import numpy as np

from sim.radar.adc import RadarReceiverChain
from sim.radar.chirp import Chirp
from sim.radar.impairments import Adc, DcWander, FrameStart, Impairments, Leakage, ReceiverNoise
from sim.radar.recording import Recording
from sim.radar.swept_pattern import SweptPattern

WIDE = Chirp(
    center_frequency_hz=60.75e9,
    bandwidth_hz=5.5e9,
    samples=64,
    sample_rate_hz=2e6,
    chirps=64,
    repetition_s=591.125e-6,
)
NARROW = WIDE.model_copy(update={"center_frequency_hz": 60.8e9, "bandwidth_hz": 0.4e9, "repetition_s": 390.975e-6})
DECAY_S = 0.012


def sweep(rows: list[list[float]], *, hp_cutoff_hz: float | None = 80e3) -> SweptPattern:
    return SweptPattern(
        start_frequency_hz=58e9,
        bandwidth_hz=5.5e9,
        sample_rate_hz=2e6,
        hp_cutoff_hz=hp_cutoff_hz,
        counts=tuple(tuple(row) for row in rows),
    )


def truth(receivers: int = 2) -> Impairments:
    """Leakage in bins 1 and 2, a turn-on, noise that falls by half, and a converter with rare odd codes."""
    # Rounded, since the C library's last bit differs between machines.
    leak = [
        [round(200.0 * exp(-n / 3.979) + 150.0 * cos(2.0 * pi * 1.3 * n / 64 + k), 3) for n in range(64)]
        for k in range(receivers)
    ]
    start = [[round(1.5 - k * 0.5 + cos(2.0 * pi * n / 64), 3) for n in range(64)] for k in range(receivers)]
    return Impairments(
        leakage=Leakage(dc=tuple(1800.0 + 100.0 * k for k in range(receivers)), sweep=sweep(leak)),
        frame_start=FrameStart(decay_s=DECAY_S, sweep=sweep(start)),
        dc_wander=DcWander(sigma=tuple(0.6 + 0.3 * k for k in range(receivers))),
        noise=ReceiverNoise(
            bin_hz=31250.0,
            power=tuple(tuple((1.0 + k) * (2.0 - b / 32.0) for b in range(33)) for k in range(receivers)),
        ),
        adc=Adc(odd_code_share=0.13),
    )


def digitise(
    impairments: Impairments,
    *,
    seq: int = 0,
    chirp: Chirp = WIDE,
    signal: Any = None,
    receivers: int = 2,
    **options: Any,
) -> np.ndarray:
    """Return one frame; without a signal, of an empty scene."""
    shape = (receivers, chirp.chirps, chirp.samples)
    chain = RadarReceiverChain(chirp, impairments, receivers, **({"seed": 1, "name": "radar"} | options))
    out = np.zeros(shape, np.uint16)
    chain.digitise(np.zeros(shape) if signal is None else signal, seq, out)
    return out


def frames_of(
    impairments: Impairments, count: int, *, chirp: Chirp = WIDE, receivers: int = 2, seed: int = 1, signal: Any = None
) -> np.ndarray:
    shape = (receivers, chirp.chirps, chirp.samples)
    chain = RadarReceiverChain(chirp, impairments, receivers, seed=seed, name="radar")
    out = np.zeros((count, *shape), np.uint16)
    for seq in range(count):
        chain.digitise(np.zeros(shape) if signal is None else signal, seq, out[seq])
    return out


def recording_of(adc: np.ndarray, *, chirp: Chirp = WIDE) -> Recording:
    return Recording(
        adc, chirp, tuple(range(1, adc.shape[1] + 1)), frame_repetition_s=0.08, hp_cutoff_hz=80e3, aaf_cutoff_hz=500e3
    )
