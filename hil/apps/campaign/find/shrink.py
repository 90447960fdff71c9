"""Makes a failing case smaller while it fails in the same way.

1. Parts are taken out by ddmin: faults, gusts, turbulence, and values that differ from the base's.
2. Numbers are brought towards their neutral values by bisection, one after the other.
3. Waypoints are taken out of the mission by ddmin.
4. Settings without an effect are left out.

Two flights fail in the same way if the first reasons of their verdicts are equal apart from their numbers.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from hil.apps.campaign.campaign import WORK
from hil.apps.campaign.cases.settings import texts_of
from hil.apps.campaign.find.ddmin import ddmin
from hil.apps.campaign.find.magnitudes import TOLERANCE, Magnitude, least_share, magnitudes_of, with_value
from hil.apps.campaign.find.missions import mission_to_cut, write_cut
from hil.apps.campaign.find.parts import Data, Part, data_of, parts_of, with_inherited, without
from hil.apps.campaign.find.trials import Texts, Trials
from hil.apps.campaign.flight import Outcome
from signals.errors import ConfigError
from signals.mission import MissionItem
from signals.words import counted

BATCH = 8  # trials that are made together, whatever the number of workers
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|\bnan\b|\binf\b)")


@dataclass
class Shrunk:
    """The smallest case found, and how it was found."""

    texts: Texts
    outcome: Outcome
    case: str = ""
    removed: list[str] = field(default_factory=list)
    reduced: list[str] = field(default_factory=list)
    remains: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    mission: Path | None = None  # cut


def way_of_failing(outcome: Outcome) -> str:
    """Return the first reason of a FAIL without its numbers, and of a crash without its place; empty if none failed."""
    if outcome.status != "FAIL":
        return ""
    reason = outcome.reasons[0] if outcome.reasons else "no reason"
    return _NUMBER.sub("#", reason.split(",", 1)[0] if reason.startswith("crashed:") else reason)


class Shrinking:
    """One case being made smaller. `base` are the settings of all points of its campaign."""

    def __init__(self, trials: Trials, texts: Texts, outcome: Outcome, base: Texts, out: Path) -> None:
        self._trials, self._out = trials, out
        self._base = data_of(base)
        self._texts, self._outcome = texts, outcome
        self._way = way_of_failing(outcome)
        self._found = Shrunk(texts, outcome)
        self.say: Callable[[str], None] = lambda _: None

    def run(self, name: str, tolerance: float = TOLERANCE) -> Shrunk:
        """Return the smallest case found. `name`: of the file of a cut mission. Raises HilError."""
        self._repeat()
        data = with_inherited(data_of(self._texts), self._trials.bench(self._texts))
        data = self._take_out_parts(data)
        data = self._lessen(data, tolerance)
        data = self._cut_mission(data, name)
        return self._finish(data)

    def _repeat(self) -> None:
        """Raise ConfigError unless the failure repeats."""
        again = self._trials.repeat(self._texts)
        if way_of_failing(again) != self._way:
            now = again.reasons[0] if again.reasons else again.error or again.status
            text = f"does not repeat: it was stored as {self._outcome.reasons[0]!r}, and is now {again.status} ({now})"
            hint = "was the bench, a file or the program changed? `hil campaign FILE --resume` flies changed cases"
            raise ConfigError.at("CASE", text, hint)
        if not self._outcome.repeatable:
            self._found.notes.append("flights of this bench do not repeat exactly, and each trial was one flight")

    def _first_failing(self, candidates: Sequence[Data]) -> int | None:
        """Return the index of the first candidate that fails in the same way. Whole batches of BATCH are flown."""
        for begin in range(0, len(candidates), BATCH):
            texts = [tuple(texts_of(data)) for data in candidates[begin : begin + BATCH]]
            for index, trial in enumerate(self._trials.make(texts), start=begin):
                if way_of_failing(trial.outcome) == self._way:
                    return index
        return None

    def _take_out_parts(self, data: Data) -> Data:
        whole = self._trials.identity(tuple(texts_of(data)))
        parts = parts_of(data, self._base)
        effective = [p for p in parts if self._trials.identity(tuple(texts_of(without(data, [p])))) != whole]
        data = without(data, [p for p in parts if p not in effective])
        self.say(f"{counted(len(effective), 'part')}: {'; '.join(p.text for p in effective) or 'none'}")

        def but(kept: Sequence[Part]) -> Data:
            return without(data, [p for p in effective if p not in kept])

        kept = ddmin(effective, lambda subsets: self._first_failing([but(subset) for subset in subsets]))
        self._found.removed = [p.text_without for p in effective if p not in kept]
        self.say(f"left: {len(kept)} of {counted(len(effective), 'part')}; {counted(len(self._trials.asked), 'trial')}")
        return but(kept)

    def _lessen(self, data: Data, tolerance: float) -> Data:
        base_bench = self._trials.bench(tuple(texts_of(self._base)))
        bench = self._trials.bench(tuple(texts_of(data)))
        for magnitude in magnitudes_of(data, self._base, bench, base_bench):
            share = least_share(partial(self._first_share, data, magnitude), tolerance)
            if share < 1.0:
                data = with_value(data, magnitude, share)
                self._found.reduced.append(magnitude.text(magnitude.at(share)))
                self.say(f"{self._found.reduced[-1]}; {counted(len(self._trials.asked), 'trial')}")
        return data

    def _first_share(self, data: Data, magnitude: Magnitude, shares: Sequence[float]) -> int | None:
        return self._first_failing([with_value(data, magnitude, share) for share in shares])

    def _cut_mission(self, data: Data, name: str) -> Data:
        bench = self._trials.bench(tuple(texts_of(data)))
        mission, why_not = mission_to_cut(bench)
        if mission is None:
            self._found.notes.append(f"the mission is as it was: {why_not}")
            return data
        drafts = self._out / WORK / "missions"

        def first_failing(subsets: Sequence[list[MissionItem]]) -> int | None:
            cut = [write_cut(mission, subset, bench, drafts) for subset in subsets]
            return self._first_failing([{**data, "mission": str(path)} for path in cut])

        kept = ddmin(mission.waypoints, first_failing)
        if len(kept) == len(mission.waypoints):
            return data
        removed = [item.seq for item in mission.waypoints if item not in kept]
        items = ", ".join(map(str, removed))
        text = f"{len(removed)} of {counted(len(mission.waypoints), 'waypoint')} (items {items} of the file)"
        self._found.removed.append(text)
        self.say(f"taken out: {text}; {counted(len(self._trials.asked), 'trial')}")
        self._found.mission = write_cut(mission, kept, bench, self._out, name)
        return {**data, "mission": str(self._found.mission)}

    def _finish(self, data: Data) -> Shrunk:
        """Leave out settings without an effect, and fly the result if it is not stored."""
        texts = tuple(texts_of(data))
        same = self._trials.identity(texts)
        for text in texts:
            fewer = tuple(t for t in texts if t != text)
            if self._trials.identity(fewer) == same:
                texts = fewer
        (trial,) = self._trials.make([texts])
        found = self._found
        found.texts, found.outcome, found.case = texts, trial.outcome, trial.case
        parts = parts_of(data_of(texts), self._base)
        found.remains = [part.text for part in parts if found.mission is None or part.place != ("mission",)]
        return found
