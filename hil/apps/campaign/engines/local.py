"""Engine of worker processes on this machine: one flight at a time in each.

A worker that dies takes no other with it: each has a process and a pipe of its own. Where there are enough processors,
each worker has its own for simulated autopilots, so that two flights never share one.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any

from hil.apps.campaign.engines.engine import Done
from hil.apps.campaign.engines.flight_number import FlightNumber
from hil.apps.campaign.flight import Job, Outcome, Slot, fly
from hil.run.runs.child_process import become_child, how_ended
from signals.errors import OutOfFiles, RecordingError

# Imports that every flight needs: the server that forks the workers has them once.
_PRELOADED = ["hil.apps.campaign.flight", "hil.config", "hil.run.bench_run", "hil.run.parts.catalog"]
_WORKER_FILES = 4  # of this process for each worker: its number, its pipe, and two that tell its end
_OTHER_FILES = 20  # of this process and of the server that forks the workers
_END_S = 5.0  # a worker that is asked to end gets this long


class LocalEngine:
    """Worker processes on this machine."""

    def __init__(self, workers: int, *, cores: int = 1, timeout_s: float | None = None) -> None:
        """`cores`: processors of one flight; `timeout_s`: wall-clock time after which a flight is ended as ERROR."""
        self._timeout_s = timeout_s
        _require_files(workers)
        context: Any = multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")
        if sys.platform == "linux":
            context.set_forkserver_preload(_PRELOADED)
        self._context = context
        self._numbers = [FlightNumber() for _ in range(workers)]
        self._workers = [_Worker(context, held.number, _share(held.number, cores)) for held in self._numbers]

    @property
    def capacity(self) -> int:
        return len(self._workers)

    @property
    def busy(self) -> int:
        return sum(worker.job is not None for worker in self._workers)

    def submit(self, job: Job) -> None:
        """Begin a job in an idle worker."""
        next(worker for worker in self._workers if worker.job is None).begin(job)

    def wait(self, timeout_s: float) -> list[Done]:
        """Return the jobs that have ended, waiting for the first of them at most `timeout_s`."""
        running = {worker.connection: worker for worker in self._workers if worker.job is not None}
        if self._timeout_s is not None and running:
            first_s = min(worker.began_s for worker in running.values()) + self._timeout_s
            timeout_s = min(timeout_s, max(0.0, first_s - time.monotonic()))
        done = [running[connection].take() for connection in wait(list(running), timeout_s)]  # type: ignore[index]
        for worker in running.values():
            if self._timeout_s is not None and worker.job is not None and worker.seconds > self._timeout_s:
                text = f"the flight took longer than flight_timeout_s: {self._timeout_s:g} s"
                done.append(Done(worker.job, Outcome("ERROR", error_type="Timeout", error=text)))
                worker.kill()
        return done

    def renew(self) -> None:
        """Replace all processes."""
        for worker in self._workers:
            worker.kill()

    def close(self) -> None:
        for worker in self._workers:
            worker.kill()
        while self._numbers:
            self._numbers.pop().free()


class _Worker:
    """One worker process, started with its first job."""

    def __init__(self, context: Any, number: int, processors: Sequence[int]) -> None:
        self._context, self._number, self._processors = context, number, processors
        self._process: Any = None
        self._connection: Connection | None = None
        self.job: Job | None = None
        self.began_s = 0.0

    @property
    def connection(self) -> Connection:
        assert self._connection is not None
        return self._connection

    @property
    def seconds(self) -> float:
        """Duration of the running job."""
        return time.monotonic() - self.began_s

    def begin(self, job: Job) -> None:
        """Send a job to the process."""
        if self._process is not None and not self._process.is_alive():
            self.kill()
        if self._process is None:
            self._start()
        self.job, self.began_s = job, time.monotonic()
        with suppress(OSError):  # it has just died; `take` will say so
            self.connection.send(job)

    def take(self) -> Done:
        """Return the ended job: its outcome, or how the process died."""
        job = self.job
        assert job is not None
        try:
            outcome = self.connection.recv()
        except (EOFError, OSError):
            self._process.join(_END_S)
            code = self._process.exitcode
            self.kill()
            return Done(job, None, f"worker {self._number} {how_ended(code)}")
        self.job = None
        return Done(job, outcome)

    def kill(self) -> None:
        """End the process at once; the next job starts another."""
        if self._process is not None and self._process.pid is not None:
            self._process.kill()
            self._process.join()
        if self._connection is not None:
            self._connection.close()
        self._process, self._connection, self.job = None, None, None

    def _start(self) -> None:
        name = f"worker {self._number}"
        try:
            self._connection, theirs = self._context.Pipe()
            with theirs:
                self._process = self._context.Process(
                    target=_serve, args=(theirs, self._number, tuple(self._processors)), name=name
                )
                self._process.start()
        except (OSError, EOFError) as error:  # EOFError: the server that forks workers has ended
            reason = getattr(error, "strerror", None) or "the server of the workers has ended"
            text = f"{name} cannot be started ({reason}): use fewer --workers, or raise `ulimit -n`"
            raise RecordingError(f"{text}. Everything stored so far is kept; continue with --resume") from error


def _require_files(workers: int) -> None:
    """Raise the limit of open files to what the workers need, as far as the system lets. Raises OutOfFiles."""
    needed = _OTHER_FILES + _WORKER_FILES * workers
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != resource.RLIM_INFINITY and soft < needed:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
        except (ValueError, OSError):
            text = f"{workers} workers need {needed} file descriptors, the limit is {soft}"
            raise OutOfFiles(f"{text}: use fewer --workers, or raise it with `ulimit -n {needed}`") from None


def _share(number: int, cores: int) -> list[int]:
    """Return the processors of a flight by its number; none: it may use all, because lower numbers have them."""
    if not hasattr(os, "sched_getaffinity"):
        return []
    allowed = sorted(os.sched_getaffinity(0))
    return allowed[number * cores : (number + 1) * cores] if (number + 1) * cores <= len(allowed) else []


def _serve(connection: Connection, number: int, processors: Sequence[int]) -> None:
    """Make flights until the campaign closes the connection. Runs in the worker."""
    become_child()
    slot = Slot(number, tuple(processors), f"worker {number}")
    while True:
        try:
            job: Job = connection.recv()
        except (EOFError, OSError):
            return
        outcome = fly(job, slot)
        with suppress(OSError):  # the campaign has ended
            connection.send(outcome)
