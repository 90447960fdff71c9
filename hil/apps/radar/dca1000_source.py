"""Captures of a DCA1000 as a source of `hil radar`: FILE.bin with mmWave Studio's settings beside it.

The settings are those that a `*.setup.json` of the same folder names for FILE (`configUsed`), or else
`FILE.mmwave.json`, or else the folder's only `*.mmwave.json`. Antenna places and gains are those of the preset of the
device that the setup names; `--preset` takes its place.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PureWindowsPath
from typing import Any, BinaryIO

import numpy as np

from hil.apps.radar.sources import Frame, Source, settings_of, with_chirp
from signals.errors import ConfigError, Problem, RecordingError
from signals.time import NS_PER_S
from sim.radar.antenna import Antenna
from sim.radar.dca1000 import INT16
from sim.radar.dca1000_capture import CaptureSettings, capture_settings, raw_frame
from sim.sensors.catalog import PRESETS
from sim.sensors.radar_parameters import RadarParameters

_SETTINGS, _SETUP = ".mmwave.json", ".setup.json"
_NAMES = ("rawFileName", "processedFileName")
# Preset of a device by the digits of its name: xWR6843 has the antennas of the ISK, others those of their BOOST board.
_PRESET_OF_DIGITS = {"6843": "iwr6843isk", "1843": "awr1843boost", "2243": "awr2243boost"}
_FOUR_LANES = ("1243", "1443", "2243")


def open_capture(path: Path, *, preset: str | None, texts: Sequence[str]) -> Source:
    """Open a capture. Raises ConfigError; the frames raise RecordingError if the file changes while it is read."""
    if not path.is_file():
        raise ConfigError.at(str(path), "does not exist", "give a file that a DCA1000 wrote")
    settings_file, device = _settings_file(path)
    digits = "".join(c for c in device if c.isdigit())[:4]
    known_lanes = None if not digits else 4 if digits in _FOUR_LANES else 2
    capture = capture_settings(_json(settings_file), str(settings_file), lanes=known_lanes)
    if digits and capture.lanes != known_lanes:
        message = f"has {capture.lanes} LVDS lanes, and a {device} has {known_lanes}"
        raise ConfigError.at(str(settings_file), message, "are these the settings of this capture?")
    part = preset or (device if device in PRESETS else _PRESET_OF_DIGITS.get(digits, ""))
    if not part:
        names = ", ".join(sorted(_PRESET_OF_DIGITS.values()))
        message = f"is of the device {device!r}, whose antenna is not known" if device else "does not name its device"
        raise ConfigError.at(str(path), message, f"--preset NAME, such as {names}")
    count = _frames_in(path, settings_file, capture)
    base = settings_of(None, preset=part, default_preset=part, texts=texts)
    sampled = base.chirp.model_copy(update={"sampling": capture.chirp.sampling})
    base = base.model_copy(update={"antenna": _antenna(base, capture, settings_file), "chirp": sampled})
    parameters = with_chirp(base, capture.chirp, capture.channels, str(path))
    board, receiver = parameters.board, parameters.receiver.model_copy(update={"adc_bits": capture.adc_bits})
    if board is not None:
        timing = {"adc_start_s": capture.adc_start_s, "excess_s": capture.excess_s, "lvds_lanes": capture.lanes}
        board = board.model_copy(update=timing | {"tx_numbers": _order_of(capture)})
    parameters = parameters.model_copy(update={"board": board, "receiver": receiver})
    period_ns = round(capture.period_s * NS_PER_S)
    told = "" if capture.frames in (0, count) else f", {count} of {capture.frames} frames"
    frames = _frames(path, capture, count, period_ns)
    return Source(f"capture {path.name}{told}", parameters, count, False, frames, part=part)


def _settings_file(path: Path) -> tuple[Path, str]:
    """Return the file with the settings of a capture, and the device that a setup names; "": none does."""
    folder = path.parent
    for setup in sorted(folder.glob(f"*{_SETUP}")):
        content = _json(setup)
        captured = content.get("capturedFiles")
        rows = captured.get("files") if isinstance(captured, dict) else None
        named = [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
        names = {PureWindowsPath(str(row.get(key, ""))).name for row in named for key in _NAMES}
        if path.name not in names:
            continue
        device = str(content.get("mmWaveDevice", "")).lower()
        used = folder / PureWindowsPath(str(content.get("configUsed", ""))).name
        if used.is_file():
            return used, device
        message = f"names the settings {used.name} for {path.name}, and there is no such file beside it"
        raise ConfigError.at(str(setup), message, f"copy it to {folder}")
    own = path.with_suffix(_SETTINGS)
    found = [own] if own.is_file() else sorted(folder.glob(f"*{_SETTINGS}"))
    if len(found) == 1:
        return found[0], ""
    message = "has no settings beside it" if not found else f"may have any of {', '.join(f.name for f in found)}"
    raise ConfigError.at(str(path), message, f"mmWave Studio's JSON of this capture as {own.name}")


def _json(path: Path) -> Mapping[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError.at(str(path), f"is not JSON: {error}") from error
    if not isinstance(content, dict):
        raise ConfigError.at(str(path), f"expected an object, got a {type(content).__name__}")
    return content


def _frames_in(path: Path, settings_file: Path, capture: CaptureSettings) -> int:
    """Return the number of frames. Raises ConfigError if the file does not hold whole frames of these settings."""
    size, one = path.stat().st_size, capture.frame_bytes
    count, rest = divmod(size, one)
    chirp, form = capture.chirp, "complex" if capture.chirp.sampling == "complex" else "real"
    frame = f"{one} bytes ({chirp.chirps} chirps, {chirp.samples} {form} samples, {len(capture.receivers)} receivers)"
    if rest or not count:
        message = f"has {size} bytes: {count} frames of {frame} and {rest} bytes more"
        hint = f"a cut file, or not the settings of {settings_file.name}"
        if count:
            hint += f"; `truncate -s {count * one}` keeps the whole frames"
        raise ConfigError.at(str(path), message, hint)
    if capture.frames and count > capture.frames:
        message = f"has {count} frames of {frame}, and {settings_file.name} states {capture.frames}"
        raise ConfigError.at(str(path), message, "are samples real or complex, and all receivers on?")
    return count


def _order_of(capture: CaptureSettings) -> tuple[int, ...]:
    return tuple(number for turn in capture.transmitters for number in turn)


def _antenna(base: RadarParameters, capture: CaptureSettings, settings_file: Path) -> Antenna:
    """Return the antennas of the board that are on, in the order in which they transmit. Raises ConfigError."""
    antenna, numbers = base.antenna, base.board.tx_numbers if base.board is not None else ()
    place_of = dict(zip(numbers, range(len(antenna.tx_positions_m)), strict=False))
    problems: list[Problem] = []
    together = [turn for turn in capture.transmitters if len(turn) > 1]
    if together and antenna.array.doppler_bands:
        return antenna  # in Doppler division the settings do not tell the bands, and the preset does
    if together:
        message = f"txEnable: the transmitters {', '.join(map(str, together[0]))} send at once"
        problems.append(Problem(str(settings_file), message, "--preset FILE with mimo: ddm, for Doppler division"))
    for what, wanted, having in (
        ("transmitter", sorted({n for turn in capture.transmitters for n in turn}), sorted(place_of)),
        ("receiver", list(capture.receivers), list(range(1, len(antenna.rx_positions_m) + 1))),
    ):
        unknown = [n for n in wanted if n not in having]
        if unknown:
            message = f"has {what} {unknown[0]} on, and the preset's antenna has {what}s {', '.join(map(str, having))}"
            problems.append(Problem(str(settings_file), message, "--preset FILE of this board"))
    if problems:
        raise ConfigError(problems)
    tx, rx = [place_of[number] for number in _order_of(capture)], [number - 1 for number in capture.receivers]
    chosen = {"tx_positions_m": tx, "rx_positions_m": rx, "tx_cuts": tx, "rx_cuts": rx}
    kept = {key: getattr(antenna, key) for key in chosen}
    subset = {key: None if kept[key] is None else tuple(kept[key][i] for i in some) for key, some in chosen.items()}
    return antenna.model_copy(update=subset | {"field_deg": None})  # what the preset promises of its own chirp


def _frames(path: Path, capture: CaptureSettings, count: int, period_ns: int) -> Iterator[Frame]:
    with path.open("rb") as file:
        for index in range(count):
            yield Frame(index * period_ns, _frame(file, path, capture, index))


def _frame(file: BinaryIO, path: Path, capture: CaptureSettings, index: int) -> np.ndarray[Any, np.dtype[np.uint16]]:
    data = file.read(capture.frame_bytes)
    if len(data) < capture.frame_bytes:
        raise RecordingError(f"{path}: ended in frame {index} while it was read")
    try:
        return raw_frame(np.frombuffer(data, INT16), capture)
    except ValueError as error:
        raise RecordingError(f"{path}: frame {index}: {error}; b2AdcBits does not fit these samples") from error
