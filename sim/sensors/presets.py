"""Presets: one file in `sim/sensors/preset_files/` per real device. A new device is a new file and no other change.

    kind: barometer
    part: "TE Connectivity MS5611-01BA03"
    sources: {ds: "TE Connectivity MS5611-01BA03 datasheet"}
    parameters:
      noise_pa: {value: 1.2, stated: "0.012 mbar", status: verified, source: ds, note: "RMS at OSR 4096"}

`value` is in the unit of the parameter's name, `stated` is the figure as printed in the source, and `status` is the
reliability of the value:

    verified    read in the maker's document, or in a statement of the maker, when the file was written
    secondary   read in a table or forum of another author
    datasheet   the datasheet's figure from memory, not compared with the datasheet: check it before you rely on it
    typical     typical of the class of the device; no source states it
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

from signals.documents.document import Document, Place
from signals.documents.validate import StrictModel, load_model, validate
from signals.errors import ConfigError
from sim.frame.quality import QUALITIES, with_quality
from sim.sensors.kinds import KINDS

PRESET_DIR = Path(__file__).with_name("preset_files")

_Text = Annotated[str, Field(min_length=1)]


class Figure(StrictModel):
    """Value of one parameter with its source."""

    value: Any
    status: Literal["verified", "secondary", "datasheet", "typical", "measured", "choice"]
    stated: str = ""
    source: str = ""
    note: str = ""


class PresetFile(StrictModel):
    """Contents of a preset file."""

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
                raise ValueError(f"parameters.{name} is {figure.status!r} and needs a source")
        return self


@dataclass(frozen=True)
class Preset:
    """Real device: kind, parameters and their sources."""

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
    """Document of a preset file, in which the place of a parameter is that of its key `value`."""

    document: Document

    def where(self, place: Place) -> str:
        return self.document.where((*place[:2], "value", *place[2:]))


def load_preset(path: Path) -> Preset:
    """Read one preset file. Raises ConfigError with every problem found."""
    file, document = load_model(path, PresetFile)
    values = {name: figure.value for name, figure in file.parameters.items()}
    if file.kind == "camera" and values.get("quality") in QUALITIES:
        values = with_quality(values, values["quality"], given=values)
    parameters, problems = validate(KINDS[file.kind].parameters, values, _Figures(document), below=("parameters",))
    if parameters is None or problems:
        raise ConfigError(problems)
    return Preset(file.kind, file.part, parameters, file.parameters, file.sources)


class PresetFolder(Mapping[str, Preset]):
    """Presets of a folder by file name, sorted; each is read on first use."""

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
