"""The file of a campaign: a base bench, the settings that vary, and how many flights to make.

    bench: hil.yaml
    settings: {mission: rigs/missions/short.waypoints}        # of every flight
    axes:                                                # crossed: every combination is flown
      scene: [airfield, city_park]
      seed: {first: 1, count: 5}
    samples: 24                                          # sampled points of every combination
    sampled:
      wind.steady_W_mps.0: {uniform: [-6, 6]}

An axis is the dotted key of a bench, as in `--set`; a number is the index in a list that `settings` contains. A value
of a crossed axis may also be `{label: NAME, settings: {...}}`, which sets several keys at once; the axis then has a
name of its own.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from hil.apps.campaign.cases.distributions import Distribution
from hil.config.files import default_bench, find
from signals.documents.document import Document, shown_path
from signals.documents.validate import StrictModel, at, load_model
from signals.documents.yaml_lines import read_yaml
from signals.errors import ConfigError, Problem

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class Range(StrictModel):
    """Whole numbers `first`, `first` + `step`, ... as the values of a crossed axis."""

    first: int = 1
    count: Annotated[int, Field(ge=1, le=10**12)]
    step: Annotated[int, Field(ge=1)] = 1


class Stop(StrictModel):
    """Conditions that end a campaign before its last flight; null: not applied (docs/campaigns.md)."""

    failure: bool = False  # at the first case that is not a PASS
    interval_width: Annotated[float, Field(gt=0, lt=1)] | None = None  # pass rate known this well
    rate_above: Share | None = None  # pass rate certainly above
    rate_below: Share | None = None  # pass rate certainly below
    time_s: Annotated[float, Field(gt=0)] | None = None  # wall clock


class Condition(StrictModel):
    """Values of one axis by their size; both ends belong to it."""

    above: float = float("-inf")
    below: float = float("inf")

    model_config = StrictModel.model_config | {"allow_inf_nan": True}


class CampaignSpec(StrictModel):
    """Every key of the file of a campaign."""

    description: str = ""
    bench: str | None = None  # null: ./hil.yaml, or the default bench
    settings: dict[str, Any] = Field(default_factory=dict)  # of every flight, merged over the bench
    axes: dict[str, Annotated[list[Any], Field(min_length=1)] | Range] = Field(default_factory=dict)
    samples: Annotated[int, Field(ge=1, le=10**12)] = 1
    sampled: dict[str, Distribution] = Field(default_factory=dict)
    method: Literal["random", "sobol", "latin_hypercube"] = "random"
    sampling_seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    repeats: Annotated[int, Field(ge=1, le=10**6)] = 1  # flights of each point, with consecutive seeds
    # Points that are not flown: those that meet all conditions of one entry. A condition is a value or above/below.
    skip: tuple[dict[str, Any], ...] = ()
    recheck: Share = 0.02  # of the cases are flown a second time elsewhere; another digest is a FLAKE
    keep: Literal["failures", "all", "none"] = "failures"  # flights that leave recordings and a report
    keep_at_most: Annotated[int, Field(ge=0, le=10**6)] = 50  # of the cases in the order of the plan
    cores: Annotated[int, Field(ge=1, le=1024)] = 1  # processors of one flight
    memory_mb: Annotated[int, Field(ge=1, le=10**7)] | None = None  # of one flight, for engine ray
    resources: dict[str, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)  # for engine ray: {px4_board: 1}
    flight_timeout_s: Annotated[float, Field(gt=0, le=86_400)] | None = None  # wall clock, then ERROR
    stop: Stop = Stop()

    @model_validator(mode="after")
    def _samples_what_it_samples(self) -> CampaignSpec:
        both = sorted(set(self.axes) & set(self.sampled))
        if both:
            raise ValueError(f"{both[0]} is in axes and in sampled: one axis cannot be both")
        if self.samples > 1 and not self.sampled:
            raise ValueError("samples has no effect without the section sampled; repeats flies a point again")
        if self.repeats > 1 and "seed" in (*self.axes, *self.sampled):
            raise ValueError("repeats fly other seeds, and seed is an axis here: use more values of seed instead")
        return self


@dataclass(frozen=True)
class CampaignFile:
    """A campaign's settings and the file that they were read from."""

    spec: CampaignSpec
    path: Path
    document: Document

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def bench_path(self) -> Path | None:
        """File of the base bench; None: a bench of defaults. Raises ConfigError if there is no such file."""
        if self.spec.bench is None:
            return default_bench()
        found = self.located(self.spec.bench)
        if not os.path.isfile(found):
            places = f"looked beside {shown_path(self.path)}, in the working directory and in the installation"
            raise ConfigError([at(self.document, ("bench",), f"names no file: {self.spec.bench}", places)])
        return found

    def located(self, name: str) -> Path:
        """Return the file that `name` is beside the campaign or in the working directory or the installation."""
        import rigs

        folders = (self.path.parent, Path(), Path(rigs.__file__).resolve().parent.parent)
        return next((folder / name for folder in folders if os.path.isfile(folder / name)), Path(name))

    def problem(self, place: tuple[str | int, ...], message: str, hint: str = "") -> Problem:
        """Return a problem at a place of the file."""
        return at(self.document, place, message, hint)


def load_campaign(path: Path) -> CampaignFile:
    """Read the file of a campaign, or the shipped one of this name. Raises ConfigError with every problem found."""
    path = _found(path)
    spec, document = load_model(path, CampaignSpec)
    if not document.data:  # such as a file whose writing was cut off
        raise ConfigError([at(document, (), "is empty", "write at least `bench: FILE`")])
    return CampaignFile(spec, path, document)


def _found(path: Path) -> Path:
    return path if path.exists() else find("campaign", str(path), ()) or path


def is_campaign_file(path: Path) -> bool:
    """Return True if a file can be read and holds a campaign and not a bench."""
    try:
        data = read_yaml(_found(path)).data
    except ConfigError:
        return False
    if not isinstance(data, Mapping) or "rig" in data:
        return False
    # No key of a bench is one of these; `settings` alone may be a slip in one.
    return bool({"axes", "sampled", "repeats", "samples", "bench"} & set(data)) or set(data) == {"settings"}
