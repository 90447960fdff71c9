"""Engines of a campaign: they make flights somewhere, and return their outcomes in any order."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
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


def flown(engine: Engine, jobs: Iterable[Job]) -> Iterator[tuple[Job, Outcome]]:
    """Make all jobs and yield their outcomes in the order of their ends. Raises HilError.

    A job whose worker was lost is made again, up to ATTEMPTS times; then it is an ERROR.
    """
    waiting, lost = deque(jobs), Counter[Job]()
    while waiting or engine.busy:
        while waiting and engine.busy < engine.capacity:
            engine.submit(waiting.popleft())
        for job, outcome, how in engine.wait(WAIT_S):
            if outcome is None:
                lost[job] += 1
                if lost[job] < ATTEMPTS:
                    waiting.append(job)
                    continue
                outcome = worker_lost(how)
            yield job, outcome


def worker_lost(how: str) -> Outcome:
    """Return the outcome of a case whose worker was lost ATTEMPTS times."""
    return Outcome("ERROR", error_type="WorkerLost", error=f"{ATTEMPTS} times, at last {how}")
