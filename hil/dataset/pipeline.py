"""From flight to files: batches go out to the workers as the flight gives them, and come back into one order.

The flight runs in this process. When as many batches are out as the workers may hold, it waits; so memory is bounded by
the workers' number and nothing else. What is written in order (recording, journal, tables) is written here.
"""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from hil.dataset.checkpoint import Checkpoints
from hil.dataset.chunk_places import ChunkPlaces
from hil.dataset.drawing import chunk_path
from hil.dataset.flight import FlightPart
from hil.dataset.formats.coco import CocoPicture
from hil.dataset.journal import BatchRecord, JournalWriter, read_pictures
from hil.dataset.moments import Batch
from hil.dataset.page_release import PageRelease
from hil.dataset.recording import DatasetRecording
from hil.dataset.tables import Tables
from hil.dataset.tree import JOURNAL
from hil.dataset.workers import Job, Made, Workers
from hil.signals.errors import RecordingError

_KEPT_BYTES = 64 << 20  # of COCO annotations in memory
AHEAD = 4  # batches that may wait for one before them, for each worker


class Pipeline:
    """Takes batches (`add`) and puts what comes of them in order."""

    def __init__(
        self,
        root: Path,
        workers: Workers,
        *,
        recording: DatasetRecording,
        journal: JournalWriter,
        tables: Tables,
        checkpoints: Checkpoints,
        expected: Sequence[BatchRecord],
        offsets: Sequence[int],
        on_done: Callable[[int], None],
        workers_count: int,
        places: ChunkPlaces,
    ) -> None:
        """`expected`, `offsets`: what an earlier attempt left, and where its chunks stand in the recording."""
        self._root, self._workers = root, workers
        self._recording, self._journal, self._tables, self._checkpoints = recording, journal, tables, checkpoints
        self._expected, self._offsets = expected, offsets
        self._on_done = on_done
        self._pages = PageRelease(root)
        self._parts: dict[int, tuple[Batch, FlightPart]] = {}  # handed out, not yet written in order
        self._made: dict[int, Made] = {}  # came back before one that stands before it
        self._next = 0
        self._most = AHEAD * workers_count
        self._places, self._free = places, list(range(self._most))
        self._place: dict[int, int] = {}  # of the batches under way
        self._pictures: list[CocoPicture] | None = []
        self._picture_bytes = 0
        self.records: list[BatchRecord] = []  # without their pictures
        self.found = 0  # batches that were there already
        self.frames = 0

    def add(self, batch: Batch, part: FlightPart) -> None:
        """A batch that the flight has given. Waits where too much is under way."""
        while not self._workers.room or len(self._parts) >= self._most:
            self._collect(block=True)
        self._parts[batch.index] = (batch, part)
        self._place[batch.index] = self._free.pop()
        self._workers.submit(self._job(batch)._replace(place=self._place[batch.index]))
        self._collect(block=False)

    def drain(self) -> None:
        """Wait for all that are out."""
        while self._workers.busy:
            self._collect(block=True)

    def _job(self, batch: Batch) -> Job:
        if batch.index >= len(self._expected):
            return Job(batch, None, 0)
        before = self._expected[batch.index]
        samples: Counter[str] = Counter(look.sensor for moment in batch.moments for look in moment.looks)
        if before.frames != batch.frames or before.samples != dict(samples):
            return Job(batch, None, 0)  # the last one of a smaller data set
        if before.flight_crc32 != batch.crc:
            raise RecordingError(
                f"{self._root}: the flight is another one than before, at frame {batch.first_frame}: with an autopilot "
                "whose flights do not repeat nothing can be resumed. Begin anew in another folder"
            )
        return Job(batch, before, self._offsets[batch.index])

    def _collect(self, *, block: bool) -> None:
        for made in self._workers.collect(block=block):
            self._made[made.record.index] = made
        while self._next in self._made:
            self._write(self._made.pop(self._next))
            self._next += 1

    def _write(self, made: Made) -> None:
        record = made.record
        batch, part = self._parts.pop(record.index)
        start = self._recording.size
        self._recording.add_flight(part)
        place = self._place.pop(record.index)
        if made.found and self._recording.size != self._offsets[record.index]:
            raise RecordingError(f"{self._root}: the journal does not fit the recording; begin anew in another folder")
        if made.in_memory:
            with self._places.piece(place, record.chunk.size) as piece:
                self._recording.add_frames(record.chunk, piece)
        elif made.found:
            self._recording.add_frames(record.chunk, None)
        else:
            path = chunk_path(self._root, record.index)
            self._recording.add_frames(record.chunk, path)
            with contextlib.suppress(OSError):
                os.unlink(path)
        self._free.append(place)
        self._pages.batch(record.files, self._recording.fileno(), start, self._recording.size)
        self._journal.append(record, self._recording.size - record.chunk.size)
        self._tables.add_flight(part)
        self._tables.add_files(record)
        self.records.append(replace(record, pictures=()))
        self._keep(record.pictures)
        self.found += made.found
        self.frames += batch.frames
        self._on_done(self.frames)
        self._checkpoints.maybe(self._after_sync)

    def _keep(self, pictures: Sequence[CocoPicture]) -> None:
        """As long as they are few: many are in the journal, and reading them back takes its time."""
        if self._pictures is None:
            return
        self._pictures += pictures
        self._picture_bytes += sum(len(text) for picture in pictures for text in picture.annotations)
        if self._picture_bytes > _KEPT_BYTES:
            self._pictures = None

    def pictures(self) -> Iterable[CocoPicture]:
        """What all batches add to the COCO files, in order."""
        return read_pictures(self._root / JOURNAL) if self._pictures is None else self._pictures

    def _after_sync(self) -> Callable[[], None]:
        texts = self._tables.take()
        return lambda: self._tables.write_out(texts)

    def finish(self) -> None:
        """Everything is in its place and on the disk, but for what stands at the end of the recording."""
        self.drain()
        self._checkpoints.finish(self._after_sync)

    def abandon(self) -> None:
        """After an error or Ctrl-C: leave the tables saying what there is, if that can still be done."""
        with contextlib.suppress(RecordingError, OSError):
            self._checkpoints.finish(self._after_sync)
