"""The capture file of `hil radar --dca1000`: a reflector in it, read as TI's example reads it, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from hil.apps.radar.dca1000 import Dca1000File
from signals.errors import ConfigError
from tests.accuracy.test_radar_array_targets import frame_of
from tests.worlds.radar_presets import preset


def test_a_reflector_has_its_range_and_angle_in_the_file(tmp_path: Path) -> None:
    p, azimuth_deg = preset("awr1843boost"), 22.0
    range_m = 40 * p.chirp.range_resolution_m
    path = tmp_path / "new" / "adc.bin"
    with Dca1000File(path, p, "awr1843boost") as capture:
        for k in range(3):
            capture.add(k * 100_000_000, frame_of(p, (range_m, 0.0, azimuth_deg, 0.0)))
    device = json.loads((tmp_path / "new" / "adc.mmwave.json").read_text())["mmWaveDevices"][0]["rfConfig"]
    frame, profile = device["rlFrameCfg_t"], device["rlProfiles"][0]["rlProfileCfg_t"]
    assert (frame["numFrames"], frame["framePeriodicity_msec"]) == (3, 100.0)
    assert [c["rlChirpCfg_t"]["txEnable"] for c in device["rlChirps"]] == ["0x1", "0x4", "0x2"]
    setup = json.loads((tmp_path / "new" / "adc.setup.json").read_text())
    assert (setup["configUsed"], setup["mmWaveDevice"]) == ("adc.mmwave.json", "awr1843boost")

    # TI SWRA581B: pairs of in-phase, then of quadrature samples, receiver by receiver; the transmitters take turns.
    words = np.fromfile(path, "<i2").reshape(3, frame["numLoops"], 3, 4, profile["numAdcSamples"] // 2, 2, 2)
    samples = (words[:, :, :, :, :, 0] + 1j * words[:, :, :, :, :, 1]).reshape(*words.shape[:4], -1)
    slope_hz_per_s, rate_hz = profile["freqSlopeConst_MHz_usec"] * 1e12, profile["digOutSampleRate"] * 1e3
    spectrum = np.fft.fft(samples * np.hanning(256), axis=-1)[1].mean(axis=0)  # (transmitter, receiver, range)
    peak = int(np.argmax(np.abs(spectrum).sum(axis=(0, 1))))
    assert peak * 299_792_458.0 * rate_hz / (2.0 * slope_hz_per_s * 256) == pytest.approx(range_m, abs=0.01)
    row = spectrum[:2, :, peak].reshape(-1)  # TX1 and TX3: eight in a row, half a wavelength at 77 GHz apart
    turn = np.angle(np.mean(row[1:] * row[:-1].conj()))
    spacing = 1.9467e-3 / p.chirp.wavelength_m
    # TI counts angles to the right, where phases rise from antenna to antenna.
    assert math.degrees(math.asin(turn / (2.0 * math.pi * spacing))) == pytest.approx(-azimuth_deg, abs=0.1)


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no `board` section"):
        Dca1000File(tmp_path / "adc.bin", preset("bgt60tr13c"), "bgt60tr13c")
    with pytest.raises(ConfigError, match=r"has no \.bin"):
        Dca1000File(tmp_path / "adc.raw", preset("awr1843boost"), "awr1843boost")


def test_a_failure_leaves_no_settings(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), Dca1000File(tmp_path / "adc.bin", preset("awr1843boost"), "x"):
        raise RuntimeError
    assert not (tmp_path / "adc.mmwave.json").exists()
