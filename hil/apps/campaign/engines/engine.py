"""Engines of a campaign: they make flights somewhere, and return their outcomes in any order."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from hil.apps.campaign.flight import Job, Outcome


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
