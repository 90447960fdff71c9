"""Antenna and receiver of a radar against what their figures mean."""

from __future__ import annotations

import math

import numpy as np
import pydantic
import pytest

from sim.radar.antenna import Antenna, Pattern
from sim.radar.receiver import Receiver

PATTERN = Pattern(gain_dbi=6.0, azimuth_beamwidth_deg=65.0, elevation_beamwidth_deg=40.0)
FIGURES = {"tx_power_dbm": 5.0, "conversion_gain_db": 40.0, "impedance_ohm": 50.0, "adc_full_scale_v": 1.2}


def test_half_of_the_power_at_half_the_beamwidth() -> None:
    a, e = math.radians(32.5), math.radians(20.0)
    directions = np.array(
        [
            [1.0, 0.0, 0.0],
            [math.cos(a), math.sin(a), 0.0],
            [math.cos(a), -math.sin(a), 0.0],
            [math.cos(e), 0.0, math.sin(e)],
            [math.cos(e), 0.0, -math.sin(e)],
        ]
    )
    assert PATTERN.gain(directions) == pytest.approx(10**0.6 * np.array([1.0, 0.5, 0.5, 0.5, 0.5]), rel=1e-12)


def test_nothing_behind_and_no_number_is_lost() -> None:
    directions = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1e-300, 1.0, 0.0], [-0.0, 0.6, 0.8]])
    share = PATTERN.share(directions)
    assert np.all(share[[0, 1, 2, 4]] == 0.0)
    assert share[3] == 0.0


def test_there_and_back_is_the_product() -> None:
    narrow = Pattern(gain_dbi=20.0, azimuth_beamwidth_deg=10.0, elevation_beamwidth_deg=10.0)
    antenna = Antenna(rx_positions_m=((0.0, 0.0, 0.0),), tx=PATTERN, rx=narrow)
    directions = np.array([[0.8, 0.6, 0.0], [0.6, 0.0, 0.8], [0.96, 0.28, 0.0]])
    assert antenna.gain(directions) == pytest.approx(PATTERN.gain(directions) * narrow.gain(directions), rel=1e-14)
    assert antenna.gain(directions) == pytest.approx(antenna.share(directions) * 10**2.6, rel=1e-12)


def test_an_echo_of_known_power_has_the_peak_that_a_voltmeter_would_show() -> None:
    receiver = Receiver(**FIGURES, adc_bits=12)
    assert receiver.tx_power_w == pytest.approx(3.16227766e-3, rel=1e-9)
    # 1 nW into 50 ohm is 316.2 uV at the peak; 40 dB more is 31.62 mV, and a count is 1.2 V / 4096.
    assert receiver.counts_per_sqrt_watt * math.sqrt(1e-9) == pytest.approx(31.6227766e-3 / (1.2 / 4096), rel=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"adc_bits": 3}, "greater than or equal to 4"),
        ({"adc_bits": 12, "impedance_ohm": 0.0}, "greater than 0"),
        ({"adc_bits": 12, "hp_cutoff_hz": 1e6, "aaf_cutoff_hz": 8e4}, "nothing passes"),
        ({"adc_bits": 12, "gain": 1.0}, "Extra inputs"),
    ],
)
def test_receivers_that_cannot_be(change: dict[str, float], words: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=words):
        Receiver.model_validate(FIGURES | change)


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        ((), "0 receivers"),
        (((0.0, 0.0, 0.0),) * 17, "17 receivers; a radar has 1 to 16"),
        (((0.0, 2.5, 0.0),), "metres from the radar's origin"),
    ],
)
def test_arrays_that_cannot_be(positions: tuple[tuple[float, float, float], ...], words: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=words):
        Antenna(rx_positions_m=positions, tx=PATTERN, rx=PATTERN)
