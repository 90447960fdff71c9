"""Presets: one real device, one file in `sim/sensors/preset_files/`. A new device is a new file; nothing else changes.

    kind: barometer
    part: "TE Connectivity MS5611-01BA03"
    sources: {ds: "TE Connectivity MS5611-01BA03 datasheet"}
    parameters:
      noise_pa: {value: 1.2, stated: "0.012 mbar", status: verified, source: ds, note: "RMS at OSR 4096"}

`value` is in the unit of the parameter's name, `stated` the figure as the source prints it, and `status` says how far
to trust it:

    verified    read in the maker's document, or its maker's own words, when the file was written
    secondary   read in somebody else's table or forum
    datasheet   the datasheet's by common knowledge, not compared with it: check before you rely on it
    typical     no source states it; the class of the device
    measured    fitted to a recording of the part itself, which the source names (`hil calibrate`)
    choice      a setting of the usual driver or of this bench, not a property of the part
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from hil.signals.documents.document import Document, Place
from hil.signals.documents.validate import StrictModel, load_model, validate
from hil.signals.errors import ConfigError
from sim.frame.quality import QUALITIES, with_quality
from sim.sensors.kinds import KINDS

PRESET_DIR = Path(__file__).with_name("preset_files")

_Text = Annotated[str, Field(min_length=1)]


class Figure(StrictModel):
    """One parameter with where it is from."""

    value: Any
    status: Literal["verified", "secondary", "datasheet", "typical", "measured", "choice"]
    stated: str = ""
    source: str = ""
    note: str = ""


class PresetFile(StrictModel):
    """What a preset file holds."""

    kind: str
    part: _Text
    sources: dict[str, _Text]
    parameters: dict[str, Figure]

    @model_validator(mode="after")
    def _complete(self) -> PresetFile:
        if self.kind not in KINDS:
            raise ValueError(f"kind {self.kind!r} is unknown (kinds: {', '.join(KINDS)})")
        for name, figure in self.parameters.items():
            if figure.source and figure.source not in self.sources:
                raise ValueError(f"parameters.{name}.source {figure.source!r} is not among the sources")
            if figure.status in ("verified", "secondary", "datasheet", "measured") and not figure.source:
                raise ValueError(f"parameters.{name} is {figure.status!r} and so needs a source")
        return self


@dataclass(frozen=True)
class Preset:
    """One real device: kind, parameters, and where the numbers are from."""

    kind: str
    part: str
    parameters: StrictModel
    figures: Mapping[str, Figure]
    sources: Mapping[str, str]

    @property
    def source(self) -> str:
        """All sources in one line."""
        return "; ".join(self.sources.values())


@dataclass(frozen=True)
class _Figures:
    """Says of a parameter where a preset file has its value."""

    document: Document

    def where(self, place: Place) -> str:
        return self.document.where((*place[:2], "value", *place[2:]))


def load_preset(path: Path) -> Preset:
    """Read one preset file. Raises ConfigError with every problem found."""
    file, document = load_model(path, PresetFile)
    values = {name: figure.value for name, figure in file.parameters.items()}
    if file.kind == "camera" and values.get("quality") in QUALITIES:
        values = with_quality(values, values["quality"], said=values)
    parameters, problems = validate(KINDS[file.kind].parameters, values, _Figures(document), below=("parameters",))
    if parameters is None or problems:
        raise ConfigError(problems)
    return Preset(file.kind, file.part, parameters, file.parameters, file.sources)


class PresetFolder(Mapping[str, Preset]):
    """The presets of a folder by file name, sorted, each read when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self._paths = {path.stem: path for path in sorted(folder.glob("*.yaml"))}
        self._load = cache(load_preset)

    def __getitem__(self, name: str) -> Preset:
        return self._load(self._paths[name])

    def __contains__(self, name: object) -> bool:
        return name in self._paths

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)


PRESETS: Mapping[str, Preset] = PresetFolder(PRESET_DIR)
