"""Recording of raw radar samples, with the settings of the device in a JSON file beside it.

    recording.npz   with the array `adc`, or recording.npy: frames x receivers x chirps x samples, uint16 codes
    recording.json  {"device_config": {"fmcw_single_shape": {...}}}, or {"fmcw_single_shape": {...}}

The keys of `fmcw_single_shape` are those of the maker's recorder. Required are start_frequency_Hz, end_frequency_Hz,
sample_rate_Hz, num_samples_per_chirp, num_chirps_per_frame, chirp_repetition_time_s and rx_antennas; optional are
frame_repetition_time_s, hp_cutoff_Hz and aaf_cutoff_Hz.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
from numpy.typing import NDArray

from signals.errors import ConfigError, Problem, file_errors
from sim.radar.chirp import Chirp

ADC_BITS = 12
_SHAPE_KEY = "fmcw_single_shape"
_MAX_SETTING = 1e12  # greatest number in the settings
_SLACK = 1e-6  # relative tolerance
_MAX_FRAME_S = 3600.0  # greatest time between frames


@dataclass(frozen=True)
class Recording:
    """Frames of one radar. `adc[f, k, m, n]`: sample n of chirp m at receiver k in frame f."""

    adc: NDArray[np.uint16]
    chirp: Chirp
    rx_antennas: tuple[int, ...]
    frame_repetition_s: float | None = None
    hp_cutoff_hz: float | None = None
    aaf_cutoff_hz: float | None = None

    @property
    def frames(self) -> int:
        return int(self.adc.shape[0])

    @property
    def receivers(self) -> int:
        return int(self.adc.shape[1])


def settings_path(path: Path) -> Path:
    """Return the path of a recording's JSON file."""
    return path.with_suffix(".json")


def load_recording(path: Path) -> Recording:
    """Read samples and settings. Raises ConfigError with every problem found."""
    problems: list[Problem] = []
    adc = _samples(path, problems)
    shape = _settings(settings_path(path), problems)
    recording = _recording(adc, shape, settings_path(path), problems) if adc is not None and shape else None
    if recording is not None:
        problems += _mismatches(path, recording)
    if problems or recording is None:
        raise ConfigError(problems)
    return recording


def save_recording(path: Path, recording: Recording) -> None:
    """Write `path` (.npz or .npy) and its JSON file. Raises ConfigError or RecordingError."""
    if path.suffix not in (".npz", ".npy"):
        raise ConfigError.at(str(path), "a radar recording is a .npz or .npy file")
    config = device_config(
        recording.chirp,
        recording.rx_antennas,
        frame_repetition_s=recording.frame_repetition_s,
        hp_cutoff_hz=recording.hp_cutoff_hz,
        aaf_cutoff_hz=recording.aaf_cutoff_hz,
    )
    with file_errors(path):
        if path.suffix == ".npz":
            np.savez_compressed(path, adc=recording.adc)
        else:
            np.save(path, recording.adc)
        text = json.dumps(config, indent=4) + "\n"
        settings_path(path).write_text(text, encoding="utf-8")


def device_config(
    chirp: Chirp,
    rx_antennas: Sequence[int],
    *,
    frame_repetition_s: float | None = None,
    hp_cutoff_hz: float | None = None,
    aaf_cutoff_hz: float | None = None,
) -> dict[str, Any]:
    """Return the settings in the form of the JSON file."""
    shape: dict[str, Any] = {
        "rx_antennas": list(rx_antennas),
        "num_chirps_per_frame": chirp.chirps,
        "num_samples_per_chirp": chirp.samples,
        "sample_rate_Hz": chirp.sample_rate_hz,
        "start_frequency_Hz": chirp.start_frequency_hz,
        "end_frequency_Hz": chirp.start_frequency_hz + chirp.bandwidth_hz,
        "chirp_repetition_time_s": chirp.repetition_s,
    }
    for key, value in (
        ("frame_repetition_time_s", frame_repetition_s),
        ("hp_cutoff_Hz", hp_cutoff_hz),
        ("aaf_cutoff_Hz", aaf_cutoff_hz),
    ):
        if value is not None:
            shape[key] = value
    return {"device_config": {_SHAPE_KEY: shape}}


def _samples(path: Path, problems: list[Problem]) -> NDArray[Any] | None:
    if path.suffix not in (".npz", ".npy"):
        problems.append(Problem(str(path), "is not a radar recording", "a .npz with an array `adc`, or a .npy"))
        return None
    try:
        loaded = np.load(path, allow_pickle=False)  # detects the format by the content
        if isinstance(loaded, np.ndarray):
            return loaded
        with loaded:
            if "adc" not in loaded.files:
                problems.append(
                    Problem(str(path), f"holds no array `adc`, only {', '.join(loaded.files) or 'nothing'}")
                )
                return None
            return np.asarray(loaded["adc"])
    except FileNotFoundError:
        problems.append(Problem(str(path), "does not exist", "check the path"))
    except Exception as error:  # noqa: BLE001 - damaged files raise many types: zlib.error, TokenError, MemoryError
        problems.append(Problem(str(path), f"is not a radar recording: {error}"))
    return None


