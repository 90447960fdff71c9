"""A campaign from its plan to its tables: flights in an engine, then the second flights, then the recordings.

1. Every point of the plan is flown unless its case is stored. One that ended as ERROR is flown again when the campaign
   is resumed.
2. A share of the cases is flown a second time in other processes, on another node if there is one. Another digest, or
   another verdict, is a FLAKE.
3. Failures are flown again with recordings and a report. Flights that do not repeat were recorded from the start.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from hil.apps.campaign.cases.campaign_file import CampaignFile, Stop
from hil.apps.campaign.cases.plan import Plan, Point
from hil.apps.campaign.engines.engine import Engine, flown
from hil.apps.campaign.flight import Job, Outcome, Recording
from hil.apps.campaign.identity import case_id
from hil.apps.campaign.results.statistics import Tally
from hil.apps.campaign.stop_rule import stop_reason
from hil.apps.campaign.store import Store
from hil.config import Bench, load_bench
from hil.run.replay import compare
from hil.run_files import MCAP_NAME, RUN_JSON_NAME
from signals.errors import ConfigError, RecordingError

RECORDED_FIRST = 1000  # first flights whose recordings (some MB each) wait for the second; later ones have only digests
CASES, SECOND, WORK = "cases", "second_flights", "work"  # folders of a campaign
_WITHOUT_FLIGHT = ("ConfigError", "Timeout", "WorkerLost")


class Progress(NamedTuple):
    """State of a campaign while it goes on."""

    phase: str
    done: int
    total: int
    tally: Tally


@dataclass
class Campaign:
    """One campaign in a folder. `show` is called after every flight, and while flights go on."""

    file: CampaignFile
    plan: Plan
    store: Store
    engine: Engine
    out: Path
    stop: Stop
    show: Callable[[Progress], None] = lambda _: None
    tally: Tally = field(default_factory=Tally)
    stopped: str = ""  # why the campaign ended before its plan did
    unfinished: bool = True  # while the plan is not flown, or cut by a rule
    flown: int = 0  # by this call, second flights and recordings included
    not_compared: int = 0  # second flights that could not be made
    began_s: float = field(default_factory=time.monotonic)
    _order: deque[tuple[int, str]] = field(default_factory=deque)  # number and case of points not yet counted
    _pending: set[str] = field(default_factory=set)  # cases of these that have to be flown
    _recorded_first: int = 0  # first flights recorded for a comparison

    def run(self) -> None:
        """Fly what the plan asks for and is not stored. Raises HilError; what was flown stays stored."""
        spec = self.file.spec
        self._fly_plan()
        self._fly_all("second flights", self._second_flights(spec.recheck), self._compare)
        if spec.keep != "none":
            self._fly_all(
                "recordings", self._recordings(every=spec.keep == "all", most=spec.keep_at_most), self._recorded
            )
        for name in (SECOND, WORK):
            shutil.rmtree(self.out / name, ignore_errors=True)

    # -- the plan

    def _fly_plan(self) -> None:
        """Fly the points of the plan that are not stored, until there are none or a rule stops the campaign."""
        self.store.begin_plan(self.file.bench_path, self.plan.base)
        for ended in flown(self.engine, self._jobs()):
            for job, outcome in ended:
                self.flown += 1
                self.store.put(job.case, outcome, job.texts)
                self._pending.discard(job.case)
            self._advance()
            if self.stopped:
                break
            if self.stop.time_s is not None and time.monotonic() - self.began_s > self.stop.time_s:
                self.stopped = f"the time of {self.stop.time_s:g} s is over"
                if self._order:
                    self.store.cut(self._order[0][0] - 1)
                break
        self.unfinished = False

    def _jobs(self) -> Iterator[Job]:
        """Yield the flights that are not stored, and note every case of the plan in `_order`."""
        for point in self.plan:
            case, bench, problem = self._resolved(point)
            if not self.store.add_point(point.number, case, point.values):
                continue  # the case of an earlier point
            self._order.append((point.number, case))
            stored = self.store.status(case)
            if bench is None:
                assert problem is not None
                self.store.put(case, problem, point.texts)
            elif stored is None or stored == "ERROR":
                self._pending.add(case)
                yield self._job(case, point.texts, self._recording(case, bench))
            self._advance()
            if self.stopped:
                return

    def _resolved(self, point: Point) -> tuple[str, Bench | None, Outcome | None]:
        """Return the identity of a point's case and its bench, or the outcome of a bench that cannot be loaded."""
        try:
            bench = load_bench(self.file.bench_path, settings=point.texts)
            return case_id(bench), bench, None
        except ConfigError as error:
            return unresolved_id(point.texts), None, Outcome("ERROR", error_type="ConfigError", error=str(error))

    def _recording(self, case: str, bench: Bench) -> Recording:
        if not repeats(bench):
            return "none" if self.file.spec.keep == "none" else "all"
        if not is_chosen(case, self.file.spec.recheck) or self._recorded_first >= RECORDED_FIRST:
            return "none"
        self._recorded_first += 1
        return "messages"

    def _job(self, case: str, texts: tuple[str, ...], recording: Recording, *, again: bool = False) -> Job:
        """Return the first flight of a case, or a further one."""
        keep = recording == "messages" or again or (recording == "all" and self.file.spec.keep == "all")
        folder = {"none": f"{WORK}/{case}-{os.getpid()}", "messages": _second(case, again), "all": f"{CASES}/{case}"}
        bench = self.file.bench_path
        return Job(
            case, None if bench is None else str(bench), texts, str(self.out / folder[recording]), recording, keep
        )

    def _advance(self) -> None:
        """Count the results at the head of the plan, and apply the rules that stop a campaign."""
        while self._order and not self.stopped and self._order[0][1] not in self._pending:
            number, case = self._order.popleft()
            status = self.store.status(case)
            assert status is not None
            self.tally.add(status)
            self.stopped = stop_reason(self.stop, self.tally)
            if self.stopped:
                self.store.cut(number)
        self.show(Progress("flights", self.tally.cases, len(self.plan), self.tally))

    # -- further flights of the same cases

    def _second_flights(self, share: float) -> list[Job]:
        """Return the second flights that are not yet made."""
        return [
            replace(self._job(case.id, case.texts, "messages", again=True), flown_at=case.outcome.place)
            for case in self.store.cases(by_plan=True)
            if case.outcome.repeatable
            and case.outcome.status != "ERROR"
            and case.second_digest is None
            and is_chosen(case.id, share)
        ]

    def _compare(self, job: Job, outcome: Outcome) -> None:
        if outcome.error_type in _WITHOUT_FLIGHT:
            self.not_compared += 1  # it says nothing; --resume makes the flight again
            return
        first = self.store.outcome(job.case)
        assert first is not None
        difference = ""
        if outcome.status == "ERROR":
            difference = f"the second flight ended as {outcome.error_type}"
        elif outcome.digest != first.digest:
            one, two = self.out / _second(job.case, again=False), self.out / _second(job.case, again=True)
            difference = _first_difference(one, two) or f"the second flight has the digest {outcome.digest[:16]}"
        elif outcome.status != first.status:  # such as by a client that fails after the flight
            why = next(iter(first.reasons or outcome.reasons), "no reason given")
            difference = f"the same flight was {first.status} and then {outcome.status}: {why}"
        self.store.put_check(job.case, outcome.digest, difference)
        shutil.rmtree(self.out / SECOND / job.case, ignore_errors=True)

    def _recordings(self, *, every: bool, most: int) -> list[Job]:
        """Return the flights that leave recordings, of cases that have none yet."""
        wanted = (c for c in self.store.cases(by_plan=True) if every or c.status != "PASS")
        cases = [case for case, _ in zip(wanted, range(most), strict=False)]
        return [
            self._job(case.id, case.texts, "all", again=True)
            for case in cases
            if not (self.out / CASES / case.id / RUN_JSON_NAME).is_file()
            and case.outcome.error_type not in _WITHOUT_FLIGHT
        ]

    def _recorded(self, job: Job, outcome: Outcome) -> None:
        first = self.store.outcome(job.case)
        assert first is not None
        if outcome.status != first.status and "ERROR" not in (outcome.status, first.status):
            text = f"{first.status} without recordings, {outcome.status} with them"
            self.store.put_check(job.case, outcome.digest, text)

    def _fly_all(self, phase: str, jobs: list[Job], handle: Callable[[Job, Outcome], None]) -> None:
        """Fly `jobs` in other processes or on other nodes than before."""
        if not jobs:
            return
        self.engine.renew()
        made = 0
        for ended in flown(self.engine, jobs):
            for job, outcome in ended:
                handle(job, outcome)
            made += len(ended)
            self.flown += len(ended)
            self.show(Progress(phase, made, len(jobs), self.tally))


def repeats(bench: Bench) -> bool:
    """Return True if a second flight of `bench` has the same digest; run.json tells for certain."""
    benches = bench.vehicles.values() or (bench,)
    return all(b.config.autopilot.profile.repeatable and not b.config.companion.times_count for b in benches)


def is_chosen(case: str, share: float) -> bool:
    """Return True for a share of all cases, the same in every campaign."""
    return int(case[-8:], 16) < share * 2**32


def unresolved_id(texts: tuple[str, ...]) -> str:
    """Return the identity of a case whose bench cannot be loaded."""
    return hashlib.blake2b("\n".join(texts).encode(), digest_size=10).hexdigest()


def _second(case: str, again: bool) -> str:
    return f"{SECOND}/{case}/{'second' if again else 'first'}"


def _first_difference(first: Path, second: Path) -> str:
    """Return the first difference of two recorded flights, empty if it cannot be found."""
    try:
        found = compare(first / MCAP_NAME, second / MCAP_NAME)
    except RecordingError:
        return ""
    return "" if found is None else str(found)
