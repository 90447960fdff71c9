"""Recordings: what is written is read, and what is not a recording is refused with every reason."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signals.errors import ConfigError
from sim.radar.recording import Recording, load_recording, save_recording
from tests.worlds.radar_recordings import WIDE, recording_of

CODES = (np.arange(3 * 2 * 64 * 64) % 4096).astype(np.uint16).reshape(3, 2, 64, 64)


def saved(folder: Path, *, suffix: str = ".npz", adc: Any = CODES, **changes: Any) -> Path:
    """A recording whose settings are those of `CODES`, with `changes`; a None removes the key."""
    path = folder / f"r{suffix}"
    save_recording(path, recording_of(CODES))
    if suffix == ".npz":
        np.savez(path, adc=adc)
    else:
        np.save(path, adc)
    settings = path.with_suffix(".json")
    data = json.loads(settings.read_text())
    shape = data["device_config"]["fmcw_single_shape"]
    shape |= changes
    for key in [key for key, value in shape.items() if value is None]:
        del shape[key]
    settings.write_text(json.dumps(data))
    return path


def refusal(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load_recording(path)
    assert all(path.stem in problem.where for problem in caught.value.problems)
    return str(caught.value)


@pytest.mark.parametrize("suffix", [".npz", ".npy"])
def test_what_is_written_is_read(tmp_path: Path, suffix: str) -> None:
    given = Recording(CODES, WIDE, (1, 3), 0.08, 80e3, 500e3)
    save_recording(tmp_path / f"r{suffix}", given)
    found = load_recording(tmp_path / f"r{suffix}")
    assert np.array_equal(found.adc, CODES)
    assert found.adc.dtype == np.uint16
    assert (found.rx_antennas, found.frame_repetition_s, found.hp_cutoff_hz, found.aaf_cutoff_hz) == (
        (1, 3),
        0.08,
        80e3,
        500e3,
    )
    assert found.chirp == WIDE
    assert (found.frames, found.receivers) == (3, 2)


def test_settings_may_stand_at_the_top_and_the_filters_may_be_left_out(tmp_path: Path) -> None:
    path = saved(tmp_path, hp_cutoff_Hz=None, aaf_cutoff_Hz=None, frame_repetition_time_s=None)
    settings = path.with_suffix(".json")
    settings.write_text(json.dumps(json.loads(settings.read_text())["device_config"]))
    found = load_recording(path)
    assert (found.hp_cutoff_hz, found.aaf_cutoff_hz, found.frame_repetition_s) == (None, None, None)
    assert found.chirp == WIDE


def test_a_missing_file_and_missing_settings_are_both_reported(tmp_path: Path) -> None:
    words = refusal(tmp_path / "none.npz")
    assert "none.npz: does not exist" in words
    assert "none.json: does not exist" in words
    path = saved(tmp_path)
    path.with_suffix(".json").unlink()
    assert "r.json: does not exist" in refusal(path)


@pytest.mark.parametrize("content", [b"", b"not a recording", b"\x93NUMPY\x01\x00", b"PK\x03\x04 no zip"])
@pytest.mark.parametrize("suffix", [".npz", ".npy"])
def test_a_file_of_something_else_is_refused(tmp_path: Path, content: bytes, suffix: str) -> None:
    path = saved(tmp_path, suffix=suffix)
    path.write_bytes(content)
    assert "is not a radar recording" in refusal(path)


def with_header(shape: str) -> bytes:
    header = f"{{'descr': '<u2', 'fortran_order': False, 'shape': {shape}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + b"\x00" * 64


def damaged(folder: Path, at: int, damage: bytes) -> bytes:
    path = folder / "z.npz"
    np.savez_compressed(path, adc=np.random.default_rng(1).integers(0, 4096, CODES.shape).astype(np.uint16))
    whole = bytearray(path.read_bytes())
    whole[at : at + len(damage)] = damage
    return bytes(whole)


def test_damaged_files_are_refused_whatever_their_readers_raise(tmp_path: Path) -> None:
    """zlib.error, RuntimeError (encrypted), MemoryError, tokenize.TokenError: none is an OSError or a ValueError."""
    path = saved(tmp_path)
    encrypted = damaged(tmp_path, 6, b"\x01")
    directory = encrypted.index(b"PK\x01\x02")
    encrypted = encrypted[: directory + 8] + b"\x01" + encrypted[directory + 9 :]
    for content in (
        damaged(tmp_path, 2000, b"\xff" * 500),
        encrypted,
        with_header("(900000000000, 2, 64, 64), }"),
        with_header("(((("),
    ):
        path.write_bytes(content)
        assert "is not a radar recording" in refusal(path)


@pytest.mark.parametrize(("suffix", "other"), [(".npz", ".npy"), (".npy", ".npz")])
def test_the_other_formats_suffix_does_not_matter(tmp_path: Path, suffix: str, other: str) -> None:
    path = saved(tmp_path, suffix=suffix)
    renamed = path.rename(path.with_suffix(other))
    assert np.array_equal(load_recording(renamed).adc, CODES)


def test_another_suffix_and_another_array_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path)
    other = tmp_path / "r.csv"
    other.write_bytes(path.read_bytes())
    assert "r.csv: is not a radar recording" in refusal(other)
    np.savez(path, data=CODES)
    assert "holds no array `adc`, only data" in refusal(path)
    np.savez(path, adc=np.array([{}], dtype=object))
    assert "is not a radar recording" in refusal(path)


@pytest.mark.parametrize(
    ("adc", "words"),
    [
        (CODES[:, :1], "has 1 receivers, but r.json gives 2"),
        (CODES[:, :, :32], "has 32 chirps, but r.json gives 64"),
        (CODES[..., :32], "has 32 samples, but r.json gives 64"),
        (CODES[0], "has 3 dimensions"),
        (CODES.astype(np.float32), "holds float32, not the codes"),
        (CODES.astype(np.int16), "holds int16, not the codes"),
        (CODES + np.uint16(1), "holds the code 4096"),
        (CODES[:0], "holds no frame"),
    ],
)
def test_samples_that_are_not_what_the_settings_say_are_refused(tmp_path: Path, adc: Any, words: str) -> None:
    assert words in refusal(saved(tmp_path, adc=adc))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start_frequency_Hz": None}, "fmcw_single_shape.start_frequency_Hz is missing"),
        ({"sample_rate_Hz": "fast"}, "sample_rate_Hz must be a number above 0, not 'fast'"),
        ({"sample_rate_Hz": True}, "sample_rate_Hz must be a number"),
        ({"chirp_repetition_time_s": -1.0}, "chirp_repetition_time_s must be a number above 0"),
        ({"chirp_repetition_time_s": 1e-6}, "not a valid chirp"),
        ({"end_frequency_Hz": 58e9}, "not a valid chirp"),
        ({"rx_antennas": []}, "rx_antennas must list"),
        ({"rx_antennas": "1, 2"}, "rx_antennas must list"),
        ({"num_samples_per_chirp": 0}, "num_samples_per_chirp must be a number above 0"),
        ({"num_samples_per_chirp": 64.5}, "num_samples_per_chirp must be a whole number, not 64.5"),
        ({"sample_rate_Hz": 10**400}, "sample_rate_Hz must be a number above 0"),
        ({"hp_cutoff_Hz": 1e300}, "hp_cutoff_Hz must be a number above 0, not 1e+300 (1e+12 at most)"),
        ({"frame_repetition_time_s": 1e-3}, "frame_repetition_time_s is 0.001, not"),
        ({"frame_repetition_time_s": 1e9}, "to 3600"),
        ({"rx_antennas": [3, 3]}, "rx_antennas names a receiver twice"),
    ],
)
def test_settings_that_cannot_be_are_refused(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    assert words in refusal(saved(tmp_path, **changes))


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"device_config": 3}', '{"fmcw_single_shape": []}', "\x00", "9" * 5000]
)
def test_settings_that_are_no_settings_are_refused(tmp_path: Path, text: str) -> None:
    path = saved(tmp_path)
    path.with_suffix(".json").write_text(text)
    words = refusal(path)
    assert "r.json" in words
    assert "is not JSON" in words or "holds no fmcw_single_shape" in words


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    words = refusal(saved(tmp_path, sample_rate_Hz=None, start_frequency_Hz=None))
    assert "sample_rate_Hz is missing" in words
    assert "start_frequency_Hz is missing" in words


def test_it_is_written_only_where_it_can_be(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"\.npz or \.npy"):
        save_recording(tmp_path / "r.csv", recording_of(CODES))