def _settings(path: Path, problems: list[Problem]) -> Mapping[str, Any]:
    """Return the mapping `fmcw_single_shape`; empty if there is none."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        problems.append(Problem(str(path), "does not exist", "it must hold the settings of the recording"))
        return {}
    except (OSError, ValueError, RecursionError) as error:  # ValueError: no UTF-8, no JSON, thousands of digits
        problems.append(Problem(str(path), f"is not JSON: {error}"))
        return {}
    outer = data.get("device_config", data) if isinstance(data, dict) else None
    shape = outer.get(_SHAPE_KEY) if isinstance(outer, dict) else None
    if not isinstance(shape, dict) or not shape:
        problems.append(Problem(str(path), f"holds no {_SHAPE_KEY}, at the top or in device_config"))
        return {}
    return shape


def _recording(adc: NDArray[Any], shape: Mapping[str, Any], path: Path, problems: list[Problem]) -> Recording | None:
    before = len(problems)

    def number(key: str, *, needed: bool = True) -> float | None:
        value = shape.get(key)
        if value is None and not needed:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= _MAX_SETTING:
            message = f"must be a number above 0, not {value!r:.40} ({_MAX_SETTING:g} at most)"
            problems.append(Problem(str(path), f"{_SHAPE_KEY}.{key} {message if key in shape else 'is missing'}"))
            return None
        if key.startswith("num_") and value != int(value):
            problems.append(Problem(str(path), f"{_SHAPE_KEY}.{key} must be a whole number, not {value!r}"))
            return None
        return float(value)

    needed = {
        key: number(key)
        for key in (
            "start_frequency_Hz",
            "end_frequency_Hz",
            "sample_rate_Hz",
            "num_samples_per_chirp",
            "num_chirps_per_frame",
            "chirp_repetition_time_s",
        )
    }
    antennas = shape.get("rx_antennas")
    if not isinstance(antennas, list) or not antennas or not all(type(a) is int for a in antennas):
        problems.append(Problem(str(path), f"{_SHAPE_KEY}.rx_antennas must list the receivers, as [1, 2, 3]"))
        antennas = []
    elif len(set(antennas)) < len(antennas):
        problems.append(Problem(str(path), f"{_SHAPE_KEY}.rx_antennas names a receiver twice: {antennas}"))
    frame, high_pass, low_pass = (
        number(key, needed=False) for key in ("frame_repetition_time_s", "hp_cutoff_Hz", "aaf_cutoff_Hz")
    )
    if len(problems) > before:
        return None
    start, end, rate, samples, chirps, repetition = (value or 0.0 for value in needed.values())
    try:
        chirp = Chirp(
            center_frequency_hz=0.5 * (start + end),
            bandwidth_hz=end - start,
            samples=int(samples),
            sample_rate_hz=rate,
            chirps=int(chirps),
            repetition_s=repetition,
        )
    except pydantic.ValidationError as error:
        problems += [Problem(str(path), f"{_SHAPE_KEY} is not a valid chirp: {item['msg']}") for item in error.errors()]
        return None
    min_s = (chirp.chirps - 1) * chirp.repetition_s + chirp.sampling_s
    if frame is not None and not min_s * (1.0 - _SLACK) <= frame <= _MAX_FRAME_S:
        message = f"{_SHAPE_KEY}.frame_repetition_time_s is {frame:g}, not {min_s:g} (a frame's own time) to 3600"
        problems.append(Problem(str(path), message))
        return None
    return Recording(adc, chirp, tuple(antennas), frame, high_pass, low_pass)


def _mismatches(path: Path, recording: Recording) -> list[Problem]:
    """Return the mismatches between samples and settings."""
    adc, chirp = recording.adc, recording.chirp
    expected = (len(recording.rx_antennas), chirp.chirps, chirp.samples)
    if adc.ndim != 4:
        return [Problem(str(path), f"has {adc.ndim} dimensions", "needs frames x receivers x chirps x samples")]
    problems = [
        Problem(str(path), f"has {found} {dimension}, but {settings_path(path).name} gives {stated}")
        for dimension, found, stated in zip(("receivers", "chirps", "samples"), adc.shape[1:], expected, strict=True)
        if found != stated
    ]
    if adc.dtype != np.uint16:
        problems.append(Problem(str(path), f"holds {adc.dtype}, not the codes of the converter (uint16)"))
    elif adc.size and int(adc.max()) >= 2**ADC_BITS:
        problems.append(Problem(str(path), f"holds the code {int(adc.max())}; a {ADC_BITS}-bit converter ends at 4095"))
    if adc.shape[0] < 1:
        problems.append(Problem(str(path), "holds no frame"))
    return problems
