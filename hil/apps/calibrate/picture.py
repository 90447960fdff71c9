"""Picture of a radar's calibration. It imports matplotlib, which is slow, so import this module only to plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hil.run.report import figures
from sim.radar.adc import RadarReceiverChain
from sim.radar.calibration import Calibration
from sim.radar.recording import Recording
from sim.radar.spectra import noise_power

# Okabe and Ito's palette, distinguishable with any colour vision.
_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9")
_CODES_SHOWN = 64  # of the histogram: enough to compare odd and even codes


def draw_calibration(calibration: Calibration, recording: Recording, path: Path) -> None:
    """Plot measured and modelled noise, fixed pattern, range and ADC codes as a PNG. Raises OSError."""
    first, last = calibration.frames
    real = recording.adc[first:last]
    simulated = simulate(calibration, recording, last - first)
    with figures.style():
        figure = Figure(figsize=(10.0, 8.0), layout="constrained")
        axes = figure.subplots(2, 2)
        _draw_noise(axes[0, 0], calibration, noise_power(simulated).mean(axis=0), recording)
        _draw_pattern(axes[0, 1], calibration, recording)
        _draw_range(axes[1, 0], calibration, recording)
        _draw_codes(axes[1, 1], real, simulated)
        figures.save(figure, path)


def simulate(calibration: Calibration, recording: Recording, frames: int) -> NDArray[np.uint16]:
    """Simulate `frames` frames with the fitted impairments and the recorded fixed pattern, reflectors included.

    Returns ADC counts, (frames, receivers, chirps, samples).
    """
    chirp, impairments = recording.chirp, calibration.impairments
    if impairments.leakage is not None:
        counts = tuple(tuple(row) for row in calibration.pattern.tolist())
        sweep = impairments.leakage.sweep.model_copy(update={"counts": counts})
        leakage = impairments.leakage.model_copy(update={"sweep": sweep})
        impairments = impairments.model_copy(update={"leakage": leakage})
    chain = RadarReceiverChain(chirp, impairments, recording.receivers, seed=0, name="calibration")
    shape = (recording.receivers, chirp.chirps, chirp.samples)
    no_echoes, adc = np.zeros(shape), np.empty((frames, *shape), np.uint16)
    for seq in range(frames):
        chain.digitise(no_echoes, seq, adc[seq])
    return adc


def _colour(k: int) -> str:
    return _COLOURS[k % len(_COLOURS)]


def _draw_noise(axes: Axes, calibration: Calibration, modelled: NDArray[Any], recording: Recording) -> None:
    chirp = recording.chirp
    khz = np.arange(modelled.shape[1]) * chirp.sample_rate_hz / chirp.samples * 1e-3
    for k, measured in enumerate(calibration.measured_power):
        axes.plot(khz, measured, "o", ms=4, color=_colour(k), label=f"RX{recording.rx_antennas[k]}")
        axes.plot(khz, modelled[k], color=_colour(k), lw=1.2, label="_")
    axes.set_yscale("log")
    axes.set(title="Noise (lines: modelled)", xlabel="beat frequency [kHz]", ylabel="power [counts$^2$]")
    axes.legend()


def _draw_pattern(axes: Axes, calibration: Calibration, recording: Recording) -> None:
    leakage = calibration.impairments.leakage
    ghz = (recording.chirp.start_frequency_hz + np.arange(recording.chirp.samples) * _step_hz(recording)) * 1e-9
    for k, measured in enumerate(calibration.pattern):
        axes.plot(ghz, measured, ":", color=_colour(k), lw=1.2)
        if leakage is not None:
            label = f"RX{recording.rx_antennas[k]}"
            axes.plot(ghz, leakage.sweep.counts[k], color=_colour(k), lw=1.4, label=label)
    axes.set(title="Fixed pattern (dots: measured)", xlabel="RF frequency [GHz]", ylabel="counts over DC")
    axes.legend()


def _draw_range(axes: Axes, calibration: Calibration, recording: Recording) -> None:
    n = recording.chirp.samples
    window = np.hanning(n + 1)[:n]
    spectra = np.abs(np.fft.rfft(calibration.pattern * window, 8 * n, axis=-1)) * 2.0 / window.sum()
    range_m = np.arange(spectra.shape[1]) / 8.0 * recording.chirp.range_resolution_m
    for k, row in enumerate(spectra):
        axes.plot(range_m, 20.0 * np.log10(np.maximum(row, 1e-3)), color=_colour(k), lw=1.2)
    for echo in calibration.echoes:
        axes.axvline(echo.range_m, ls="--", color="#8a919b", lw=1.0)
    axes.set(title="Static echoes (dashed: reflectors)", xlabel="range [m]", ylabel="dB over one count")


def _draw_codes(axes: Axes, real: NDArray[Any], simulated: NDArray[Any]) -> None:
    middle = int(np.median(real))
    codes = np.arange(max(middle - _CODES_SHOWN // 2, 0), middle + _CODES_SHOWN // 2)
    for data, name, style in ((real, "recorded", "o"), (simulated, "modelled", "_")):
        share = np.bincount(data.ravel(), minlength=int(codes[-1]) + 1)[codes] / data.size
        axes.plot(codes, 100.0 * share, style, ms=5, color=_colour(0 if name == "recorded" else 3), label=name)
    axes.set(title="Codes near the median", xlabel="code", ylabel="share [%]")
    axes.legend()


def _step_hz(recording: Recording) -> float:
    return recording.chirp.bandwidth_hz / recording.chirp.samples
