"""Processes that make batches: a pool of `concurrent.futures`, each process with one thread, renderer and encoder.

Processes are forked where that is safe (one thread, so nobody can hold a lock for ever): then the scene, compiled once,
is there at no cost. Elsewhere fresh ones are started, which load the bench that was saved with the data set.

At most `DEPTH` batches a worker are out at a time, one in work and one that waits, so memory is bounded and nobody
waits for the parent. Answers are far shorter than a pipe holds: a worker that is killed leaves none half sent.
"""

from __future__ import annotations

import ctypes
import gc
import multiprocessing as mp
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, NamedTuple

from hil.dataset.journal import BatchRecord
from hil.dataset.moments import Batch
from hil.signals.errors import HilError, RecordingError

DEPTH = 2
_PR_SET_PDEATHSIG = 1  # of Linux


class Job(NamedTuple):
    """A batch to be made. `expected`: what an earlier attempt left, with the place of its chunk in the recording."""

    batch: Batch
    expected: BatchRecord | None
    offset: int


class Made(NamedTuple):
    """A batch that is done. `found`: it was there, whole."""

    number: int  # of the batch
    found: bool


Maker = Callable[[Job], Made]  # whatever does a job, in the worker


class Workers:
    """Use as a context manager: leaving it waits for the batches in work."""

    def __init__(self, count: int, make_maker: Callable[[], Maker]) -> None:
        """`make_maker` is called in each worker; it must be picklable where processes are not forked."""
        self._forked = sys.platform == "linux" and threading.active_count() == 1
        if self._forked:
            gc.collect()
            gc.freeze()  # what is shared stays so: the collector does not write on it, nor look through it here
        context: Any = mp.get_context("fork" if self._forked else "spawn")
        self._pool = ProcessPoolExecutor(count, context, _begin, (make_maker,))
        self._most = DEPTH * count
        self._out: set[Future[Made]] = set()
        with warnings.catch_warnings():
            # Newer Pythons count native threads too and warn; those of numpy's BLAS are put down before a fork.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._pool.submit(os.getpid)  # forks all of them now, before the flight has threads
        self._processes = set(mp.active_children())

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def busy(self) -> int:
        """Batches that are not yet back."""
        return len(self._out)

    @property
    def room(self) -> bool:
        """Whether another batch would be taken at once."""
        return self.busy < self._most

    def submit(self, job: Job) -> None:
        """Give a batch to whoever is free next. Call while there is `room`."""
        try:
            self._out.add(self._pool.submit(_do, job))
        except BrokenProcessPool:
            raise self._death() from None
        self._processes |= set(mp.active_children())

    def collect(self, *, block: bool) -> list[Made]:
        """Batches that have come back; `block`: at least one, if any is out. HilError of a worker, or its death."""
        done, self._out = wait(self._out, None if block else 0, FIRST_COMPLETED)
        try:
            return [future.result() for future in done]
        except BrokenProcessPool:
            raise self._death() from None

    def _death(self) -> RecordingError:
        self._pool.shutdown()
        codes = {process.pid: process.exitcode or 0 for process in self._processes}
        # The pool ends the others with SIGTERM, once it has seen one die.
        pid, code = next(
            ((pid, code) for pid, code in codes.items() if code not in (0, -signal.SIGTERM)), next(iter(codes.items()))
        )
        how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with status {code}"
        if code == -signal.SIGKILL:
            how += ", as the system does when memory runs out: use fewer --workers, or smaller pictures"
        return RecordingError(f"a worker process (pid {pid}) {how}. What was written is kept; go on with --resume")

    def close(self) -> None:
        """End them all; idempotent."""
        self._pool.shutdown(cancel_futures=True)
        if self._forked:
            self._forked = False
            gc.unfreeze()


_make_maker: Callable[[], Maker]  # of this process, if it is a worker
_maker: Maker | None = None


def _begin(make_maker: Callable[[], Maker]) -> None:
    """A worker's life begins."""
    global _make_maker
    _make_maker = make_maker
    _end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def _end_with_parent() -> None:
    """However the parent ends: nobody is to write on behind its back."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))
    elif (parent := mp.parent_process()) is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()


def _do(job: Job) -> Made:
    """Does a job in a worker. RecordingError, whatever goes wrong."""
    global _maker
    try:
        if _maker is None:
            _maker = _make_maker()
        return _maker(job)
    except HilError as error:
        raise RecordingError(str(error)) from None
    except MemoryError:
        raise RecordingError("a worker process has no memory left: use fewer --workers, or smaller pictures") from None
    except Exception as defect:  # noqa: BLE001 (a defect of the bench must reach the person, not end in silence)
        text = "".join(traceback.format_exception(defect)) if os.environ.get("HIL_TRACEBACK") else ""
        raise RecordingError(
            f"{type(defect).__name__}: {defect} (a defect of the bench, in a worker; HIL_TRACEBACK=1 shows where)"
            + (f"\n{text}" if text else "")
        ) from None
