"""Text of a calibration as a sensor preset (sim/sensors/presets.py).

A recording of a still scene holds neither the positions of the antennas nor the power of an echo in counts. Both come
from the preset of a known device, with their status and sources.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from signals.documents.yaml_lines import dump_yaml, read_yaml
from signals.errors import ConfigError
from sim.radar.calibration import Calibration
from sim.radar.recording import Recording

_SOURCE = "recording"


@dataclass(frozen=True)
class Hardware:
    """Figures of a device that are not fitted, in the form of a preset file."""

    sources: Mapping[str, str]
    antenna: Mapping[str, Any]
    receiver: Mapping[str, Any]


def hardware_of(preset: Path) -> Hardware:
    """Return the hardware of a preset file of this project. Raises ConfigError if it is not a radar's."""
    try:
        data = read_yaml(preset).data
        parameters = data["parameters"]
        return Hardware(data["sources"], parameters["antenna"], parameters["receiver"])
    except (KeyError, TypeError) as error:
        raise ConfigError.at(str(preset), f"holds no antenna and receiver of a radar: {error!r}") from error


def with_receivers(hardware: Hardware, antennas: Sequence[int]) -> Hardware | None:
    """Return the hardware with only the receivers of these numbers (from 1); None if the device lacks one of them."""
    positions = hardware.antenna["value"]["rx_positions_m"]
    if not all(1 <= a <= len(positions) for a in antennas):
        return None
    value = dict(hardware.antenna["value"]) | {"rx_positions_m": [positions[a - 1] for a in antennas]}
    return Hardware(hardware.sources, dict(hardware.antenna) | {"value": value}, hardware.receiver)


def preset_text(calibration: Calibration, recording: Recording, hardware: Hardware, *, part: str, source: str) -> str:
    """Return the text of the preset file. `part`: name of the device; `source` describes the recording."""
    first, last = calibration.frames
    used = {figure["source"] for figure in (hardware.antenna, hardware.receiver) if figure.get("source")}
    sources = {_SOURCE: f"{source}, frames {first} to {last - 1}"} | {
        key: text for key, text in hardware.sources.items() if key in used
    }
    echoes = "with the scene's reflectors" if calibration.keeps_echoes else "the scene's reflectors removed"
    note = f"fitted by `hil calibrate radar`{', ' + echoes if calibration.echoes else ''}"
    receiver = dict(hardware.receiver["value"])
    for key, hertz in (("hp_cutoff_hz", recording.hp_cutoff_hz), ("aaf_cutoff_hz", recording.aaf_cutoff_hz)):
        if hertz is not None:
            receiver[key] = hertz
    measured = {"status": "measured", "source": _SOURCE}
    figures = {
        "chirp": measured | {"note": "the settings of the recording", "value": recording.chirp.model_dump()},
        "antenna": hardware.antenna,
        "receiver": {**hardware.receiver, "value": receiver},
        "impairments": measured | {"note": note, "value": calibration.impairments.model_dump(exclude_none=True)},
    }
    return dump_yaml({"kind": "radar", "part": part, "sources": sources, "parameters": figures})
