"""A simulated BGT60TR13C beside a real one: fitted on frames 0 to 63 of a recording, judged on frames 64 to 127.

The recording is not part of this project: HIL_RADAR_RECORDING names it, or it lies in ../shared/radar beside the
checkout. Every correlation is compared with that of two real frames. The scene has reflectors, so they are kept in the
pattern.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from sim.radar.adc import RadarReceiverChain
from sim.radar.calibration import Calibration, calibrate
from sim.radar.comparison import Comparison, compare, correlations
from sim.radar.impairments import Impairments
from sim.radar.recording import Recording, load_recording
from sim.radar.spectra import noise_power
from sim.sensors.presets import PRESET_DIR

FITTED, JUDGED = (0, 64), (64, 128)
SEED = 1
VARIABLE = "HIL_RADAR_RECORDING"
DEFAULT = Path(__file__).resolve().parents[2].parent / "shared" / "radar" / "bgt60tr13c_3_reflectors.npz"


@cache
def recording() -> Recording:
    path = Path(os.environ.get(VARIABLE) or DEFAULT)
    if not path.exists():
        pytest.skip(f"no recording of a real radar: {VARIABLE} names none and ../shared/radar has none")
    return load_recording(path)


@cache
def calibration() -> Calibration:
    return calibrate(recording(), frames=FITTED, keep_echoes=True)


def simulate(impairments: Impairments, frames: int = JUDGED[1] - JUDGED[0]) -> np.ndarray:
    real = recording()
    chain = RadarReceiverChain(real.chirp, impairments, real.receivers, seed=SEED, name="radar")
    out = np.zeros((frames, *real.adc.shape[1:]), np.uint16)
    silence = np.zeros(out.shape[1:])
    for seq in range(frames):
        chain.digitise(silence, seq, out[seq])
    return out


@cache
def comparison() -> Comparison:
    return compare(simulate(calibration().impairments), recording().adc[slice(*JUDGED)])


def test_noise_power_of_every_bin() -> None:
    """256 frames are simulated, so that most of the remaining error is the spread and drift of the real frames."""
    fitted, judged = (noise_power(recording().adc[slice(*frames)]).mean(axis=0) for frames in (FITTED, JUDGED))
    simulated = noise_power(simulate(calibration().impairments, 256)).mean(axis=0)
    difference, real = decibel(simulated / judged), decibel(fitted / judged)
    few = np.abs(comparison().noise_power_db).max()
    print(
        f"noise power, worst of all bins and receivers: simulated over real {np.abs(difference).max():.2f} dB", end=""
    )
    print(f" (64 frames: {few:.2f} dB), real over real {np.abs(real).max():.2f} dB")
    assert np.abs(difference).max() <= 0.5, difference.round(2)


def decibel(ratio: np.ndarray) -> np.ndarray:
    return 10.0 * np.log10(ratio)


def test_range_doppler_noise() -> None:
    difference = comparison().range_doppler_noise_db
    print(f"range-Doppler noise, simulated over real: {difference.round(2)} dB")
    assert np.abs(difference).max() <= 0.5, difference


def test_share_of_odd_codes() -> None:
    simulated, real = comparison().odd_code_share
    print(f"odd codes: simulated {simulated:.4f}, real {real:.4f}")
    assert abs(simulated - 0.13) <= 0.02
    assert abs(simulated - real) <= 0.02


@pytest.mark.parametrize("variant", ["linear", "dB", "dB, bins >= 5", "mean removed"])
def test_correlation_equals_that_of_two_real_frames(variant: str) -> None:
    pair = comparison().ncc[variant]
    print(f"NCC {variant}: {pair}")
    assert abs(pair.difference) <= 0.02, f"NCC {variant}: {pair}"


def test_the_correlations_detect_missing_parts_of_the_model() -> None:
    """Without leakage, or without the reflectors, the correlations fall."""
    full = calibration().impairments
    real = recording().adc[slice(*JUDGED)]
    bare = correlations(simulate(full.model_copy(update={"leakage": None}), 8), real)
    assert bare["linear"].simulated_against_real < 0.5, f"without leakage: {bare['linear']}"
    empty = calibrate(recording(), frames=FITTED).impairments
    for variant in ("dB", "dB, bins >= 5"):
        pair = correlations(simulate(empty, 8), real)[variant]
        print(f"without reflectors, NCC {variant}: {pair}")
        assert pair.difference < -0.02, f"without reflectors, NCC {variant}: {pair}"


def test_the_reflectors_are_where_they_were_found_by_hand() -> None:
    ranges = np.array([echo.range_m for echo in calibration().echoes])
    for expected in (0.298, 0.457, 0.712):
        assert np.abs(ranges - expected).min() < 0.003, (expected, ranges)


@pytest.mark.parametrize("preset", ["bgt60tr13c", "bgt60tr13c_wideband"])
def test_the_shipped_presets_hold_what_the_recording_gives(preset: str) -> None:
    data = yaml.safe_load((PRESET_DIR / f"{preset}.yaml").read_text())
    shipped = Impairments.model_validate(data["parameters"]["impairments"]["value"])
    again = calibrate(recording(), frames=FITTED).impairments
    # The fit's last digit may differ between machines.
    assert list(numbers(again.model_dump())) == pytest.approx(list(numbers(shipped.model_dump())), rel=1e-3, abs=5e-3)


def numbers(value: Any) -> Iterator[float]:
    """Return all numbers, in order."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for item in value:
            yield from numbers(item)
    elif value is not None:  # null: switched off
        yield value
