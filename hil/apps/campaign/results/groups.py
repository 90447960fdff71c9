"""Values of an axis in groups, so that each has a pass rate: every value its own, or intervals of numbers.

Intervals have equal probability under the axis' distribution. They follow from the campaign's file alone, so two
campaigns of one file have the same, however many cases were flown.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from hil.apps.campaign.cases.campaign_file import CampaignSpec, Range
from hil.apps.campaign.cases.distributions import Distribution
from hil.apps.campaign.cases.settings import label

INTERVALS = 5
MOST_VALUES = 12  # of numbers that are groups of their own
MOST_GROUPS = 40  # the values beyond these share the last group
OTHERS = "other values"


@dataclass(frozen=True)
class Groups:
    """Groups of one axis: the intervals between `edges`, or without edges each value."""

    axis: str
    edges: tuple[float, ...] = ()
    values: tuple[str, ...] = ()  # in the order of the file

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all groups in their order."""
        if not self.edges:
            return self.values if len(self.values) < MOST_GROUPS else (*self.values[: MOST_GROUPS - 1], OTHERS)
        ends = [f"{edge:,.0f}" if edge == round(edge) else f"{edge:.4g}" for edge in self.edges]
        between = [f"{low} to {high}" for low, high in pairwise(ends)]
        return f"below {ends[0]}", *between, f"from {ends[-1]}"

    def of(self, value: Any) -> str:
        """Return the name of the group of a value."""
        names = self.names
        if self.edges:
            return names[bisect_right(self.edges, value)]
        name = value_text(value)
        return name if name in names else OTHERS


def value_text(value: Any) -> str:
    """Return a value of an axis as people read it."""
    if isinstance(value, Mapping) and value:
        return ", ".join(f"{key} {value_text(of)}" for key, of in value.items())
    if isinstance(value, list) and any(isinstance(of, Mapping) for of in value):
        return "; ".join(map(value_text, value))
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def groups_of(spec: CampaignSpec) -> list[Groups]:
    """Return the groups of every axis. Seeds of `repeats` have none: their number says nothing."""
    crossed = [_of_values(name, axis) for name, axis in spec.axes.items()]
    return crossed + [_of_distribution(name, distribution) for name, distribution in spec.sampled.items()]


def _of_values(name: str, axis: Sequence[Any] | Range) -> Groups:
    if isinstance(axis, Range):
        if axis.count > MOST_VALUES:
            step = axis.step * axis.count / INTERVALS
            return Groups(name, tuple(axis.first + round(step * k) for k in range(1, INTERVALS)))
        return Groups(name, (), tuple(str(axis.first + axis.step * k) for k in range(axis.count)))
    if len(axis) > MOST_VALUES and all(isinstance(value, int | float) for value in axis):
        ordered = sorted(axis)
        edges = {ordered[len(ordered) * k // INTERVALS] for k in range(1, INTERVALS)}
        return Groups(name, tuple(sorted(edges)))
    return Groups(name, (), _different(axis))


def _of_distribution(name: str, distribution: Distribution) -> Groups:
    if distribution.choice is not None:
        return Groups(name, (), _different(distribution.choice))
    if distribution.integers is not None:
        least, greatest = distribution.integers
        if greatest - least < MOST_VALUES:
            return Groups(name, (), tuple(map(str, range(least, greatest + 1))))
    edges = sorted({distribution.value(k / INTERVALS) for k in range(1, INTERVALS)})
    return Groups(name, tuple(map(float, edges)))


def _different(values: Sequence[Any]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(value_text(label(value)) for value in values))


def shortened(text: str, length: int = 60) -> str:
    """Return a text of at most `length` characters."""
    return text if len(text) <= length else f"{text[: length - 2]} …"
