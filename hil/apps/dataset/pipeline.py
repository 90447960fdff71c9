"""Pipeline from flight to files: the workers make each batch of the flight, and the results are stored in order.

The flight runs in this process. It waits while the workers have the greatest number of batches, so memory is bounded by
their capacity. Everything that is written in order (recording, journal, tables) is written here.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable

from hil.apps.dataset.batch_maker import take_finished
from hil.apps.dataset.engines.jobs import Job, JobResult, Workers
from hil.apps.dataset.flight import FlightData
from hil.apps.dataset.moments import Batch
from hil.apps.dataset.storage.journal import BatchRecord
from hil.apps.dataset.storage.store import DatasetStore
from signals.errors import RecordingError

UNSTORED = 2  # submitted batches that are not stored yet, as a multiple of the workers' capacity


class Pipeline:
    """Distributor of batches to the workers (`add`), which stores their results in order."""

    def __init__(self, store: DatasetStore, workers: Workers, *, on_done: Callable[[int], None]) -> None:
        """`on_done` is called with the number of frames stored, after each batch."""
        self._store, self._workers = store, workers
        self._expected = list(store.journal.entries())  # records of an earlier attempt, with offsets of their chunks
        self._on_done = on_done
        self._pending: dict[int, tuple[Batch, FlightData]] = {}  # submitted, not yet stored
        self._results: dict[int, JobResult] = {}  # finished before an earlier batch
        self._next = 0
        self.records: list[BatchRecord] = []  # without their labels
        self.kept_batches = 0  # batches that an earlier attempt left complete
        self.frames = 0

    def add(self, batch: Batch, data: FlightData) -> None:
        """Submit a batch. Waits while too many batches are pending. Raises HilError of a worker."""
        while self._workers.busy >= (capacity := self._workers.capacity) or len(self._pending) >= UNSTORED * capacity:
            self._collect(block=True)
        self._pending[batch.index] = (batch, data)
        self._workers.submit(self._job(batch))
        self._collect(block=False)

    def _job(self, batch: Batch) -> Job:
        if batch.index >= len(self._expected):
            return Job(batch, None, 0)
        expected, offset = self._expected[batch.index]
        samples: Counter[str] = Counter(due.sensor for moment in batch.moments for due in moment.due)
        if expected.frames != batch.frames or expected.samples != dict(samples):
            return Job(batch, None, 0)  # the last batch of a smaller data set
        if expected.flight_crc32 != batch.crc:
            raise RecordingError(
                f"{self._store.root}: the flight differs from that of the earlier attempt, from frame "
                f"{batch.first_frame} on. With an autopilot whose flights do not repeat, a data set cannot be resumed: "
                "choose another folder"
            )
        return Job(batch, expected.without_labels(), offset)

    def _collect(self, *, block: bool) -> None:
        for result in self._workers.collect(block=block):
            self._results[result.number] = result
        while self._next in self._results:
            self._append(self._results.pop(self._next))
            self._next += 1

    def _append(self, result: JobResult) -> None:
        batch, data = self._pending.pop(result.number)
        store = self._store
        store.recording.add_flight(data)
        if result.was_complete:
            record, offset = self._expected[result.number]
            if store.recording.size != offset:
                raise RecordingError(f"{store.root}: the journal does not match the recording; choose another folder")
            store.recording.add_frames(record.chunk, None)
        else:
            record, chunk = take_finished(store.root, result.number)
            store.recording.add_frames(record.chunk, chunk)
            store.journal.append(record, store.recording.size - record.chunk.size)
        store.tables.add_flight(data)
        store.tables.add_files(record)
        self.records.append(record.without_labels())
        self.kept_batches += result.was_complete
        self.frames += batch.frames
        self._on_done(self.frames)
        store.checkpoints.start_if_due()

    def finish(self) -> None:
        """Wait for all batches and make a checkpoint. Only the recording's summary is then missing on the disk."""
        while self._workers.busy:
            self._collect(block=True)
        self._store.checkpoints.finish()

    def abandon(self) -> None:
        """After an error or Ctrl-C, bring the tables up to date, if that is still possible."""
        with contextlib.suppress(RecordingError, OSError):
            self._store.checkpoints.finish()
