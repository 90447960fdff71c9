"""Journal of a data set: the finished batches, their files and the checksums by which `--resume` verifies them.

A SQLite database with one row per batch: its number, the offset of its chunk in the recording, its record as JSON and
the CRC-32 of that text. Once written, a row survives a crash of the process; after the next sync, also a power cut.
Rows after the first missing or damaged one are ignored.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from isal.isal_zlib import crc32
from pydantic import TypeAdapter

from hil.apps.dataset.formats.coco import CocoPicture
from hil.apps.dataset.storage.tree import Written, unwritable
from hil.run.recorder.mcap.mcap_file import ChunkFacts


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
    best_radar_frame: dict[str, tuple[float, int]] = field(default_factory=dict)  # by radar: rank, time of the frame


_JSON = TypeAdapter(BatchRecord)
# ERROR: the table has other columns. READONLY: the header names a version that this library can only read.
_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_READONLY)


class Journal:
    """The database file, opened for writing by one process."""

    def __init__(self, path: Path) -> None:
        """Open or create the file; a damaged file is replaced. Raises RecordingError if it cannot be written."""
        self._path = path
        try:
            try:
                self._db = _open_database(path)
            except sqlite3.DatabaseError as error:
                if getattr(error, "sqlite_errorcode", 0) & 0xFF not in _DAMAGED:
                    raise
                for file in (path, path.with_name(f"{path.name}-wal")):
                    file.unlink(missing_ok=True)
                self._db = _open_database(path)
        except (sqlite3.Error, OSError) as error:
            raise unwritable(path, error) from error

    def entries(self) -> Iterator[tuple[BatchRecord, int]]:
        """Yield the record of each batch and the offset of its chunk in the recording, in order."""
        count = 0
        try:
            for index, offset, crc, text in self._db.execute(_SELECT_ALL):
                if index != count or crc32(text) != crc:
                    return
                yield _JSON.validate_json(text), offset
                count += 1
        except (sqlite3.DatabaseError, TypeError, ValueError):  # damaged: the following batches are made again
            return

    def append(self, record: BatchRecord, offset: int) -> None:
        """Store a batch's record, replacing an earlier one. Raises RecordingError."""
        text = _JSON.dump_json(record)
        try:
            self._db.execute("REPLACE INTO batch VALUES (?, ?, ?, ?)", (record.index, offset, crc32(text), text))
        except sqlite3.Error as error:
            raise unwritable(self._path, error) from error

    def close(self) -> None:
        """Close the file. Idempotent."""
        self._db.close()


_TABLE = "CREATE TABLE batch (number INTEGER PRIMARY KEY, offset INTEGER, crc32 INTEGER, record BLOB)"
_SELECT_ALL = "SELECT number, offset, crc32, record FROM batch ORDER BY number"


def _open_database(path: Path) -> sqlite3.Connection:
    db = sqlite3.connect(path, isolation_level=None)  # each statement is a transaction
    db.execute("PRAGMA locking_mode = EXCLUSIVE")  # avoids shared memory, which network file systems lack
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = NORMAL")
    db.execute(_TABLE.replace("TABLE", "TABLE IF NOT EXISTS"))
    db.execute("PRAGMA user_version = 1")  # fails if the header forbids writing
    db.execute(_SELECT_ALL)
    # A damaged table description may still be valid SQL with another meaning.
    table = db.execute("SELECT sql FROM sqlite_master").fetchall()
    if table != [(_TABLE,)] or db.execute("PRAGMA quick_check(1)").fetchone() != ("ok",):
        damaged = sqlite3.DatabaseError("the database is damaged")
        damaged.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
        raise damaged
    return db
