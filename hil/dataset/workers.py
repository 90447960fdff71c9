"""Processes that make batches.

Each has one thread, its own renderer and encoder, and a pipe to the parent. A process is forked where that is safe
(one thread, so nobody can hold a lock for ever): then the scene, compiled once, is there at no cost. Elsewhere a fresh
one is started, which loads the bench that was saved with the data set.

At most `DEPTH` batches are with a worker at a time, one in work and one that waits, so memory is bounded and nobody
waits for the parent. A worker that dies (killed for memory, say) is told by its pipe: that ends the work with an error.
"""

from __future__ import annotations

import contextlib
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
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple, Protocol

from hil.dataset.journal import BatchRecord
from hil.dataset.moments import Batch
from hil.signals.errors import HilError, RecordingError

DEPTH = 2
_PR_SET_PDEATHSIG = 1  # of Linux


class Job(NamedTuple):
    """A batch to be made. `expected`: what an earlier attempt left, with the place of its chunk in the recording.
    `place`: in shared memory, where its chunk may go."""

    batch: Batch
    expected: BatchRecord | None
    offset: int
    place: int = -1


class Made(NamedTuple):
    """A batch that is done. `found`: it was there, whole. `in_memory`: its chunk is in the job's place, not a file."""

    record: BatchRecord
    found: bool
    in_memory: bool = False


class Maker(Protocol):
    """Whatever does a job, in the worker."""

    def __call__(self, job: Job) -> Made: ...


@dataclass
class _Worker:
    process: Any
    pipe: Connection
    jobs: int = 0


class Workers:
    """Use as a context manager: leaving it ends the processes, those in the middle of a batch too."""

    def __init__(self, count: int, make_maker: Callable[[], Maker]) -> None:
        """`make_maker` is called in each worker; it must be picklable where processes are not forked."""
        forked = sys.platform == "linux" and threading.active_count() == 1
        context: Any = mp.get_context("fork" if forked else "spawn")
        pipes = [context.Pipe() for _ in range(count)]
        self._workers: list[_Worker] = []
        self._lost: str | None = None
        if forked:
            gc.collect()
            gc.freeze()  # what is shared stays so: the collector does not write on it, nor look through it here
        for i, (near, far) in enumerate(pipes):
            # A forked process has the ends of all: with those of others open nobody would see a pipe close.
            close = [end for j, pair in enumerate(pipes) for end in pair if end is not far] if forked else []
            arguments = (far, make_maker, close)
            process = context.Process(target=_work, args=arguments, name=f"hil-dataset-{i}", daemon=True)
            with warnings.catch_warnings():
                # Newer Pythons count native threads too and warn; those of numpy's BLAS are put down before a fork.
                warnings.simplefilter("ignore", DeprecationWarning)
                process.start()
            self._workers.append(_Worker(process, near))
        for _, far in pipes:
            far.close()
        self._frozen = forked

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def busy(self) -> int:
        """Batches that are not yet back."""
        return sum(worker.jobs for worker in self._workers)

    @property
    def room(self) -> bool:
        """Whether another batch would be taken at once."""
        return any(worker.jobs < DEPTH for worker in self._workers)

    def submit(self, job: Job) -> None:
        """Give a batch to whoever has least to do. Call while there is `room`."""
        worker = min(self._workers, key=lambda w: w.jobs)
        try:
            worker.pipe.send(job)
        except (BrokenPipeError, ConnectionResetError):
            raise self._death(worker) from None
        worker.jobs += 1

    def collect(self, *, block: bool) -> list[Made]:
        """Batches that have come back; `block`: at least one, if any is out. HilError of a worker, or its death."""
        made: list[Made] = []
        if not self.busy:
            return made
        ready = wait([worker.pipe for worker in self._workers], None if block else 0)
        for worker in self._workers:
            if worker.pipe not in ready:
                continue
            try:
                answer = worker.pipe.recv()
            except (EOFError, OSError):
                raise self._death(worker) from None
            if isinstance(answer, RecordingError):
                raise answer
            worker.jobs -= 1
            made.append(answer)
        return made

    def _death(self, worker: _Worker) -> RecordingError:
        worker.process.join(5.0)
        code = worker.process.exitcode
        how = f"ended with status {code}"
        if code is not None and code < 0:
            how = f"was ended by {signal.Signals(-code).name}"
            if -code == signal.SIGKILL:
                how += ", as the system does when memory runs out: use fewer --workers, or smaller pictures"
        return RecordingError(
            f"a worker process (pid {worker.process.pid}) {how}. What was written is kept; go on with --resume"
        )

    def close(self) -> None:
        """End them all; idempotent."""
        for worker in self._workers:
            with contextlib.suppress(OSError):
                worker.pipe.close()
        for worker in self._workers:
            # In the middle of a batch nothing is lost: it is not in the journal yet.
            worker.process.terminate()
        for worker in self._workers:
            worker.process.join()
        self._workers = []
        if self._frozen:
            self._frozen = False
            gc.unfreeze()


def _end_with_parent() -> None:
    """However the parent ends: nobody is to write on behind its back."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))


def _work(pipe: Connection, make_maker: Callable[[], Maker], close: list[Connection]) -> None:
    """A worker's life."""
    _end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    for end in close:
        end.close()
    answer: RecordingError
    try:
        maker = make_maker()
        while True:
            job: Job = pipe.recv()
            pipe.send(maker(job))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return  # the parent is gone
    except HilError as error:
        answer = RecordingError(str(error))
    except MemoryError:
        answer = RecordingError("a worker process has no memory left: use fewer --workers, or smaller pictures")
    except Exception as defect:  # noqa: BLE001 (a defect of the bench must reach the person, not end in silence)
        text = "".join(traceback.format_exception(defect)) if os.environ.get("HIL_TRACEBACK") else ""
        answer = RecordingError(
            f"{type(defect).__name__}: {defect} (a defect of the bench, in a worker; HIL_TRACEBACK=1 shows where)"
            + (f"\n{text}" if text else "")
        )
    with contextlib.suppress(OSError, ValueError):
        pipe.send(answer)
