"""The folder of a data set: its layout, files that are there whole or not at all, one writer at a time."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from isal.isal_zlib import crc32

from hil.signals.errors import RecordingError

ANNOTATIONS = "annotations"  # COCO
PREVIEW = "preview"
RECORDING = "run.mcap"
MANIFEST = "dataset.json"
CHECKSUMS = "checksums.csv"
JOURNAL = "journal.sqlite3"
WORK = ".work"  # gone when all is done
PART = ".part"  # ending of what is not yet whole
_LOCK = "lock"


class Written(NamedTuple):
    """A file of the tree and how to tell that it is whole. `path` is relative, with slashes."""

    path: str
    size: int
    crc32: int


class TreeWriter:
    """Puts files into a folder, each whole or not at all. Folders are made when they are needed."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._root = str(root)
        self._made: set[str] = set()

    def write(self, path: str, data: bytes) -> Written:
        """Raises RecordingError where it cannot be written; what was there before is then still there."""
        return self.write_parts(path, (data,))

    def write_parts(self, path: str, parts: Iterable[bytes]) -> Written:
        """The same, of a file that need not be in memory."""
        folder, _, name = path.rpartition("/")
        if folder not in self._made:
            make_folder(self.root / folder)
            self._made.add(folder)
        # Always the same name, so that what a kill left is written over by the next attempt.
        part = f"{self._root}/{folder}/.{name}{PART}"
        size = crc = 0
        try:
            with open(part, "wb") as file:
                for data in parts:
                    file.write(data)
                    size += len(data)
                    crc = crc32(data, crc)
            os.replace(part, f"{self._root}/{path}")
        except OSError as error:
            with contextlib.suppress(OSError):
                os.unlink(part)
            raise unwritable(self.root / path, error) from error
        return Written(path, size, crc)

    def holds(self, written: Written) -> bool:
        """Whether that file is there, byte for byte as far as its checksum tells."""
        try:
            with open(f"{self._root}/{written.path}", "rb", buffering=0) as file:
                if os.fstat(file.fileno()).st_size != written.size:
                    return False
                return crc32(file.readall()) == written.crc32
        except OSError:
            return False


def make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error


def unwritable(path: Path, error: BaseException) -> RecordingError:
    why = getattr(error, "strerror", None) or error
    return RecordingError(
        f"{path}: cannot be written ({why}); everything before is kept. Free some space or choose another folder, then "
        "go on with --resume"
    )


@contextmanager
def locked(root: Path) -> Iterator[None]:
    """One writer to a data set at a time. Raises RecordingError where somebody else is writing.

    The lock is the kernel's (flock), so it is gone with the last process that holds it. Workers that were forked hold
    it too: a folder whose workers are still at it cannot be taken by the next attempt.
    """
    path = root / WORK / _LOCK
    make_folder(path.parent)
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise unwritable(path, error) from error
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RecordingError(f"{root}: another `hil dataset` is writing here; wait for it, or end it") from None
        yield
    finally:
        os.close(file)
