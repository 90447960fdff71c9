"""From flight to files: batches go out to the workers as the flight gives them, and come back into one order.

The flight runs in this process. When as many batches are out as the workers may hold, it waits; so memory is bounded by
the workers' number and nothing else. What is written in order (recording, journal, tables) is written here.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from hil.dataset.drawing import take_finished
from hil.dataset.flight import FlightPart
from hil.dataset.formats.coco import CocoPicture
from hil.dataset.journal import BatchRecord, Journal
from hil.dataset.moments import Batch
from hil.dataset.recording import DatasetRecording
from hil.dataset.tables import Checkpoints, Tables
from hil.dataset.workers import Job, Made, Workers
from hil.signals.errors import RecordingError

AHEAD = 4  # batches that may wait for one before them, for each worker


class Pipeline:
    """Takes batches (`add`) and puts what comes of them in order."""

    def __init__(
        self,
        root: Path,
        workers: Workers,
        *,
        recording: DatasetRecording,
        journal: Journal,
        tables: Tables,
        checkpoints: Checkpoints,
        expected: Sequence[tuple[BatchRecord, int]],
        on_done: Callable[[int], None],
        workers_count: int,
    ) -> None:
        """`expected`: what an earlier attempt left, and where its chunks stand in the recording."""
        self._root, self._workers = root, workers
        self._recording, self._journal, self._tables, self._checkpoints = recording, journal, tables, checkpoints
        self._expected = expected
        self._on_done = on_done
        self._parts: dict[int, tuple[Batch, FlightPart]] = {}  # handed out, not yet written in order
        self._made: dict[int, Made] = {}  # came back before one that stands before it
        self._next = 0
        self._most = AHEAD * workers_count
        self.records: list[BatchRecord] = []  # without their pictures
        self.found = 0  # batches that were there already
        self.frames = 0

    def add(self, batch: Batch, part: FlightPart) -> None:
        """A batch that the flight has given. Waits where too much is under way."""
        while not self._workers.room or len(self._parts) >= self._most:
            self._collect(block=True)
        self._parts[batch.index] = (batch, part)
        self._workers.submit(self._job(batch))
        self._collect(block=False)

    def _job(self, batch: Batch) -> Job:
        if batch.index >= len(self._expected):
            return Job(batch, None, 0)
        before, offset = self._expected[batch.index]
        samples: Counter[str] = Counter(look.sensor for moment in batch.moments for look in moment.looks)
        if before.frames != batch.frames or before.samples != dict(samples):
            return Job(batch, None, 0)  # the last one of a smaller data set
        if before.flight_crc32 != batch.crc:
            raise RecordingError(
                f"{self._root}: the flight is another one than before, at frame {batch.first_frame}: with an autopilot "
                "whose flights do not repeat nothing can be resumed. Begin anew in another folder"
            )
        return Job(batch, replace(before, pictures=()), offset)

    def _collect(self, *, block: bool) -> None:
        for made in self._workers.collect(block=block):
            self._made[made.number] = made
        while self._next in self._made:
            self._write(self._made.pop(self._next))
            self._next += 1

    def _write(self, made: Made) -> None:
        batch, part = self._parts.pop(made.number)
        self._recording.add_flight(part)
        if made.found:
            record, offset = self._expected[made.number]
            if self._recording.size != offset:
                raise RecordingError(
                    f"{self._root}: the journal does not fit the recording; begin anew in another folder"
                )
            self._recording.add_frames(record.chunk, None)
        else:
            record, chunk = take_finished(self._root, made.number)
            self._recording.add_frames(record.chunk, chunk)
            self._journal.append(record, self._recording.size - record.chunk.size)
        self._tables.add_flight(part)
        self._tables.add_files(record)
        self.records.append(replace(record, pictures=()))
        self.found += made.found
        self.frames += batch.frames
        self._on_done(self.frames)
        self._checkpoints.maybe()

    def pictures(self) -> Iterator[CocoPicture]:
        """What all batches add to the COCO files, in order; in the journal, because there can be many."""
        return (picture for record, _ in self._journal.entries() for picture in record.pictures)

    def finish(self) -> None:
        """Everything is in its place and on the disk, but for what stands at the end of the recording."""
        while self._workers.busy:
            self._collect(block=True)
        self._checkpoints.finish()

    def abandon(self) -> None:
        """After an error or Ctrl-C: leave the tables saying what there is, if that can still be done."""
        with contextlib.suppress(RecordingError, OSError):
            self._checkpoints.finish()
