"""Jobs of a data set, and what the pipeline asks of the workers that do them."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from typing import NamedTuple, Protocol

from hil.apps.dataset.moments import Batch
from hil.apps.dataset.storage.journal import BatchRecord
from signals.errors import RecordingError, Shortage
from signals.shortage import named


class Job(NamedTuple):
    """A batch to make. `expected` is the record of an earlier attempt; its chunk is at `offset` in the recording."""

    batch: Batch
    expected: BatchRecord | None
    offset: int


class JobResult(NamedTuple):
    """A finished batch by its index. `was_complete` is True if an earlier attempt had left it complete."""

    number: int
    was_complete: bool


JobHandler = Callable[[Job], JobResult]  # runs in the worker


class Workers(Protocol):
    """Workers that make batches, on this machine or on others. Every method may raise HilError."""

    @property
    def capacity(self) -> int:
        """Number of batches that may be submitted at a time."""
        ...

    @property
    def busy(self) -> int:
        """Number of batches that were submitted and not returned by `collect`."""
        ...

    def submit(self, job: Job) -> None:
        """Queue a batch. Call only while `busy` is below `capacity`."""
        ...

    def collect(self, *, block: bool) -> list[JobResult]:
        """Return finished batches; with `block`, wait for at least one unless none is pending."""
        ...

    def close(self) -> None:
        """End all workers, dropping queued batches. Idempotent."""
        ...


def handled(make_handler: Callable[[], JobHandler], job: Job) -> JobResult:
    """Make a handler and do a job with it, in a worker. Raises RecordingError for any error."""
    try:
        return make_handler()(job)
    except Exception as defect:  # noqa: BLE001 (a defect of the bench must reach the person, not end in silence)
        told = named(defect)
        if told is not None:
            raise RecordingError(f"a worker process: {told}" if isinstance(told, Shortage) else str(told)) from None
        text = "".join(traceback.format_exception(defect)) if os.environ.get("HIL_TRACEBACK") else ""
        raise RecordingError(
            f"{type(defect).__name__}: {defect} (a defect of the bench, in a worker; HIL_TRACEBACK=1 shows where)"
            + (f"\n{text}" if text else "")
        ) from None
