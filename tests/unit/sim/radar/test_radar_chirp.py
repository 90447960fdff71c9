"""Values derived from a chirp: table 3 of the paper from its table 2; and impossible chirps."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pydantic import ValidationError

from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp

TABLE_2: dict[str, Any] = {
    "center_frequency_hz": 60.8e9,
    "bandwidth_hz": 0.4e9,
    "samples": 64,
    "sample_rate_hz": 2e6,
    "chirps": 64,
    "repetition_s": 390.975e-6,
}


def test_characteristics_are_those_of_table_3() -> None:
    chirp = Chirp(**TABLE_2)
    assert round(chirp.max_speed_mps, 2) == 3.15
    assert round(chirp.speed_resolution_mps, 1) == 0.1
    assert math.ceil(chirp.range_resolution_m * 100) == 38  # 0.3747 m, which the paper rounds up
    assert round(chirp.max_range_m) == 12


def test_characteristics_agree_with_one_another() -> None:
    chirp = Chirp(**TABLE_2)
    assert chirp.max_speed_mps == pytest.approx(chirp.speed_resolution_mps * chirp.chirps / 2, rel=1e-14)
    assert chirp.max_range_m == pytest.approx(chirp.range_resolution_m * chirp.samples / 2, rel=1e-14)
    # The echo at the unambiguous range beats at half the sample rate, one bin beats one cycle per chirp.
    assert chirp.beat_frequency_hz(chirp.max_range_m) == pytest.approx(chirp.sample_rate_hz / 2, rel=1e-14)
    assert chirp.beat_frequency_hz(chirp.range_resolution_m) * chirp.sampling_s == pytest.approx(1.0, rel=1e-14)
    # The echo at the unambiguous speed turns by half a cycle from chirp to chirp.
    turn = 2.0 * chirp.max_speed_mps * chirp.repetition_s * chirp.center_frequency_hz / SPEED_OF_LIGHT_MPS
    assert turn == pytest.approx(0.5, rel=1e-14)
    assert chirp.start_frequency_hz + chirp.slope_hz_per_s * chirp.sampling_s == pytest.approx(61.0e9, rel=1e-14)


def test_the_real_sensor() -> None:
    chirp = Chirp(**TABLE_2 | {"center_frequency_hz": 60.75e9, "bandwidth_hz": 5.5e9, "repetition_s": 591.125e-6})
    assert chirp.range_resolution_m == pytest.approx(27.25e-3, abs=5e-6)
    assert chirp.max_range_m == pytest.approx(0.872, abs=5e-4)
    assert chirp.speed_resolution_mps == pytest.approx(0.065, abs=5e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bandwidth_hz": 0.0}, "bandwidth_hz"),
        ({"bandwidth_hz": -1e9}, "bandwidth_hz"),
        ({"bandwidth_hz": float("nan")}, "bandwidth_hz"),
        ({"samples": 63}, "samples must be even, not 63"),
        ({"samples": 4}, "samples"),
        ({"chirps": 1}, "chirps"),
        ({"sample_rate_hz": 0.0}, "sample_rate_hz"),
        ({"repetition_s": 31e-6}, "64 samples at 2e\\+06 Hz take 3.2e-05 s, longer than repetition_s 3.1e-05"),
        ({"samples": 1024}, "longer than repetition_s"),
        ({"center_frequency_hz": 0.2e9}, "reaches 0 Hz"),
        ({"center_frequency_hz": 1e-200, "bandwidth_hz": 1e-201}, "center_frequency_hz must be at least 1 MHz"),
        ({"turns": 3}, "turns"),
    ],
)
def test_impossible_chirps(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Chirp(**TABLE_2 | change)
