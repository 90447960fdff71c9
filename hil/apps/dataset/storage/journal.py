"""Journal of a data set: the finished batches, their files and the checksums by which `--resume` verifies them.

One row per batch: its number, the offset of its chunk in the recording and its record as JSON. Rows after the first
missing or damaged one are ignored.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydantic import TypeAdapter

from hil.apps.dataset.formats.coco import CocoPicture
from hil.apps.dataset.label_form import AnnotatedFrame
from hil.apps.dataset.storage.tree import Written
from hil.run.recorder.mcap.mcap_file import ChunkFacts
from hil.run.runs.result_database import Database, UnusableDatabaseError


@dataclass(frozen=True)
class StoredChunk:
    """Chunk of the recording with a batch's frames: size in bytes, checksum, summary entries and channels."""

    size: int
    crc32: int
    facts: ChunkFacts
    channels: tuple[tuple[int, str, str], ...]  # number, topic, type


@dataclass(frozen=True)
class BatchRecord:
    """Result of one batch: files, sample counts, labels and chunk."""

    index: int
    first_frame: int
    frames: int
    flight_crc32: int  # `Batch.crc` of the batch's moments
    files: tuple[Written, ...]
    samples: dict[str, int]  # by sensor
    frame_t_ns: tuple[int, ...]
    objects: tuple[dict[int, int], ...]  # by frame: class to number of objects
    class_pixels: dict[int, int]
    chunk: StoredChunk
    pictures: tuple[CocoPicture, ...] = ()
    annotated: tuple[AnnotatedFrame, ...] = ()  # frames with 3-D labels
    best_radar_frame: dict[str, tuple[float, int]] = field(default_factory=dict)  # by radar: rank, time of the frame

    def without_labels(self) -> BatchRecord:
        """Return the record without what takes memory and is read from the journal when it is needed."""
        return replace(self, pictures=(), annotated=())


_JSON = TypeAdapter(BatchRecord)
_VERSION = 3  # of the table below
_TABLES = {"batch": "number INTEGER PRIMARY KEY, offset INTEGER NOT NULL, record BLOB NOT NULL"}


class Journal:
    """The database file, opened for writing by one process."""

    def __init__(self, path: Path) -> None:
        """Open or create the file; one that is damaged or of another version is replaced.

        Raises RecordingError if it cannot be written.
        """
        try:
            self._db = _opened(path)
        except UnusableDatabaseError:
            for file in (path, path.with_name(f"{path.name}-wal"), path.with_name(f"{path.name}-journal")):
                file.unlink(missing_ok=True)
            self._db = _opened(path)

    def entries(self, numbers: Container[int] | None = None) -> Iterator[tuple[BatchRecord, int]]:
        """Yield the record of each batch and the offset of its chunk in the recording, in order.

        `numbers`: of the batches to yield; None: all.
        """
        with suppress(UnusableDatabaseError):  # the batches that follow are made again
            for count, (index, offset, text) in enumerate(self._db.rows("batch")):
                if index != count:
                    return
                if numbers is None or index in numbers:
                    yield _JSON.validate_json(text), offset

    def append(self, record: BatchRecord, offset: int) -> None:
        """Store a batch's record, replacing an earlier one. Raises RecordingError."""
        self._db.put("batch", record.index, offset, _JSON.dump_json(record))

    def close(self) -> None:
        """Close the file. Idempotent."""
        self._db.close()


def _opened(path: Path) -> Database:
    return Database(path, _TABLES, version=_VERSION, shared=False)
