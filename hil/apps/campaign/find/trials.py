"""Flights of `hil campaign shrink` and `search`: made in an engine, stored as cases, and never made twice."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from hil.apps.campaign.campaign import WORK, unresolved_id
from hil.apps.campaign.engines.engine import Engine, flown
from hil.apps.campaign.flight import Job, Outcome
from hil.apps.campaign.identity import case_id
from hil.apps.campaign.store import Store
from hil.config import Bench, load_bench
from signals.errors import ConfigError

Texts = tuple[str, ...]  # settings as texts of `--set`


class Trial(NamedTuple):
    """One flight that was asked for."""

    case: str
    outcome: Outcome


class Trials:
    """Makes the flights of one folder. `asked` are their cases in order, the same for any number of workers."""

    def __init__(self, store: Store, engine: Engine, bench: Path | None, out: Path) -> None:
        self._store, self._engine, self._bench, self._out = store, engine, bench, out
        self._cases: dict[Texts, str | None] = {}
        self.asked: list[str] = []
        self.flown = 0
        self.show: Callable[[], None] = lambda: None  # called after every flight, and while flights go on

    def bench(self, texts: Texts) -> Bench:
        """Return the bench with these settings. Raises ConfigError."""
        return load_bench(self._bench, settings=texts)

    def identity(self, texts: Texts) -> str | None:
        """Return the case of these settings; None: the bench cannot be loaded with them."""
        if texts not in self._cases:
            try:
                self._cases[texts] = case_id(self.bench(texts))
            except ConfigError:
                self._cases[texts] = None
        return self._cases[texts]

    def make(self, wanted: Sequence[Texts]) -> list[Trial]:
        """Return the outcomes of these flights in order; those that are not stored are flown. Raises HilError.

        A stored ERROR is flown again. Settings that no bench can have are an ERROR.
        """
        cases = [self.identity(texts) for texts in wanted]
        jobs: dict[str, Job] = {}
        for case, texts in zip(cases, wanted, strict=True):
            if case is not None and self._store.status(case) in (None, "ERROR"):
                jobs.setdefault(case, self._job(case, texts))
        self._fly(list(jobs.values()), store=True)
        trials = [self._trial(case, texts) for case, texts in zip(cases, wanted, strict=True)]
        self.asked += [trial.case for trial in trials]
        return trials

    def repeat(self, texts: Texts) -> Outcome:
        """Fly a case again, stored or not, and return its outcome without storing it. Raises HilError."""
        job = self._job(case_id(self.bench(texts)), texts)
        return self._fly([job], store=False)[job.case]

    def end(self) -> None:
        """Remove the files of the flights."""
        shutil.rmtree(self._out / WORK, ignore_errors=True)

    def _fly(self, jobs: list[Job], *, store: bool) -> dict[str, Outcome]:
        """Return the outcomes of flights by their cases, which are different."""
        made = {}
        for ended in flown(self._engine, jobs):
            for job, outcome in ended:
                made[job.case] = outcome
                if store:
                    self._store.put(job.case, outcome, job.texts)
            self.flown += len(ended)
            self.show()
        return made

    def _job(self, case: str, texts: Texts) -> Job:
        bench = None if self._bench is None else str(self._bench)
        return Job(case, bench, texts, str(self._out / WORK / f"{case}-{os.getpid()}"), "none", keep=False)

    def _trial(self, case: str | None, texts: Texts) -> Trial:
        if case is None:
            return Trial(unresolved_id(texts), Outcome("ERROR", error_type="ConfigError", error=self._problem(texts)))
        outcome = self._store.outcome(case)
        assert outcome is not None
        return Trial(case, outcome)

    def _problem(self, texts: Texts) -> str:
        try:
            self.bench(texts)
        except ConfigError as error:
            return str(error)
        return ""
