"""Captures of a DCA1000 read by `hil radar`: our own bit for bit, other programs' settings, and what is refused."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from hil.apps.radar.command import Outputs, process_radar
from hil.apps.radar.dca1000 import Dca1000File
from hil.apps.radar.dca1000_source import open_capture
from signals.errors import ConfigError, RecordingError
from sim.sensors.catalog import PRESETS
from sim.sensors.radar_parameters import RadarParameters
from tests.accuracy.test_radar_array_targets import frame_of

Frames = list[NDArray[np.uint16]]


def preset(name: str, **chirp: Any) -> RadarParameters:
    p = PRESETS[name].parameters
    assert isinstance(p, RadarParameters)
    data = p.model_dump()
    data["chirp"] |= chirp
    data["impairments"] = {}
    return RadarParameters.model_validate(data)


def written(path: Path, p: RadarParameters, part: str, frames: Frames) -> None:
    with Dca1000File(path, p, part) as capture:
        for k, raw in enumerate(frames):
            capture.add(k * 100_000_000, raw)


def noise_of(p: RadarParameters, count: int = 2) -> Frames:
    rng = np.random.default_rng(3)
    return [rng.integers(0, 65536, p.raw_shape).astype(np.uint16) for _ in range(count)]


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("name", ["iwr6843isk", "iwr6843ods", "awr1843boost", "awr2243boost"])
def test_a_capture_of_ours_bit_for_bit(tmp_path: Path, name: str, sampling: str) -> None:
    p = preset(name, sampling=sampling, chirps=96)
    frames = noise_of(p)
    path = tmp_path / "adc.bin"
    written(path, p, name, frames)
    source = open_capture(path, preset=None, texts=())
    read = list(source.frames)
    assert [frame.t_ns for frame in read] == [0, 100_000_000]
    for frame, raw in zip(read, frames, strict=True):
        assert frame.raw.dtype == raw.dtype
        assert np.array_equal(frame.raw, raw)
    assert source.parameters.antenna == p.antenna.model_copy(update={"field_deg": None})
    for field, value in p.chirp.model_dump().items():
        found = getattr(source.parameters.chirp, field)
        assert found == value if isinstance(value, str) else found == pytest.approx(value, rel=1e-8)
    again = tmp_path / "again" / "adc.bin"
    written(again, source.parameters, source.part, [frame.raw for frame in read])
    for suffix in (".bin", ".mmwave.json", ".setup.json"):
        assert again.with_suffix(suffix).read_bytes() == path.with_suffix(suffix).read_bytes()


def test_the_command_makes_maps_points_and_pictures(tmp_path: Path) -> None:
    name = "awr1843boost"
    p = preset(name)
    range_m = 40 * p.chirp.range_resolution_m
    path, again = tmp_path / "adc.bin", tmp_path / "again.bin"
    written(path, p, name, [frame_of(p, (range_m, 1.5, 22.0, 9.0))] * 2)
    files = process_radar(
        path, Console(quiet=True), outputs=Outputs(dca1000=again), settings=["processing.clutter=none"], quiet=True
    )
    assert {"summary.png", "range_doppler_00000.png", "points.csv"} <= {file.name for file in files}
    rows = np.atleast_1d(np.genfromtxt(tmp_path / "adc-radar" / "points.csv", delimiter=",", names=True))
    best = rows[np.argmax(rows["snr_db"])]
    assert best["range_m"] == pytest.approx(range_m, abs=0.01)
    assert best["speed_mps"] == pytest.approx(1.5, abs=0.01)
    assert math.degrees(best["azimuth_rad"]) == pytest.approx(22.0, abs=0.1)
    assert math.degrees(best["elevation_rad"]) == pytest.approx(9.0, abs=0.1)
    assert again.read_bytes() == path.read_bytes()


def studio(settings: dict[str, Any], folder: Path, name: str, device: str) -> None:
    """Write settings as mmWave Studio 2.1 does: names of its own, paths of Windows, more sections."""
    settings["configGenerator"] = {"createdBy": "mmWaveStudio", "createdOn": "2024", "isConfigIntermediate": 1}
    settings["regulatoryRestrictions"] = {"frequencyRangeBegin_GHz": 77, "frequencyRangeEnd_GHz": 81}
    settings["processingChainConfig"] = {"detectionChain": {"name": "TI_GenericChain"}}
    rf = settings["mmWaveDevices"][0]["rfConfig"]
    rf["rlProfiles"][0]["rlProfileCfg_t"]["pfCalLutUpdate"] = "0x0"
    del rf["rlFrameCfg_t"]["numAdcSamples"]
    rf["rlFrameCfg_t"] |= {"triggerSelect": 1, "numDummyChirpsAtEnd": 0}
    (folder / "mmwaveDevice.mmwave.json").write_text("\ufeff" + json.dumps(settings, indent=2), encoding="utf-8")
    setup = {
        "createdByVersion": "2.1.0",
        "configUsed": "C:\\Users\\someone\\1119\\mmwaveDevice.mmwave.json",
        "mmWaveDevice": device,
        "capturedFiles": {
            "numFilesCollected": 1,
            "fileBasePath": "D:\\PostProc",
            "files": [{"rawFileName": "adc_data_Raw_0.bin", "processedFileName": name}],
        },
    }
    (folder / "CaptureSetup.setup.json").write_text(json.dumps(setup))


def by_hand(settings: dict[str, Any]) -> None:
    """Write numbers in place of masks in hexadecimal, and leave out what a single chip does not need."""
    device = settings["mmWaveDevices"][0]
    rf, capture = device["rfConfig"], device["rawDataCaptureConfig"]
    rf["rlChanCfg_t"] |= {"rxChannelEn": 15, "txChannelEn": 7}
    rf["rlProfiles"][0]["rlProfileCfg_t"] |= {"rxGain_dB": 30, "numAdcSamples": "256", "digOutSampleRate": "6250.0"}
    for row in rf["rlChirps"]:
        row["rlChirpCfg_t"]["txEnable"] = int(row["rlChirpCfg_t"]["txEnable"], 16)
    rf["rlFrameCfg_t"]["numFrames"] = 0  # until it is stopped
    capture["rlDevDataPathCfg_t"]["transferFmtPkt0"] = 1
    capture["rlDevLaneEnable_t"]["laneEn"] = 3
    for key in ("waveformType", "MIMOScheme", "rlBpmChirps"):
        del rf[key]


def capture_of(folder: Path) -> tuple[Path, dict[str, Any], Frames]:
    p = preset("awr1843boost", chirps=96)
    frames = noise_of(p)
    path = folder / "adc_data.bin"
    written(path, p, "awr1843boost", frames)
    return path, json.loads(path.with_suffix(".mmwave.json").read_text()), frames


def test_settings_as_mmwave_studio_writes_them(tmp_path: Path) -> None:
    path, settings, frames = capture_of(tmp_path)
    for file in (path.with_suffix(".mmwave.json"), path.with_suffix(".setup.json")):
        file.unlink()
    studio(settings, tmp_path, path.name, "awr1843")
    source = open_capture(path, preset=None, texts=())
    assert source.part == "awr1843boost"
    assert all(np.array_equal(frame.raw, raw) for frame, raw in zip(source.frames, frames, strict=True))


def test_numbers_in_place_of_masks_and_no_setup(tmp_path: Path) -> None:
    path, settings, frames = capture_of(tmp_path)
    by_hand(settings)
    path.with_suffix(".setup.json").unlink()
    path.with_suffix(".mmwave.json").write_text(json.dumps(settings))
    with pytest.raises(ConfigError, match=r"does not name its device.*--preset"):
        open_capture(path, preset=None, texts=())
    source = open_capture(path, preset="awr1843boost", texts=())
    assert all(np.array_equal(frame.raw, raw) for frame, raw in zip(source.frames, frames, strict=True))
    assert source.parameters.antenna.tx_positions_m == preset("awr1843boost").antenna.tx_positions_m


def test_quadrature_first(tmp_path: Path) -> None:
    path, settings, frames = capture_of(tmp_path)
    settings["mmWaveDevices"][0]["rawDataCaptureConfig"]["rlDevDataFmtCfg_t"]["iqSwapSel"] = 1
    path.with_suffix(".mmwave.json").write_text(json.dumps(settings))
    for frame, raw in zip(open_capture(path, preset=None, texts=()).frames, frames, strict=True):
        assert np.array_equal(frame.raw[0::2], raw[1::2])
        assert np.array_equal(frame.raw[1::2], raw[0::2])


def test_two_receivers_and_two_transmitters(tmp_path: Path) -> None:
    """Antennas that are off have no samples; those that are on keep their places, in the order in which they send."""
    p = preset("awr1843boost", chirps=96)
    rx, tx = p.antenna.rx_positions_m, p.antenna.tx_positions_m  # TX1, TX3, TX2
    path, settings, _ = capture_of(tmp_path)
    rf = settings["mmWaveDevices"][0]["rfConfig"]
    rf["rlChanCfg_t"]["rxChannelEn"] = "0x6"
    rf["rlChirps"] = rf["rlChirps"][:2]
    for row, mask in zip(rf["rlChirps"], ("0x2", "0x1"), strict=True):
        row["rlChirpCfg_t"]["txEnable"] = mask
    rf["rlFrameCfg_t"] |= {"chirpEndIdx": 1, "numLoops": 48, "numFrames": 4}
    path.with_suffix(".mmwave.json").write_text(json.dumps(settings))
    source = open_capture(path, preset=None, texts=())
    antenna = source.parameters.antenna
    assert antenna.rx_positions_m == (rx[1], rx[2])
    assert antenna.tx_positions_m == (tx[2], tx[0])
    assert source.count == 4
    assert next(source.frames).raw.shape == (4, 96, 256)


Change = Callable[[dict[str, Any]], None]


def _rf(settings: dict[str, Any]) -> dict[str, Any]:
    rf: dict[str, Any] = settings["mmWaveDevices"][0]["rfConfig"]
    return rf


def _raw(settings: dict[str, Any]) -> dict[str, Any]:
    raw: dict[str, Any] = settings["mmWaveDevices"][0]["rawDataCaptureConfig"]
    return raw


def _four_lanes(settings: dict[str, Any]) -> None:
    _raw(settings)["rlDevLaneEnable_t"]["laneEn"] = "0xF"
    _raw(settings)["rlDevDataFmtCfg_t"]["chInterleave"] = 0


REFUSED: dict[str, tuple[Change, str]] = {
    "real samples": (
        lambda s: _rf(s)["rlAdcOutCfg_t"]["fmt"].update(b2AdcOutFmt=0),
        r"has 4 frames of \d+ bytes \(96 chirps, 256 real samples, 4 receivers\), and .* states 2",
    ),
    "pseudo-real samples": (lambda s: _rf(s)["rlAdcOutCfg_t"]["fmt"].update(b2AdcOutFmt=3), "b2AdcOutFmt is 3"),
    "unknown bits": (lambda s: _rf(s)["rlAdcOutCfg_t"]["fmt"].update(b2AdcBits=7), "b2AdcBits is 7"),
    "fewer receivers": (lambda s: _rf(s)["rlChanCfg_t"].update(rxChannelEn="0x1"), "has 8 frames .* states 2"),
    "more samples": (
        lambda s: _rf(s)["rlProfiles"][0]["rlProfileCfg_t"].update(numAdcSamples=258, rampEndTime_usec=60),
        r"adc_data.bin: has 786432 bytes: 1 frames of 396288 bytes .* and 390144 bytes more .*truncate -s 396288",
    ),
    "longer frames": (lambda s: _rf(s)["rlFrameCfg_t"].update(numLoops=65), r"0 frames of .* and 786432 bytes more"),
    "one lane": (lambda s: _raw(s)["rlDevLaneEnable_t"].update(laneEn="0x1"), "laneEn has 1 LVDS lanes"),
    "four lanes": (_four_lanes, "has 4 LVDS lanes, and a awr1843boost has 2"),
    "interleaved": (lambda s: _raw(s)["rlDevDataFmtCfg_t"].update(chInterleave=0), "chInterleave is 0 with 2 lanes"),
    "more than samples": (
        lambda s: _raw(s)["rlDevDataPathCfg_t"].update(transferFmtPkt0="0x6"),
        "transferFmtPkt0 is 0x6",
    ),
    "a missing key": (lambda s: _rf(s)["rlFrameCfg_t"].pop("numLoops"), "numLoops is missing"),
    "a missing section": (lambda s: _rf(s).pop("rlChanCfg_t"), "has no section rlChanCfg_t"),
    "no profile": (lambda s: _rf(s).update(rlProfiles=[]), "has no list rlProfiles"),
    "no device": (lambda s: s.pop("mmWaveDevices"), "has no list mmWaveDevices"),
    "a cascade": (lambda s: s["mmWaveDevices"].append(s["mmWaveDevices"][0]), "is of 2 devices in a cascade"),
    "a word": (lambda s: _rf(s)["rlFrameCfg_t"].update(numLoops="many"), "numLoops is 'many', not a number"),
    "half a loop": (lambda s: _rf(s)["rlFrameCfg_t"].update(numLoops=2.5), "numLoops is 2.5, not a whole number"),
    "a short ramp": (
        lambda s: _rf(s)["rlProfiles"][0]["rlProfileCfg_t"].update(rampEndTime_usec=20.0),
        "rampEndTime_usec is 20, and the last sample is at 46.96 us",
    ),
    "a chirp that is not there": (lambda s: _rf(s)["rlChirps"].pop(), "rlChirps does not define 2"),
    "transmitters at once": (
        lambda s: _rf(s)["rlChirps"][0]["rlChirpCfg_t"].update(txEnable="0x3"),
        "the transmitters 1, 2 send at once",
    ),
    "no transmitter": (lambda s: _rf(s)["rlChirps"][0]["rlChirpCfg_t"].update(txEnable="0x0"), "nothing transmits"),
    "chirps that differ": (
        lambda s: _rf(s)["rlChirps"][1]["rlChirpCfg_t"].update(idleTimeVar_usec=3.0),
        "idleTimeVar_usec differs",
    ),
    "advanced frames": (lambda s: _rf(s).update(waveformType="advancedFrameChirp"), "waveformType is 'advanced"),
    "frames that overlap": (
        lambda s: _rf(s)["rlFrameCfg_t"].update(framePeriodicity_msec=0.2),
        "framePeriodicity_msec is 0.2, less than the",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_settings_that_do_not_fit(tmp_path: Path, name: str) -> None:
    path, settings, _ = capture_of(tmp_path)
    change, message = REFUSED[name]
    changed = copy.deepcopy(settings)
    change(changed)
    path.with_suffix(".mmwave.json").write_text(json.dumps(changed))
    with pytest.raises(ConfigError, match=message) as caught:
        open_capture(path, preset=None, texts=())
    assert len(caught.value.problems) == 1


def test_files_that_do_not_fit(tmp_path: Path) -> None:
    path, _, _ = capture_of(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[:-2])
    with pytest.raises(ConfigError, match=r"has 786430 bytes: 1 frames .* and 393214 bytes more \(a cut file"):
        open_capture(path, preset=None, texts=())
    path.write_bytes(b"")
    with pytest.raises(ConfigError, match="has 0 bytes"):
        open_capture(path, preset=None, texts=())
    path.write_bytes(data)
    source = open_capture(path, preset=None, texts=())
    path.write_bytes(data[:1000])
    with pytest.raises(RecordingError, match="ended in frame 0 while it was read"):
        list(source.frames)


def test_a_capture_that_was_stopped_early_is_read(tmp_path: Path) -> None:
    path, _, frames = capture_of(tmp_path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    source = open_capture(path, preset=None, texts=())
    assert source.description == "capture adc_data.bin, 1 of 2 frames"
    assert np.array_equal(next(source.frames).raw, frames[0])


def test_samples_that_have_more_bits_than_stated(tmp_path: Path) -> None:
    path, settings, _ = capture_of(tmp_path)
    _rf(settings)["rlAdcOutCfg_t"]["fmt"]["b2AdcBits"] = 0
    path.with_suffix(".mmwave.json").write_text(json.dumps(settings))
    with pytest.raises(RecordingError, match="is no code of 12 bits; b2AdcBits"):
        list(open_capture(path, preset=None, texts=()).frames)


def test_settings_that_are_missing(tmp_path: Path) -> None:
    path, settings, _ = capture_of(tmp_path)
    own, setup = path.with_suffix(".mmwave.json"), path.with_suffix(".setup.json")
    with pytest.raises(ConfigError, match="does not exist"):
        open_capture(tmp_path / "other.bin", preset=None, texts=())
    own.unlink()
    with pytest.raises(ConfigError, match=r"names the settings adc_data.mmwave.json .* no such file beside it"):
        open_capture(path, preset=None, texts=())
    setup.unlink()
    with pytest.raises(ConfigError, match=r"adc_data.bin: has no settings beside it \(mmWave Studio's JSON"):
        open_capture(path, preset=None, texts=())
    for name in ("a.mmwave.json", "b.mmwave.json"):
        (tmp_path / name).write_text(json.dumps(settings))
    with pytest.raises(ConfigError, match=r"may have any of a.mmwave.json, b.mmwave.json"):
        open_capture(path, preset=None, texts=())
    own.write_text("{")
    with pytest.raises(ConfigError, match="is not JSON"):
        open_capture(path, preset=None, texts=())
    own.write_text("[1]")
    with pytest.raises(ConfigError, match="expected an object, got a list"):
        open_capture(path, preset=None, texts=())


def test_a_device_without_a_preset(tmp_path: Path) -> None:
    path, _, _ = capture_of(tmp_path)
    setup = path.with_suffix(".setup.json")
    setup.write_text(setup.read_text().replace("awr1843boost", "xwr1642"))
    with pytest.raises(ConfigError, match="is of the device 'xwr1642', whose antenna is not known"):
        open_capture(path, preset=None, texts=())
    with pytest.raises(ConfigError, match="holds one radar without a name"):
        process_radar(path, Console(quiet=True), sensor="radar", quiet=True)
