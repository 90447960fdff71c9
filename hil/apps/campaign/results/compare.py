"""Comparison of two campaigns: cases with the same values of axes are pairs.

The exact test of McNemar (Psychometrika 12, 1947) looks at the pairs of which one flight passed and the other failed:
if nothing had changed, each would be as likely the one as the other, so their number has a binomial distribution with
p = 1/2. Pairs with an ERROR or a FLAKE are not in it. A PASS of a vehicle that never left its start is compared as an
ERROR: it says nothing.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hil.apps.campaign.results.groups import value_text
from hil.apps.campaign.results.statistics import STATUSES, Z_95, Tally
from hil.apps.campaign.results.tables import LINES_NAME
from hil.run_files import SUMMARY_NAME
from signals.errors import ConfigError, RecordingError

_MOST_SETTINGS = 20


class Flown(NamedTuple):
    """One case of a campaign, as far as it is compared."""

    id: str
    status: str
    axes: Mapping[str, Any]
    margins: Mapping[str, float]
    texts: tuple[str, ...]
    limits: Mapping[str, float | None]  # by the name of what they judge; empty for an ERROR without a run


class Change(NamedTuple):
    """A pair whose statuses differ."""

    first: Flown
    second: Flown

    @property
    def is_worse(self) -> bool:
        return self.first.status == "PASS"

    @property
    def is_better(self) -> bool:
        return self.second.status == "PASS"

    def data(self) -> dict[str, Any]:
        first, second = ({"case": side.id, "status": side.status} for side in self)
        return {"axes": dict(self.first.axes), "first": first, "second": second}


@dataclass
class Comparison:
    """Differences of two campaigns."""

    pairs: int = 0
    same_cases: int = 0  # pairs of the same identity: nothing that makes a flight differs
    tallies: tuple[Tally, Tally] = field(default_factory=lambda: (Tally(), Tally()))  # of the pairs
    alone: tuple[int, int] = (0, 0)  # cases without a partner
    incomplete: list[str] = field(default_factory=list)  # folders whose plan was not flown to its end
    not_judged: int = 0  # pairs with an ERROR or a FLAKE that say neither better nor worse
    partial: bool = False  # cases without an answer are accepted
    left_out: list[str] = field(default_factory=list)  # axes that have no value in common
    differences: dict[str, tuple[str, str]] = field(default_factory=dict)  # other settings, with their first values
    changes: list[Change] = field(default_factory=list)
    margins: dict[str, list[tuple[float, float]]] = field(default_factory=dict)  # of both flights, by limit

    @property
    def worse(self) -> list[Change]:
        """Pairs whose first flight passed and whose second did not."""
        return [change for change in self.changes if change.is_worse]

    @property
    def better(self) -> list[Change]:
        """Pairs whose second flight passed and whose first did not."""
        return [change for change in self.changes if change.is_better]

    @property
    def discordant(self) -> tuple[int, int]:
        """Numbers of pairs that went from PASS to FAIL, and from FAIL to PASS."""
        went = Counter((change.first.status, change.second.status) for change in self.changes)
        return went["PASS", "FAIL"], went["FAIL", "PASS"]

    @property
    def p_value(self) -> float:
        """Probability of so uneven a number of changes if the two do not differ, two-sided."""
        from scipy.stats import binomtest  # takes a third of a second

        worse, better = self.discordant
        return float(binomtest(worse, worse + better).pvalue) if worse + better else 1.0

    @property
    def unanswered(self) -> str:
        """Name the cases of which the comparison does not say whether they became worse; empty if there are none."""
        first, second = self.alone
        parts = [f"{first + second} without a partner"] if first + second else []
        parts += [f"those of its plan that {folder} has not flown" for folder in self.incomplete]
        parts += [f"{self.not_judged} with ERROR or FLAKE in place of a verdict"] if self.not_judged else []
        return ", ".join(parts)

    @property
    def exit_status(self) -> int:
        """0: no case became worse; 1: a case did, or may have: no partner, verdict or flight, unless `partial`."""
        if self.worse or not any(tally.judged for tally in self.tallies):
            return 1
        return 1 if self.unanswered and not self.partial else 0

    def margin_rows(self) -> Iterator[tuple[str, int, float, float, float, float]]:
        """Yield each limit with its pairs, the two mean margins, and the interval of the mean difference at 95 %."""
        for name in sorted(self.margins):
            first, second = np.array(self.margins[name]).T
            change, count = second - first, len(first)
            half = Z_95 * float(change.std(ddof=1)) / math.sqrt(count) if count > 1 else math.inf
            mean = float(change.mean())
            yield name, count, float(first.mean()), float(second.mean()), mean - half, mean + half

    def data(self) -> dict[str, Any]:
        """Return the comparison as plain data."""
        keys = ("pairs", "first", "second", "low", "high")
        sides = [{"pass": tally.passed, "fail": tally.failed} for tally in self.tallies]
        return {
            "schema": 1,
            "pairs": self.pairs,
            "same_cases": self.same_cases,
            "without_partner": list(self.alone),
            "incomplete": self.incomplete,
            "not_judged": self.not_judged,
            "axes_left_out": self.left_out,
            "differences": {key: list(values) for key, values in self.differences.items()},
            "first": sides[0],
            "second": sides[1],
            "worse": [change.data() for change in self.worse],
            "better": [change.data() for change in self.better],
            "pass_to_fail": self.discordant[0],
            "fail_to_pass": self.discordant[1],
            "p_value": self.p_value,
            "margins": {name: dict(zip(keys, row, strict=True)) for name, *row in self.margin_rows()},
            "exit_status": self.exit_status,
        }


def compare_campaigns(first: Path, second: Path, *, partial: bool = False) -> Comparison:
    """Compare the campaigns of two folders. Raises ConfigError if they cannot be compared, or RecordingError.

    `partial`: cases without a partner or a verdict do not make the exit status 1.
    """
    known = [_axes_of(folder) for folder in (first, second)]
    in_both = [axis for axis in known[0] if axis in known[1]]
    common = [axis for axis in in_both if known[0][axis] & known[1][axis]]
    result = Comparison(left_out=sorted({*known[0], *known[1]} - set(common)), partial=partial)
    ours = _by_values(first, common, result.left_out)
    theirs = _by_values(second, common, result.left_out)
    for key in sorted(ours.keys() & theirs.keys()):
        _add_pair(result, ours[key], theirs[key])
    if not result.pairs:
        hint = f"axes without a common value: {', '.join(result.left_out) or 'none'}"
        raise ConfigError.at(str(second), f"has no case with the same axes as one of {first}", hint)
    result.alone = len(ours) - result.pairs, len(theirs) - result.pairs
    folders, summaries = (first, second), (_summary(first), _summary(second))
    pairs = zip(folders, summaries, strict=True)
    # One that its own rule ended has flown what it wanted to.
    cut = (folder for folder, summary in pairs if summary.get("complete") is False and not summary.get("stopped"))
    result.incomplete = [str(folder) for folder in cut]
    for name in ("bench", "program"):
        values = [summary.get(name) for summary in summaries]
        if values[0] != values[1]:
            result.differences[name] = str(values[0]), str(values[1])
    return result


def _add_pair(result: Comparison, a: Flown, b: Flown) -> None:
    result.pairs += 1
    result.same_cases += a.id == b.id
    for tally, side in zip(result.tallies, (a, b), strict=True):
        tally.add(side.status)
    if a.status != b.status:
        result.changes.append(Change(a, b))
    judged = ("PASS", "FAIL")
    # A first PASS makes the pair worse, a second one better: both are answers.
    result.not_judged += (a.status not in judged or b.status not in judged) and "PASS" not in (a.status, b.status)
    for name in a.margins.keys() & b.margins.keys():
        result.margins.setdefault(name, []).append((a.margins[name], b.margins[name]))
    if a.texts != b.texts:
        ours, theirs = (dict(text.split("=", 1) for text in side.texts) for side in (a, b))
        _tell(result, ours, theirs, "not set")
    if a.limits and b.limits:  # wherever they were set: a second campaign with wider ones is no worse
        ours, theirs = (
            {f"limit of {key}": f"{value:g}" for key, value in side.limits.items() if value is not None}
            for side in (a, b)
        )
        _tell(result, ours, theirs, "not judged")


def _tell(result: Comparison, ours: Mapping[str, str], theirs: Mapping[str, str], without: str) -> None:
    """Note what differs in a pair."""
    for key in {**ours, **theirs}:
        if ours.get(key) != theirs.get(key) and len(result.differences) < _MOST_SETTINGS:
            result.differences.setdefault(key, (ours.get(key, without), theirs.get(key, without)))


def _axes_of(folder: Path) -> dict[str, set[str]]:
    """Return the values of every axis, as text."""
    axes: dict[str, set[str]] = {}
    for flown in _cases(folder):
        for axis, value in flown.axes.items():
            axes.setdefault(axis, set()).add(_key(value))
    return axes


def _by_values(folder: Path, axes: Sequence[str], left_out: Sequence[str]) -> dict[tuple[str, ...], Flown]:
    """Return the cases by their values of `axes`. Raises ConfigError if two have the same."""
    found: dict[tuple[str, ...], Flown] = {}
    for flown in _cases(folder):
        key = tuple(_key(flown.axes.get(axis)) for axis in axes)
        if key in found:
            text = "has several cases, and no axis with a value in common with the other folder: nothing makes pairs"
            if axes:
                text = f"has several cases with the same {', '.join(axes)}: {found[key].id} and {flown.id}"
            raise ConfigError.at(str(folder), text, f"without a common value: {', '.join(left_out)}")
        found[key] = flown
    return found


def _key(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


def _cases(folder: Path) -> Iterator[Flown]:
    """Yield the cases of a campaign from its results.jsonl. Raises ConfigError or RecordingError."""
    path = folder / LINES_NAME
    if not path.is_file():
        raise ConfigError.at(str(path), "does not exist", "give the folders of two campaigns that were flown")
    number = 0
    try:
        with path.open(encoding="utf-8") as file:
            for line in file:
                number += 1
                data = json.loads(line)
                if data["status"] not in STATUSES:
                    raise ValueError(f"the status {data['status']!r} is none of {', '.join(STATUSES)}")
                status = data["status"] if data.get("flown", True) else "ERROR"
                rows = data["limits"]
                margins = {row["name"]: row["margin"] for row in rows if row["margin"] is not None}
                limits = {row["name"]: row.get("limit") for row in rows}
                yield Flown(data["case"], status, data["axes"], margins, tuple(data["set"]), limits)
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise RecordingError(f"{path}:{number}: damaged: {error}. hil campaign FILE --resume writes it anew") from error
    if not number:
        raise ConfigError.at(str(path), "holds no case", "hil campaign FILE --resume writes it anew")


def _summary(folder: Path) -> dict[str, Any]:
    try:
        data = json.loads((folder / SUMMARY_NAME).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}


def axes_text(flown: Flown) -> str:
    """Return the values of a case's axes in one line."""
    return ", ".join(f"{axis}={value_text(value)}" for axis, value in flown.axes.items())
