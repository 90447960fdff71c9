"""Worker processes that make batches: a `ProcessPoolExecutor`; each process has one thread, renderer and encoder.

Processes are forked where that is safe (with a single thread, no lock can be held during the fork) and then share the
compiled scene. Elsewhere new processes are spawned, which load the bench saved with the data set.

At most `JOBS_PER_WORKER` batches per worker are submitted at a time, one running and one queued, so memory is bounded
and no worker idles. A result is far smaller than a pipe's buffer, so a killed worker cannot leave half of one.
"""

from __future__ import annotations

import gc
import multiprocessing as mp
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from hil.apps.dataset.engines.jobs import Job, JobHandler, JobResult, handled
from hil.run.runs.child_process import become_child, how_ended
from signals.errors import RecordingError
from signals.shortage import shortage
from sim.frame.path_traced import process as path_tracer

JOBS_PER_WORKER = 2


class LocalWorkers:
    """Pool of `count` worker processes. `close` waits for running batches."""

    def __init__(self, count: int, make_handler: Callable[[], JobHandler]) -> None:
        """`make_handler` is called once per worker; it must be picklable where processes are not forked."""
        self._forked = sys.platform == "linux" and threading.active_count() == 1
        if self._forked:
            gc.collect()
            gc.freeze()  # keeps shared pages shared: the collector neither writes to nor scans what exists now
        self.capacity = JOBS_PER_WORKER * count
        self._pending: set[Future[JobResult]] = set()
        try:
            self._pool = self._started(count, make_handler)
        except BaseException as error:
            self._unfreeze()
            if not isinstance(error, OSError):
                raise
            raise shortage(error) or RecordingError(
                f"the worker processes cannot be started ({error.strerror or error}): they need a writable /dev/shm"
            ) from error
        self._processes = set(mp.active_children())

    def _started(self, count: int, make_handler: Callable[[], JobHandler]) -> ProcessPoolExecutor:
        context: Any = mp.get_context("fork" if self._forked else "spawn")
        pool = ProcessPoolExecutor(count, context, _initialise_worker, (make_handler, count))
        with warnings.catch_warnings():
            # Newer Pythons count native threads too and warn, but numpy's BLAS ends its threads before a fork.
            warnings.simplefilter("ignore", DeprecationWarning)
            pool.submit(os.getpid)  # forks all workers now, before the flight starts threads
        return pool

    @property
    def busy(self) -> int:
        """Number of batches that are queued or running."""
        return len(self._pending)

    def submit(self, job: Job) -> None:
        """Queue a batch for the next free worker. Call only while `busy` is below `capacity`. Raises RecordingError."""
        try:
            self._pending.add(self._pool.submit(_run_job, job))
        except BrokenProcessPool:
            raise self._worker_death() from None
        self._processes |= set(mp.active_children())

    def collect(self, *, block: bool) -> list[JobResult]:
        """Return finished batches; with `block`, wait for at least one unless none is pending.

        Raises the HilError of a worker, or RecordingError if a worker has died.
        """
        done, self._pending = wait(self._pending, None if block else 0, FIRST_COMPLETED)
        try:
            return [future.result() for future in done]
        except BrokenProcessPool:
            raise self._worker_death() from None

    def _worker_death(self) -> RecordingError:
        """Shut the pool down and return the error that tells how a worker ended."""
        self._pool.shutdown()
        codes = {process.pid: process.exitcode or 0 for process in self._processes}
        # The pool ends the other workers with SIGTERM once it has seen one die.
        pid, code = next(
            ((pid, code) for pid, code in codes.items() if code not in (0, -signal.SIGTERM)), next(iter(codes.items()))
        )
        return RecordingError(
            f"a worker process (pid {pid}) {how_ended(code)}. Everything written so far is kept; continue with --resume"
        )

    def close(self) -> None:
        """End all workers, dropping queued batches. Idempotent."""
        self._pool.shutdown(cancel_futures=True)
        self._unfreeze()

    def _unfreeze(self) -> None:
        if self._forked:
            self._forked = False
            gc.unfreeze()


_make_handler: Callable[[], JobHandler]  # set in worker processes
_handler: JobHandler | None = None


def _initialise_worker(make_handler: Callable[[], JobHandler], count: int) -> None:
    """Initialise a worker process, one of `count`."""
    global _make_handler
    _make_handler = make_handler
    path_tracer.threads_per_process = max(1, (os.cpu_count() or 1) // count)
    become_child()


def _run_job(job: Job) -> JobResult:
    """Run a job in a worker. Raises RecordingError for any error."""
    return handled(_kept_handler, job)


def _kept_handler() -> JobHandler:
    global _handler
    if _handler is None:
        _handler = _make_handler()
    return _handler
