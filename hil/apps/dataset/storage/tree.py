"""Folder of a data set: fixed file names, atomic writes, and a lock that admits one writer at a time."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from isal.isal_zlib import crc32

from signals.errors import RecordingError

ANNOTATIONS = "annotations"  # COCO
PREVIEW = "preview"
CHECKSUMS = "checksums.csv"
JOURNAL = "journal.sqlite3"
WORK = ".work"  # folder of temporary files, deleted when the data set is complete
INCOMPLETE = ".part"  # suffix of incomplete files
_LOCK = "lock"
_CHUNK_CHARACTERS = 1 << 20  # of many texts, held in memory before they are written


class Written(NamedTuple):
    """A complete file of the tree: relative path with slashes, size in bytes and checksum."""

    path: str
    size: int
    crc32: int


class TreeWriter:
    """Atomic writer of files into a folder; it makes subfolders as needed."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._root = str(root)
        self._existing_folders: set[str] = set()

    def write(self, path: str, data: bytes) -> Written:
        """Write or replace a file. Raises RecordingError if that fails, and then keeps the previous file."""
        return self.write_parts(path, (data,))

    def write_parts(self, path: str, parts: Iterable[bytes]) -> Written:
        """Write a file that is produced piece by piece; otherwise like `write`."""
        folder, _, name = path.rpartition("/")
        if folder not in self._existing_folders:
            make_folder(self.root / folder)
            self._existing_folders.add(folder)
        # A fixed temporary name: the next attempt overwrites what a killed process left.
        temporary = f"{self._root}/{folder}/.{name}{INCOMPLETE}"
        size = crc = 0
        try:
            with open(temporary, "wb") as file:
                for data in parts:
                    file.write(data)
                    size += len(data)
                    crc = crc32(data, crc)
            os.replace(temporary, f"{self._root}/{path}")
        except OSError as error:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise unwritable(self.root / path, error) from error
        return Written(path, size, crc)

    def write_texts(self, path: str, texts: Iterable[str]) -> Written:
        """Write a file of many short texts, joined before they are written; otherwise like `write`."""
        return self.write_parts(path, _chunks(texts))

    def holds(self, written: Written) -> bool:
        """Return True if the file exists with that size and checksum."""
        try:
            with open(f"{self._root}/{written.path}", "rb", buffering=0) as file:
                if os.fstat(file.fileno()).st_size != written.size:
                    return False
                return crc32(file.readall()) == written.crc32
        except OSError:
            return False


def _chunks(texts: Iterable[str]) -> Iterator[bytes]:
    chunk: list[str] = []
    size = 0
    for text in texts:
        chunk.append(text)
        size += len(text)
        if size > _CHUNK_CHARACTERS:
            yield "".join(chunk).encode()
            chunk.clear()
            size = 0
    yield "".join(chunk).encode()


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, if missing. Raises RecordingError."""
    with writes(folder):
        folder.mkdir(parents=True, exist_ok=True)


def unwritable(path: Path, error: BaseException) -> RecordingError:
    """Return the RecordingError to raise when writing `path` failed with `error`."""
    reason = getattr(error, "strerror", None) or error
    return RecordingError(
        f"{path}: cannot be written ({reason}); everything before is kept. Free some space or choose another folder, "
        "then continue with --resume"
    )


@contextmanager
def writes(path: Path) -> Iterator[None]:
    """Raise `unwritable` for an OSError in the block."""
    try:
        yield
    except OSError as error:
        raise unwritable(path, error) from error


@contextmanager
def locked(root: Path) -> Iterator[None]:
    """Hold the writer's lock of a data set. Raises RecordingError if another process holds it.

    The kernel releases the lock (flock) when the last process that holds it ends. Forked workers hold it too, so the
    next attempt cannot start while workers of a killed one are still running.
    """
    path = root / WORK / _LOCK
    make_folder(path.parent)
    with writes(path):
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RecordingError(f"{root}: another `hil dataset` is writing here; wait for it, or end it") from None
        yield
    finally:
        os.close(file)
