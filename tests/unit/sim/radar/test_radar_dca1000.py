"""DCA1000 files against the order of samples that TI prints, and the settings beside them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sim.radar.dca1000 import frame_words, mmwave_json, setup_json
from sim.sensors.radar_parameters import RadarParameters
from tests.worlds.radar_presets import preset


def raw_of(p: RadarParameters, chirps: int = 3) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
    shape = (p.raw_shape[0], chirps, p.chirp.samples)
    return np.random.default_rng(1).integers(0, 65536, shape).astype(np.uint16)


def test_two_lanes_are_receiver_by_receiver_in_pairs() -> None:
    p = preset("awr1843boost")
    assert p.board is not None
    raw = raw_of(p)
    x = raw.astype(int) - 32768
    expected = []
    for m in range(3):
        for k in range(4):
            for n in range(0, 256, 2):
                expected += [x[2 * k, m, n], x[2 * k, m, n + 1], x[2 * k + 1, m, n], x[2 * k + 1, m, n + 1]]
    words = frame_words(raw, p.chirp, p.board, 16)
    assert words.dtype == np.dtype("<i2")
    assert words.tolist() == expected


def test_four_lanes_are_sample_by_sample() -> None:
    p = preset("awr2243boost")
    assert p.board is not None
    raw = raw_of(p)
    x = raw.astype(int) - 32768
    expected = []
    for m in range(3):
        for n in range(512):
            expected += [x[2 * k, m, n] for k in range(4)] + [x[2 * k + 1, m, n] for k in range(4)]
    assert frame_words(raw, p.chirp, p.board, 16).tolist() == expected


@pytest.mark.parametrize("lanes", [2, 4])
def test_real_samples(lanes: int) -> None:
    p = preset("iwr6843isk")
    assert p.board is not None
    chirp = p.chirp.model_copy(update={"sampling": "real"})
    board = p.board.model_copy(update={"lvds_lanes": lanes})
    raw = np.random.default_rng(1).integers(0, 4096, (4, 2, 96)).astype(np.uint16)
    x = raw.astype(int) - 2048
    order = (
        [(k, n) for k in range(4) for n in range(96)] if lanes == 2 else [(k, n) for n in range(96) for k in range(4)]
    )
    assert frame_words(raw, chirp, board, 12).tolist() == [x[k, m, n] for m in range(2) for k, n in order]


def test_settings_are_those_of_the_profile() -> None:
    """The chirp of this preset is a profile of TI's: the settings must give it back."""
    p = preset("iwr6843isk")
    assert p.board is not None
    text = mmwave_json(p.chirp, p.antenna.array, p.board, rx_gain_db=30.0, frames=7, period_s=0.055)
    device = json.loads(text)["mmWaveDevices"][0]
    profile = device["rfConfig"]["rlProfiles"][0]["rlProfileCfg_t"]
    assert profile["startFreqConst_GHz"] == pytest.approx(60.75, abs=1e-9)
    assert profile["freqSlopeConst_MHz_usec"] == pytest.approx(54.71, abs=1e-9)
    assert profile["idleTimeConst_usec"] == pytest.approx(30.0, abs=0.1)
    assert profile["rampEndTime_usec"] == pytest.approx(59.1, abs=0.1)
    assert (profile["numAdcSamples"], profile["digOutSampleRate"], profile["rxGain_dB"]) == (96, 2950.0, "0x1E")
    frame = device["rfConfig"]["rlFrameCfg_t"]
    assert (frame["numLoops"], frame["numFrames"], frame["framePeriodicity_msec"]) == (96, 7, 55.0)
    assert [c["rlChirpCfg_t"]["txEnable"] for c in device["rfConfig"]["rlChirps"]] == ["0x1", "0x2", "0x4"]
    assert device["rawDataCaptureConfig"]["rlDevDataFmtCfg_t"] == {"iqSwapSel": 0, "chInterleave": 1}
    assert device["rawDataCaptureConfig"]["rlDevLaneEnable_t"]["laneEn"] == "0x3"
    setup = json.loads(setup_json("IWR6843", "a.bin", "a.mmwave.json"))
    assert (setup["configUsed"], setup["capturedFiles"]["files"][0]["rawFileName"]) == ("a.mmwave.json", "a.bin")
