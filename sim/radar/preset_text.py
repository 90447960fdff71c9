"""A calibration as the text of a sensor preset (sim/sensors/presets.py).

What a recording of a still scene cannot tell, where the antennas are and what an echo's power is in counts, is taken
over from the preset of a known part, with the status and the sources it has there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from hil.signals.errors import ConfigError, Problem
from sim.radar.calibration import Calibration
from sim.radar.impairments import Impairments
from sim.radar.recording import Recording

_SOURCE = "recording"
_WIDTH = 118


@dataclass(frozen=True)
class Hardware:
    """Figures of a part that are not fitted, as a preset file holds them."""

    sources: Mapping[str, str]
    antenna: Mapping[str, Any]
    receiver: Mapping[str, Any]


def hardware_of(preset: Path) -> Hardware:
    """Of a preset file of this project. Raises ConfigError where it is no radar's."""
    try:
        data = yaml.safe_load(preset.read_text(encoding="utf-8"))
        parameters = data["parameters"]
        return Hardware(data["sources"], parameters["antenna"], parameters["receiver"])
    except (OSError, yaml.YAMLError, KeyError, TypeError) as error:
        raise ConfigError([Problem(str(preset), f"tells no antenna and receiver of a radar: {error!r}")]) from error


def with_receivers(hardware: Hardware, antennas: Sequence[int]) -> Hardware | None:
    """Only the receivers numbered (from 1) in `antennas`; None where the part has no such receiver."""
    positions = hardware.antenna["value"]["rx_positions_m"]
    if not all(1 <= a <= len(positions) for a in antennas):
        return None
    value = dict(hardware.antenna["value"]) | {"rx_positions_m": [positions[a - 1] for a in antennas]}
    return Hardware(hardware.sources, dict(hardware.antenna) | {"value": value}, hardware.receiver)


def preset_text(calibration: Calibration, recording: Recording, hardware: Hardware, *, part: str, source: str) -> str:
    """The whole file. `source` says which recording this is, for people."""
    first, last = calibration.frames
    used = {figure["source"] for figure in (hardware.antenna, hardware.receiver) if figure.get("source")}
    sources = {_SOURCE: f"{source}, frames {first} to {last - 1}"} | {
        key: text for key, text in hardware.sources.items() if key in used
    }
    echoes = "with the reflectors of that scene" if calibration.keeps_echoes else "its reflectors taken out"
    note = f"fitted by `hil calibrate radar`{', ' + echoes if calibration.echoes else ''}"
    receiver = dict(hardware.receiver["value"])
    for key, hertz in (("hp_cutoff_hz", recording.hp_cutoff_hz), ("aaf_cutoff_hz", recording.aaf_cutoff_hz)):
        if hertz is not None:
            receiver[key] = hertz
    lines = ["kind: radar", f"part: {_quoted(part)}", "sources:"]
    lines += [f"  {key}: {_quoted(text)}" for key, text in sources.items()]
    lines += ["parameters:"]
    lines += _figure("chirp", {"status": "measured", "source": _SOURCE, "note": "the settings of the recording"})
    lines += _block("value", recording.chirp.model_dump(), 4)
    lines += _figure("antenna", hardware.antenna)
    lines += _block("value", hardware.antenna["value"], 4)
    lines += _figure("receiver", hardware.receiver)
    lines += _block("value", receiver, 4)
    lines += _figure("impairments", {"status": "measured", "source": _SOURCE, "note": note})
    lines += impairments_lines(calibration.impairments, 4)
    return "\n".join(lines) + "\n"


def impairments_lines(impairments: Impairments, indent: int) -> list[str]:
    """`value:` and what belongs to it, rows of numbers wrapped."""
    return _block("value", impairments.model_dump(exclude_none=True), indent)


def _figure(name: str, figure: Mapping[str, Any]) -> list[str]:
    lines = [f"  {name}:", f"    status: {figure['status']}"]
    lines += [f"    source: {figure['source']}"] if figure.get("source") else []
    lines += [f"    note: {_quoted(figure['note'])}"] if figure.get("note") else []
    return lines


def _block(key: str, value: Any, indent: int) -> list[str]:
    """`key: value`: mappings in block form, lists of numbers on as few lines as hold them."""
    pad = " " * indent
    if isinstance(value, Mapping):
        lines = [f"{pad}{key}:"]
        for inner, item in value.items():
            lines += _block(inner, item, indent + 2)
        return lines
    if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple):
        lines = [f"{pad}{key}:"]
        for row in value:
            lines += _wrapped(f"{pad}  - [", row, indent + 5)
        return lines
    if isinstance(value, list | tuple):
        return _wrapped(f"{pad}{key}: [", value, indent + 2)
    return [f"{pad}{key}: {_scalar(value)}"]


def _wrapped(head: str, row: Sequence[Any], indent: int) -> list[str]:
    lines, line = [], head
    for i, value in enumerate(row):
        text = _scalar(value) + (", " if i + 1 < len(row) else "]")
        if len(line) + len(text.rstrip()) > _WIDTH:
            lines.append(line.rstrip())
            line = " " * indent
        line += text
    return [*lines, line]


def _scalar(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = repr(value)
        # YAML 1.1 takes 1e-06 for a word: a number needs its point and the sign of its exponent.
        if "e" in text:
            mantissa, exponent = text.split("e")
            return f"{mantissa if '.' in mantissa else mantissa + '.0'}e{int(exponent):+d}"
        return text
    return _quoted(value) if isinstance(value, str) else str(value)


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ") + '"'
