"""A calibration recovers the parameters of a synthetic recording within its stated errors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hil.cli.app import run_command_line
from signals.errors import ConfigError
from sim.radar.calibration import Calibration, Fitted, calibrate
from sim.radar.comparison import compare, correlations
from sim.radar.impairments import Impairments
from sim.radar.preset_text import Hardware, preset_text, with_receivers
from sim.radar.recording import save_recording
from sim.radar.spectra import noise_power, range_doppler, range_doppler_noise
from tests.worlds.radar_recordings import DECAY_S, WIDE, frames_of, recording_of, truth

FRAMES = 48
HARDWARE = Hardware(
    {"ds": "a data sheet"},
    {"status": "typical", "value": {"rx_positions_m": [[0.0, 0.0025, 0.0], [0.0, 0.0, 0.0025]]}},
    {"status": "datasheet", "source": "ds", "value": {"adc_bits": 12}},
)


@cache
def fitted() -> Calibration:
    return calibrate(recording_of(frames_of(truth(), FRAMES)))


def row(name: str) -> Fitted:
    return next(row for row in fitted().rows if row.name == name)


def reflector(place_bins: float, amplitude: float, growth: float = 0.0) -> np.ndarray:
    """Return a constant beat signal (2, M, N)."""
    t = (np.arange(64) - 31.5) / 64.0
    tones = [amplitude * np.exp(growth * t) * np.cos(2.0 * np.pi * place_bins * t + phase) for phase in (0.4, 2.1)]
    return np.ascontiguousarray(np.broadcast_to(np.array(tones)[:, None], (2, 64, 64)))


def test_the_pattern_is_found_and_split_from_the_frames_start() -> None:
    true, found = truth(), fitted().impairments
    assert true.leakage is not None
    assert true.frame_start is not None
    assert found.leakage is not None
    assert found.frame_start is not None

    def total(i: Impairments) -> np.ndarray:
        assert i.leakage is not None
        return np.array(i.leakage.dc)[:, None] + np.array(i.leakage.sweep.counts)

    # Noise of the mean of all chirps: sigma 2 over 48 frames of 64, of which the start's fit takes its part.
    assert np.abs(total(found) - total(true)).max() < 0.25
    start = np.array(found.frame_start.sweep.counts) - np.array(true.frame_start.sweep.counts)
    assert np.sqrt((start**2).mean()) < 0.15
    assert found.frame_start.decay_s == pytest.approx(DECAY_S, rel=0.15)
    decay = row("frame start, decay")
    assert abs(decay.value[0] - 1e3 * DECAY_S) < 4.0 * decay.sigma[0] + 0.5


def test_the_noise_is_found_without_the_rounding_of_the_converter() -> None:
    true, found = truth().noise, fitted().impairments.noise
    assert true is not None
    assert found is not None
    ratio = np.array(found.power) / np.array(true.power)
    # 48 frames of 55 Doppler bins, which the window makes a little fewer: 2 % one sigma.
    assert np.abs(ratio[:, 1:-1] - 1.0).max() < 0.10
    assert ratio[:, 1:-1].mean() == pytest.approx(1.0, abs=0.01)
    assert np.abs(np.array(found.envelope) - 1.0).max() < 0.05
    # Without removing the rounding this would fail.
    assert truth().adc.noise_power / np.array(true.power).min() > 0.2  # type: ignore[union-attr]


def test_wander_and_odd_codes_are_found() -> None:
    true, found = truth(), fitted().impairments
    assert true.dc_wander is not None
    assert found.dc_wander is not None
    assert found.adc is not None
    assert true.adc is not None
    assert found.dc_wander.sigma == pytest.approx(true.dc_wander.sigma, rel=0.08)
    assert found.adc.odd_code_share == pytest.approx(true.adc.odd_code_share, abs=0.01)


def test_a_simulation_with_the_fit_agrees_with_the_recording() -> None:
    result = compare(frames_of(fitted().impairments, 24, seed=9), frames_of(truth(), 24, seed=5))
    for name, pair in result.ncc.items():
        assert abs(pair.difference) < 0.01, f"{name}: {pair}"
    assert np.abs(result.noise_power_db).max() < 0.6
    assert np.abs(result.range_doppler_noise_db).max() < 0.1


def test_the_comparison_detects_missing_parts() -> None:
    real = frames_of(truth(), 6, seed=5)
    for part, variant in (("leakage", "linear"), ("leakage", "dB")):
        poor = frames_of(truth().model_copy(update={part: None}), 6, seed=9)
        pair = correlations(poor, real)[variant]
        assert pair.simulated_against_real < pair.real_against_real - 0.1, f"without {part}, {variant}: {pair}"
    quiet = compare(frames_of(truth().model_copy(update={"noise": None}), 6, seed=9), real)
    assert quiet.range_doppler_noise_db.max() < -3.0
    assert compare(real, real).ncc["linear"].simulated_against_real <= 1.0
    with pytest.raises(ValueError, match="two real ones"):
        correlations(real, real[:1])
    with pytest.raises(ValueError, match="simulated frames are"):
        correlations(real[:, :1], real)


def test_reflectors_are_found_and_taken_out_unless_kept() -> None:
    signal = reflector(12.3, 30.0, growth=-1.0) + reflector(21.7, 12.0, growth=0.5)
    recording = recording_of(frames_of(truth(), 16, signal=signal))
    clean, kept = calibrate(recording), calibrate(recording, keep_echoes=True)
    places = [place / WIDE.range_resolution_m for place in (echo.range_m for echo in clean.echoes)]
    assert places == pytest.approx([12.3, 21.7], abs=0.03)
    for echo, amplitude in zip(clean.echoes, (30.0, 12.0), strict=True):
        assert echo.amplitude == pytest.approx((amplitude,) * 2, rel=0.03)
    assert any("removed from" in w and "0.34, 0.59 m" in w for w in clean.warnings)
    assert any("kept in" in w for w in kept.warnings)

    def tones(calibration: Calibration) -> Any:
        leakage = calibration.impairments.leakage
        assert leakage is not None
        counts = np.array(leakage.sweep.counts) - np.array(truth().leakage.sweep.counts)  # type: ignore[union-attr]
        return np.abs(np.fft.rfft(counts * np.hanning(64), axis=-1)[:, [12, 22]]) / 16.0

    assert tones(kept).min() > 8.0
    assert tones(clean).max() < 0.6


def test_an_empty_scene_has_no_reflectors_and_no_warnings() -> None:
    assert fitted().echoes == ()
    assert fitted().warnings == ()


def test_without_a_frame_start_none_is_found() -> None:
    found = calibrate(recording_of(frames_of(truth().model_copy(update={"frame_start": None}), 16)))
    assert found.impairments.frame_start is None


def test_an_even_converter_and_no_wander_are_found() -> None:
    plain = truth().model_copy(update={"adc": None, "dc_wander": None})
    found = calibrate(recording_of(frames_of(plain, 16))).impairments
    assert found.adc is not None
    assert found.dc_wander is not None
    assert found.adc.odd_code_share == pytest.approx(0.5, abs=0.01)
    assert max(found.dc_wander.sigma) < 0.1


def test_clipping_and_movement_are_reported() -> None:
    loud = reflector(1.4, 1945.0)
    assert any("clipped" in w for w in calibrate(recording_of(frames_of(truth(), 8, signal=loud))).warnings)
    adc = np.concatenate([frames_of(truth(), 8, signal=reflector(14.0, a), seed=int(a)) for a in (20.0, 90.0)])
    warnings = calibrate(recording_of(adc)).warnings
    assert any("something moved" in w and "0.38" in w for w in warnings), warnings


@pytest.mark.parametrize(
    ("frames", "words"),
    [((0, 7), "7 frames are too few"), ((0, 99), "the recording has 16"), ((5, 5), "5:5"), ((9, 3), "9:3")],
)
def test_frames_that_cannot_be_fitted_are_refused(frames: tuple[int, int], words: str) -> None:
    recording = recording_of(frames_of(truth(), 16))
    with pytest.raises(ConfigError, match=words):
        calibrate(recording, frames=frames)


def test_a_dead_receiver_is_named() -> None:
    adc = frames_of(truth(), 8)
    adc[:, 1] = 2048
    with pytest.raises(ConfigError, match="receiver 2 shows one code only"):
        calibrate(recording_of(adc))


def test_frames_without_noise_of_their_own_are_refused() -> None:
    """One frame over and over was fitted with deviations of 0."""
    adc = frames_of(truth(), 16)
    adc[9] = adc[8]
    with pytest.raises(ConfigError, match="frame 9 repeats the one before it to the last code: noise never does"):
        calibrate(recording_of(adc))
    with pytest.raises(ConfigError, match="frame 9 repeats"):
        calibrate(recording_of(adc), frames=(4, 12))
    assert calibrate(recording_of(adc), frames=(0, 9)).warnings == ()
    adc[:] = adc[0]
    with pytest.raises(ConfigError, match="frame 1 repeats the one before it to the last code, as 14 more do"):
        calibrate(recording_of(adc))
    with pytest.raises(ConfigError, match=r"\d % of the samples are clipped, which hides leakage and noise"):
        calibrate(recording_of(frames_of(truth(), 8, signal=reflector(1.4, 2500.0))))


def test_a_tone_shows_its_amplitude_and_white_noise_its_variance() -> None:
    tone = reflector(8.0, 100.0)[None]
    image = range_doppler(tone + 0.0)
    assert image[0, 0, 32, 8] == pytest.approx(100.0, rel=1e-9)
    assert range_doppler(tone, remove_mean=True).max() < 1e-9
    rng = np.random.Generator(np.random.Philox(1))
    white = rng.normal(0.0, 3.0, (20, 1, 64, 64))
    assert noise_power(white).mean(axis=0)[0, 1:-1] == pytest.approx(9.0, rel=0.15)
    assert noise_power(white).mean() == pytest.approx(9.0, rel=0.02)
    # Peak-amplitude normalisation of two Hann windows: rms = 2 sigma sqrt(1.5 1.5 / (64 64)).
    rms = range_doppler_noise(range_doppler(white), first_bin=2)
    assert rms == pytest.approx(2.0 * 3.0 * 1.5 / 64.0, rel=0.03)


def test_the_preset_reads_back_as_what_was_fitted() -> None:
    recording = recording_of(frames_of(truth(), 16))
    calibration = calibrate(recording)
    data = yaml.safe_load(preset_text(calibration, recording, HARDWARE, part='a "part"', source="r.npz"))
    parameters = data["parameters"]
    assert data["kind"] == "radar"
    assert data["part"] == 'a "part"'
    assert data["sources"] == {"recording": "r.npz, frames 0 to 15", "ds": "a data sheet"}
    assert Impairments.model_validate(parameters["impairments"]["value"]) == calibration.impairments
    assert type(WIDE).model_validate(parameters["chirp"]["value"]) == WIDE
    assert parameters["receiver"]["value"] == {"adc_bits": 12, "hp_cutoff_hz": 80e3, "aaf_cutoff_hz": 500e3}
    assert parameters["impairments"]["status"] == "measured"


def test_receivers_are_those_of_the_recording() -> None:
    second = with_receivers(HARDWARE, (2,))
    assert second is not None
    assert second.antenna["value"]["rx_positions_m"] == [[0.0, 0.0, 0.0025]]
    assert with_receivers(HARDWARE, (1, 3)) is None


@pytest.fixture
def recording_file(tmp_path: Path) -> Path:
    path = tmp_path / "empty room.npz"
    save_recording(path, recording_of(frames_of(truth(), 10)))
    return path


def test_the_command_writes_preset_and_picture_and_prints_the_table(
    recording_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.chdir(tmp_path)
    assert run_command_line(["calibrate", "radar", str(recording_file), "--frames", "1:10"]) == 0
    printed = capsys.readouterr().out
    assert "frames 1 to 9" in printed
    assert "DC wander [counts]" in printed
    parameters = yaml.safe_load((tmp_path / "empty_room.yaml").read_text())["parameters"]
    Impairments.model_validate(parameters["impairments"]["value"])
    assert (tmp_path / "empty_room.png").read_bytes()[:4] == b"\x89PNG"
    out = tmp_path / "new" / "mine.yaml"
    assert run_command_line(["calibrate", "radar", str(recording_file), "--out", str(out), "--name", "mine"]) == 0
    assert yaml.safe_load(out.read_text())["part"] == "mine"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--frames", "all"], "--frames: must be FIRST:END"),
        (["--frames", "0:99"], "the recording has 10"),
        (["--frames", "0:3"], "too few"),
        (["--name", "../x"], "--name: must be letters"),
        (["--out", "x.txt"], "--out: must name a YAML file"),
    ],
)
def test_the_command_refuses_options_with_a_reason(
    recording_file: Path, options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["calibrate", "radar", str(recording_file), *options]) == 2
    assert words in capsys.readouterr().err


def test_the_command_refuses_other_files(
    recording_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["calibrate", "radar", str(tmp_path / "none.npz")]) == 2
    assert "does not exist" in capsys.readouterr().err
    np.savez(recording_file, adc=np.zeros((10, 2, 32, 64), np.uint16))
    assert run_command_line(["calibrate", "radar", str(recording_file)]) == 2
    assert "has 32 chirps" in capsys.readouterr().err
    recording_file.write_text("nothing")
    assert run_command_line(["calibrate", "radar", str(recording_file)]) == 2
    assert "is not a radar recording" in capsys.readouterr().err


def test_receivers_that_the_chip_lacks_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, path = recording_of(frames_of(truth(), 10)), tmp_path / "r.npz"
    save_recording(path, replace(recording, rx_antennas=(2, *range(7, 6 + recording.receivers))))
    assert run_command_line(["calibrate", "radar", str(path)]) == 2
    assert "uses the receivers 2, 7" in capsys.readouterr().err


def test_an_unwritable_output_ends_with_an_error(
    recording_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").write_text("a file")
    out = tmp_path / "taken" / "x.yaml"
    assert run_command_line(["calibrate", "radar", str(recording_file), "--out", str(out)]) == 3
    assert "taken: cannot be used as a folder for results" in capsys.readouterr().err
