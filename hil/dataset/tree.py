"""The folder of a data set: its layout, and files that are there whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from isal.isal_zlib import crc32

from hil.signals.errors import RecordingError

ASL = "mav0"
ANNOTATIONS = "annotations"  # COCO
PREVIEW = "preview"
RECORDING = "run.mcap"
MANIFEST = "dataset.json"
CHECKSUMS = "checksums.csv"
JOURNAL = "journal.bin"
WORK = ".work"  # gone when all is done
NURSERY = f"{WORK}/folders"  # where folders are before they have their names
PART = ".part"  # ending of what is not yet whole


class Written(NamedTuple):
    """A file of the tree and how to tell that it is whole. `path` is relative, with slashes."""

    path: str
    size: int
    crc32: int


# What an open says where there are no files without a name: by the file system, the kernel, a layer between.
_NO_NAMELESS = frozenset((errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL))


class TreeWriter:
    """Puts files into a folder, each whole or not at all. Folders are made when they are needed."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._root = str(root)
        self._made: set[str] = set()
        # A name at the end costs half of what a temporary name and another one after it do.
        self._nameless = hasattr(os, "O_TMPFILE") and os.path.isdir("/proc/self/fd")

    def write(self, path: str, data: bytes) -> Written:
        """Raises RecordingError where it cannot be written; what was there before is then still there."""
        return self.write_parts(path, (data,))

    def write_parts(self, path: str, parts: Iterable[bytes]) -> Written:
        """The same, of a file that need not be in memory."""
        folder, _, name = path.rpartition("/")
        if folder not in self._made:
            make_folder(self.root / folder)
            self._made.add(folder)
        inside = f"{self._root}/{folder}/" if folder else f"{self._root}/"
        part = f"{inside}.{name}{PART}"
        try:
            file = self._open(inside, part)
            size = crc = 0
            try:
                for data in parts:
                    count = len(data)
                    if (written := os.write(file, data)) != count:
                        _write_rest(file, memoryview(data)[written:])
                    size += count
                    crc = crc32(data, crc)
                self._name(file, part, inside + name)
            finally:
                os.close(file)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.unlink(part)
            raise unwritable(self.root / path, error) from error
        return Written(path, size, crc)

    def _open(self, folder: str, part: str) -> int:
        """A file without a name in the folder; `part` where there is no such thing."""
        if self._nameless:
            try:
                return os.open(folder, os.O_WRONLY | os.O_TMPFILE, 0o644)
            except OSError as error:
                if error.errno not in _NO_NAMELESS:
                    raise
                self._nameless = False
        return os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)

    def _name(self, file: int, part: str, name: str) -> None:
        """Name an open file that is whole. What had the name before goes in the same moment."""
        if self._nameless:
            this = f"/proc/self/fd/{file}"
            try:
                os.link(this, name, src_dir_fd=file, follow_symlinks=True)
                return
            except FileExistsError:
                pass
            except OSError:  # not allowed here, if the disk is not full
                self._nameless = False
            with open(this, "rb") as whole, open(part, "wb") as copy:
                shutil.copyfileobj(whole, copy)
        os.rename(part, name)

    def holds(self, written: Written) -> bool:
        """Whether that file is there, byte for byte as far as its checksum tells."""
        try:
            with open(f"{self.root}/{written.path}", "rb", buffering=0) as file:
                if os.fstat(file.fileno()).st_size != written.size:
                    return False
                return crc32(file.readall()) == written.crc32
        except OSError:
            return False


def _write_rest(file: int, view: memoryview) -> None:
    while view:
        view = view[os.write(file, view) :]


def make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error


def unwritable(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"{path}: cannot be written ({error.strerror or error}); everything before is kept. Free some space or choose "
        "another folder, then go on with --resume"
    )
