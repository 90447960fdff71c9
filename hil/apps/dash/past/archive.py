"""A run's folder as one ZIP file, made while it is sent: a recording may be larger than the memory."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer

_PIECE_BYTES = 1 << 20


class _Pieces(io.RawIOBase):
    """The bytes written since the last `take`."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Buffer, /) -> int:
        self._pieces.append(bytes(data))
        return len(self._pieces[-1])

    def take(self) -> bytes:
        data = b"".join(self._pieces)
        self._pieces.clear()
        return data


def zipped(folder: Path) -> Iterator[bytes]:
    """Yield the pieces of a ZIP of all files below `folder`, with its name before theirs, in the order of their names.

    Nothing is compressed: recordings and pictures already are. Links are left out: they may lead outside. A file that
    grows meanwhile is cut where it ended when its turn came.
    """
    out = _Pieces()
    with zipfile.ZipFile(out, "w", allowZip64=True) as archive:
        for path in sorted(folder.rglob("*")):
            if not _inside(path, folder):
                continue
            try:
                file = path.open("rb")
            except OSError:  # gone meanwhile
                continue
            with file:
                left = path.stat().st_size
                entry = zipfile.ZipInfo.from_file(
                    path, f"{folder.name}/{path.relative_to(folder)}", strict_timestamps=False
                )
                with archive.open(entry, "w", force_zip64=True) as member:
                    while left > 0 and (piece := file.read(min(_PIECE_BYTES, left))):
                        left -= len(piece)
                        member.write(piece)
                        yield out.take()
    yield out.take()


def _inside(path: Path, folder: Path) -> bool:
    """Return True for a plain file that is reached without a link."""
    if not path.is_file():
        return False
    return not any(part.is_symlink() for part in (path, *path.parents[: len(path.relative_to(folder).parts) - 1]))
