"""Engines of a campaign: they make flights somewhere, and return their outcomes in any order."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import NamedTuple, Protocol

from hil.apps.campaign.flight import Job, Outcome

ATTEMPTS = 3  # flights of a case whose worker is lost
WAIT_S = 0.5


class Done(NamedTuple):
    """A job that has ended. `outcome` None: its worker was lost, and the job can be made again elsewhere."""

    job: Job
    outcome: Outcome | None
    lost: str = ""  # how the worker ended


class Engine(Protocol):
    """Makes flights. Every method may raise HilError."""

    @property
    def capacity(self) -> int:
        """Number of flights that run at the same time."""
        ...

    @property
    def busy(self) -> int:
        """Number of jobs that have begun and not ended."""
        ...

    def submit(self, job: Job) -> None:
        """Begin a job. Call only while `busy` is below `capacity`."""
        ...

    def wait(self, timeout_s: float) -> list[Done]:
        """Return the jobs that have ended, waiting for the first of them at most `timeout_s`."""
        ...

    def renew(self) -> None:
        """Forget jobs that still run, and continue in other processes or on other nodes than before."""
        ...

    def close(self) -> None:
        """End all workers, whatever they do. Idempotent."""
        ...


def flown(engine: Engine, jobs: Iterable[Job]) -> Iterator[list[tuple[Job, Outcome]]]:
    """Make all jobs, and yield those that ended since, with their outcomes, at least every WAIT_S. Raises HilError.

    The next job is taken while the workers fly. One whose worker was lost is made again, up to ATTEMPTS times; then it
    is an ERROR.
    """
    coming, waiting, lost = iter(jobs), deque[Job](), Counter[Job]()

    def another() -> bool:
        if not waiting:
            waiting.extend(islice(coming, 1))
        return bool(waiting)

    while another() or engine.busy:
        while another() and engine.busy < engine.capacity:
            engine.submit(waiting.popleft())
        ended = []
        for job, outcome, how in engine.wait(WAIT_S):
            lost[job] += outcome is None
            if outcome is None and lost[job] < ATTEMPTS:
                waiting.append(job)
            else:
                text = f"{ATTEMPTS} times, at last {how}"
                ended.append((job, outcome or Outcome("ERROR", error_type="WorkerLost", error=text)))
        yield ended
