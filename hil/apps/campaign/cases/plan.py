"""The points of a campaign in their order, made one by one.

Sampled points come first, then the combinations of the crossed axes, then the repeats: a campaign that is stopped early
has flown every combination. Point i is a function of the file and of i alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from hil.apps.campaign.cases.campaign_file import CampaignFile, CampaignSpec, Condition, Range
from hil.apps.campaign.cases.sampling import MAX_HYPERCUBE, MAX_SOBOL_AXES, UnitSamples
from hil.apps.campaign.cases.settings import is_bundle, label, texts_of, with_values
from signals.errors import ConfigError, Problem

MAX_POINTS = 2**53
COLUMNS = ("case", "status", "margin", "worst_limit", "reason", "digest")  # of tables, besides axes and measurements


@dataclass(frozen=True)
class Point:
    """One flight to make: the values of its axes as tables show them, and the settings as texts of `--set`."""

    number: int
    values: Mapping[str, Any]
    texts: tuple[str, ...]


class Plan:
    """All points of a campaign; `len` counts them before the filter `skip`."""

    def __init__(self, file: CampaignFile) -> None:
        """Raises ConfigError if the axes and their sampling do not fit together."""
        self._file, self._spec = file, file.spec
        spec = file.spec
        self.axes: tuple[str, ...] = (*spec.axes, *spec.sampled, *(("seed",) if spec.repeats > 1 else ()))
        self._sizes = [axis.count if isinstance(axis, Range) else len(axis) for axis in spec.axes.values()]
        count = spec.samples * math.prod(self._sizes) * spec.repeats
        if count > MAX_POINTS:
            raise ConfigError.at(file.document.source, f"has {count:.3g} points; the most is {MAX_POINTS:.3g}")
        if problem := _sampling_problem(file) or _skip_problem(file) or _name_problem(file):
            raise ConfigError([problem])
        self._first_seed: int | None = None
        self.base = texts_of(spec.settings, file.path.parent)  # of all points
        self._units = UnitSamples(spec.method, list(spec.sampled), spec.samples, spec.sampling_seed)

    def __len__(self) -> int:
        spec = self._spec
        return spec.samples * math.prod(self._sizes) * spec.repeats

    def __iter__(self) -> Iterator[Point]:
        """Return all points that `skip` leaves, in order. Raises ConfigError."""
        points = map(self.point, range(len(self)))
        return (point for point in points if not self.is_skipped(point.values))

    def point(self, number: int) -> Point:
        """Return point `number`, be it skipped or not. Raises ConfigError."""
        spec = self._spec
        rest, repeat = divmod(number, spec.repeats)
        sample, combination = divmod(rest, math.prod(self._sizes))
        values: dict[str, Any] = {}
        for (name, axis), size in zip(reversed(spec.axes.items()), reversed(self._sizes), strict=True):
            combination, index = divmod(combination, size)
            values[name] = axis.first + axis.step * index if isinstance(axis, Range) else axis[index]
        values = dict(reversed(values.items()))
        if spec.sampled:
            for (name, distribution), u in zip(spec.sampled.items(), self._units[sample], strict=True):
                values[name] = distribution.value(float(u))
        if spec.repeats > 1:
            values["seed"] = self._seed() + repeat
        return self.at(values, number)

    def at(self, values: Mapping[str, Any], number: int = 0) -> Point:
        """Return the point with these values of axes. Raises ConfigError."""
        texts = texts_of(with_values(self._spec.settings, values), self._file.path.parent)
        return Point(number, {name: label(value) for name, value in values.items()}, tuple(texts))

    def _seed(self) -> int:
        """Return the seed of the first repeat: that of the settings or the bench."""
        if self._first_seed is None:
            from hil.config import load_bench

            self._first_seed = load_bench(self._file.bench_path, settings=self.base).config.seed
        return self._first_seed

    def is_skipped(self, values: Mapping[str, Any]) -> bool:
        """Return True for a point that `skip` leaves out."""
        return any(all(_meets(values[axis], wanted) for axis, wanted in entry.items()) for entry in self._spec.skip)

    def trials(self) -> Iterator[tuple[str, Point]]:
        """Yield points to check before any flight, with the axis that each tries: every value, or the extremes."""
        first = self.first_values()
        yield "", self.at(first)
        for name, axis in self._spec.axes.items():
            values = [axis.first, axis.first + axis.step * (axis.count - 1)] if isinstance(axis, Range) else axis[1:]
            for value in values:
                yield name, self.at({**first, name: value})
        for name, distribution in self._spec.sampled.items():
            for value in distribution.extremes():
                yield name, self.at({**first, name: value})

    def first_values(self) -> dict[str, Any]:
        """Return a value of every axis: the first of a crossed one, the middle of a sampled one."""
        values = {name: axis.first if isinstance(axis, Range) else axis[0] for name, axis in self._spec.axes.items()}
        return values | {name: distribution.value(0.5) for name, distribution in self._spec.sampled.items()}


def _meets(value: Any, wanted: Any) -> bool:
    if not isinstance(wanted, Mapping):
        return bool(value == wanted)
    condition = Condition(**wanted)
    return isinstance(value, int | float) and condition.above <= value <= condition.below


def _sampling_problem(file: CampaignFile) -> Problem | None:
    spec: CampaignSpec = file.spec
    if spec.method == "sobol" and len(spec.sampled) > MAX_SOBOL_AXES:
        return file.problem(("method",), f"sobol samples at most {MAX_SOBOL_AXES} axes, not {len(spec.sampled)}")
    if spec.method == "latin_hypercube" and spec.samples > MAX_HYPERCUBE:
        hint = "random and sobol have no such limit"
        return file.problem(("samples",), f"latin_hypercube draws at most {MAX_HYPERCUBE} samples at once", hint)
    return None


def _skip_problem(file: CampaignFile) -> Problem | None:
    known = {*file.spec.axes, *file.spec.sampled}
    for index, entry in enumerate(file.spec.skip):
        if not entry:
            return file.problem(("skip", index), "is empty, which would skip every point")
        for axis, wanted in entry.items():
            if axis not in known:
                return file.problem(("skip", index, axis), "is not an axis of this campaign", ", ".join(sorted(known)))
            if isinstance(wanted, Mapping):
                try:
                    Condition(**(wanted or {"": 0}))
                except (ValidationError, TypeError):
                    text = "must be a value, or a mapping with numbers above and below"
                    return file.problem(("skip", index, axis), text)
    return None


def _name_problem(file: CampaignFile) -> Problem | None:
    for axis, values in file.spec.axes.items():
        if axis in COLUMNS:
            return file.problem(("axes", axis), "is the name of a column of results.csv; give the axis another name")
        names = [] if isinstance(values, Range) else [value["label"] for value in values if is_bundle(value)]
        for index, name in enumerate(names):
            if name in names[:index]:
                return file.problem(("axes", axis), f"has two values with the label {name!r}")
    return None
