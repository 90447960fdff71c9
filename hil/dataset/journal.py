"""The journal: which batches are done, what files they made and how to tell that those are whole.

A SQLite database with one row a batch: its number, where its chunk stands in the recording, what became of it as JSON
and the CRC-32 of that. Writes survive the end of the process at once, a power cut up to the last sync of the file
system. Rows count up to the first one that is missing or damaged.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from isal.isal_zlib import crc32
from pydantic import TypeAdapter

from hil.dataset.formats.coco import CocoPicture
from hil.dataset.tree import Written, unwritable
from hil.recorder.mcap_file import ChunkFacts


@dataclass(frozen=True)
class StoredChunk:
    """The chunk of the recording with the batch's frames: its checksum, and what the file's summary says of it."""

    size: int
    crc32: int
    facts: ChunkFacts
    channels: tuple[tuple[int, str, str], ...]  # number, topic, type


@dataclass(frozen=True)
class BatchRecord:
    """What became of one batch."""

    index: int
    first_frame: int
    frames: int
    flight_crc32: int  # of the moments that it was made of
    files: tuple[Written, ...]
    samples: dict[str, int]  # by sensor
    frame_t_ns: tuple[int, ...]  # of its frames
    objects: tuple[dict[int, int], ...]  # by frame: class to number of objects
    class_pixels: dict[int, int]
    chunk: StoredChunk
    pictures: tuple[CocoPicture, ...] = ()


_JSON = TypeAdapter(BatchRecord)
# The last two: other columns, and a head that names a version which this library only reads.
_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_READONLY)


class Journal:
    """Opened where there is one, else begun. RecordingError where it cannot be written; a damaged one is begun anew."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            try:
                self._db = _opened(path)
            except sqlite3.DatabaseError as error:
                if getattr(error, "sqlite_errorcode", 0) & 0xFF not in _DAMAGED:
                    raise
                for part in (path, path.with_name(f"{path.name}-wal")):
                    part.unlink(missing_ok=True)
                self._db = _opened(path)
        except (sqlite3.Error, OSError) as error:
            raise unwritable(path, error) from error

    def entries(self) -> Iterator[tuple[BatchRecord, int]]:
        """What is known of each batch, and where its chunk stands in the recording."""
        count = 0
        try:
            for index, offset, crc, text in self._db.execute(_ALL):
                if index != count or crc32(text) != crc:
                    return
                yield _JSON.validate_json(text), offset
                count += 1
        except (sqlite3.DatabaseError, TypeError, ValueError):  # damaged: what follows is made again
            return

    def append(self, record: BatchRecord, offset: int) -> None:
        """Takes the place of what was known of that batch."""
        text = _JSON.dump_json(record)
        try:
            self._db.execute("REPLACE INTO batch VALUES (?, ?, ?, ?)", (record.index, offset, crc32(text), text))
        except sqlite3.Error as error:
            raise unwritable(self._path, error) from error

    def close(self) -> None:
        """Idempotent."""
        self._db.close()


_TABLE = "CREATE TABLE batch (number INTEGER PRIMARY KEY, offset INTEGER, crc32 INTEGER, record BLOB)"
_ALL = "SELECT number, offset, crc32, record FROM batch ORDER BY number"


def _opened(path: Path) -> sqlite3.Connection:
    db = sqlite3.connect(path, isolation_level=None)  # each statement is a transaction
    db.execute("PRAGMA locking_mode = EXCLUSIVE")  # no shared memory, which network file systems lack
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = NORMAL")
    db.execute(_TABLE.replace("TABLE", "TABLE IF NOT EXISTS"))
    db.execute("PRAGMA user_version = 1")  # a head that forbids writing shows here
    db.execute(_ALL)
    # A damaged description of the table may still be one that SQLite reads, with another meaning.
    table = db.execute("SELECT sql FROM sqlite_master").fetchall()
    if table != [(_TABLE,)] or db.execute("PRAGMA quick_check(1)").fetchone() != ("ok",):
        damaged = sqlite3.DatabaseError("the database is damaged")
        damaged.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
        raise damaged
    return db
