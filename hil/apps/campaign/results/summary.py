"""Statistics of a campaign, collected case by case in memory that does not grow with their number."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, NamedTuple

from hil.apps.campaign.flight import Limit
from hil.apps.campaign.results.groups import Groups
from hil.apps.campaign.results.statistics import Tally
from hil.apps.campaign.store import Case

SAMPLE = 10_000  # margins of one limit that are kept for quantiles, the first by case: cases are hashes
MOST_LISTED = 200  # failures
MOST_BROKEN = 100  # cases with ERROR or FLAKE
LEAST_LISTED = 20  # cases nearest to a limit, if fewer failed
_PAIR_AXES = 12  # axes of which every pair is counted
_MOST_POINTS = 2_000  # cases of the picture of margins over axes
FEW = 5  # judged cases below which a rate is not compared with others


@dataclass
class Margins:
    """Margins to one limit."""

    count: int = 0
    missed: int = 0
    total: float = 0.0
    least: float = math.inf
    sample: array[float] = field(default_factory=lambda: array("d"))

    def add(self, limit: Limit, margin: float) -> None:
        """Add the margin of one flight."""
        self.count += 1
        self.missed += limit.ok is False
        self.total += margin
        self.least = min(self.least, margin)
        if len(self.sample) < SAMPLE:
            self.sample.append(margin)

    def data(self) -> dict[str, Any]:
        """Return count, mean, least and quantiles as plain data."""
        ordered = sorted(self.sample)
        quantile = {f"p{p:02}": ordered[round((len(ordered) - 1) * p / 100)] for p in (5, 50, 95)}
        mean = self.total / self.count
        return {"cases": self.count, "missed": self.missed, "mean": mean, "min": self.least, **quantile}


class Point(NamedTuple):
    """One judged case as a point of the plots of margins over axes."""

    status: str
    margin: float
    axes: Mapping[str, Any]


Rates = dict[str, Tally]  # of the groups of an axis
PairRates = dict[tuple[str, str], Tally]  # of the groups of two axes


class Summary:
    """Counts of the outcomes, by axis and by pair of axes, margins to each limit, and the worst cases."""

    def __init__(self, groups: Sequence[Groups]) -> None:
        self.tally = Tally()
        self.sim_s = self.wall_s = 0.0  # of all flights
        self.limits: set[str] = set()  # names of all measurements
        self.groups = {of.axis: of for of in groups}
        self.rates: dict[str, Rates] = {of.axis: {name: Tally() for name in of.names} for of in groups}
        paired = [of.axis for of in groups if of.axis != "seed"][:_PAIR_AXES]
        self.pairs: dict[tuple[str, str], PairRates] = {pair: {} for pair in combinations(paired, 2)}
        self.margins: dict[str, Margins] = {}
        self.points: list[Point] = []  # of the first cases; cases are hashes, so these are a random sample
        self.unmet = 0  # cases whose flight did not meet what they declare: a fault, a gust, or any flight
        self.unmet_example = ""
        self._judged = _Worst(MOST_LISTED, _badness)
        self._broken = _Worst(MOST_BROKEN, lambda case: (case.status, case.id))

    @classmethod
    def of(cls, groups: Sequence[Groups], cases: Iterable[Case]) -> Summary:
        """Return the statistics of `cases`, which are sorted by case."""
        summary = cls(groups)
        for case in cases:
            summary.add(case)
        return summary

    def add(self, case: Case) -> None:
        """Add one case."""
        status = case.status
        self.tally.add(status)
        self.sim_s += case.outcome.sim_s
        self.wall_s += case.outcome.wall_s
        if case.outcome.unmet:
            self.unmet += 1
            self.unmet_example = self.unmet_example or f"{case.id}: {case.outcome.unmet[0]}"
        self.limits.update(limit.name for limit in case.outcome.limits)
        group = {axis: of.of(case.axes[axis]) for axis, of in self.groups.items() if axis in case.axes}
        for axis, name in group.items():
            self.rates[axis].setdefault(name, Tally()).add(status)
        for (a, b), rates in self.pairs.items():
            if a in group and b in group:
                rates.setdefault((group[a], group[b]), Tally()).add(status)
        if status not in ("PASS", "FAIL"):
            self._broken.add(case)
            return
        self._judged.add(case)
        worst = case.outcome.worst
        if len(self.points) < _MOST_POINTS and worst is not None and worst.margin is not None:
            self.points.append(Point(status, worst.margin, case.axes))
        for limit in case.outcome.limits:
            margin = limit.margin
            if margin is not None:
                self.margins.setdefault(limit.name, Margins()).add(limit, margin)

    @property
    def broken(self) -> list[Case]:
        """Cases with ERROR or FLAKE, at most MOST_BROKEN."""
        return list(self._broken)

    @property
    def worst(self) -> list[Case]:
        """Failures from the worst, at most MOST_LISTED; if they are few, also the passes nearest to a limit."""
        cases = list(self._judged)
        return cases[: max(LEAST_LISTED, sum(case.status == "FAIL" for case in cases))]

    def data(self) -> dict[str, Any]:
        """Return rates by axis and margins as plain data for campaign.json."""
        axes = {axis: {name: _counts(tally) for name, tally in rates.items()} for axis, rates in self.rates.items()}
        margins = {name: self.margins[name].data() for name in sorted(self.margins)}
        return {"axes": axes, "margins": margins, "unmet": self.unmet}


def separation(tallies: Iterable[Tally]) -> float:
    """Return the distance between the intervals of the best and the worst rate, negative if they overlap."""
    intervals = [tally.interval() for tally in tallies if tally.judged >= FEW]
    return max((low for low, _, _ in intervals), default=0.0) - min((high for _, _, high in intervals), default=1.0)


def _counts(tally: Tally) -> dict[str, Any]:
    return {"cases": tally.cases, "pass": tally.passed, "fail": tally.failed, "pass_rate": list(tally.interval())}


def _badness(case: Case) -> tuple[Any, ...]:
    worst = case.outcome.worst
    margin = math.inf if worst is None or worst.margin is None else worst.margin
    return case.status != "FAIL", margin, case.id


class _Worst:
    """The first `most` of the cases that are added, in the order of `key`."""

    def __init__(self, most: int, key: Callable[[Case], Any]) -> None:
        self._most, self._key = most, key
        self._cases: list[Case] = []

    def add(self, case: Case) -> None:
        self._cases.append(case)
        if len(self._cases) > 2 * self._most:
            self._cases = list(self)

    def __iter__(self) -> Iterator[Case]:
        return iter(sorted(self._cases, key=self._key)[: self._most])
