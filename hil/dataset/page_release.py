"""Giving back memory that the system keeps of what was written.

A data set is written once and not read again while it is made, yet the system keeps every page of it. On a virtual
machine a page never used before must be fetched from the host, which costs more than all the rest of writing it (2.2 ms
of CPU a megabyte where it was measured; 0.7 ms on pages just given back). So large pieces are sent to the disk as soon
as they stand in order, and forgotten a few batches later. It changes nothing of what is on the disk, or of when it is
known to be there (`hil.dataset.checkpoint`).
"""

from __future__ import annotations

import contextlib
import os
from collections import deque
from pathlib import Path

from hil.dataset.tree import Written

LEAST_BYTES = 1 << 16  # of a file: smaller ones cost as much to open again as they give
LATER = 8  # batches until what was sent to the disk is forgotten


class PageRelease:
    """Call `batch` for each, in order."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._waiting: deque[tuple[tuple[str, ...], int]] = deque()  # files, and from where the recording follows
        self._works = hasattr(os, "posix_fadvise")

    def batch(self, files: tuple[Written, ...], recording: int, start: int, end: int) -> None:
        """Its files, and where its part of the open file `recording` begins and ends."""
        if not self._works:
            return
        paths = tuple(f"{self._root}/{file.path}" for file in files if file.size >= LEAST_BYTES)
        for path in paths:
            _advise_file(path)
        old_start = start
        self._waiting.append((paths, start))
        if len(self._waiting) > LATER:
            old, old_start = self._waiting.popleft()
            for path in old:
                _advise_file(path)
        # Of pages on their way to the disk this begins the way, those that have arrived it drops.
        _advise(recording, old_start, end - old_start)


def _advise_file(path: str) -> None:
    with contextlib.suppress(OSError):  # it is advice: what cannot be followed is no error
        file = os.open(path, os.O_RDONLY)
        try:
            _advise(file, 0, 0)
        finally:
            os.close(file)


def _advise(file: int, offset: int, size: int) -> None:
    with contextlib.suppress(OSError):
        os.posix_fadvise(file, offset, size, os.POSIX_FADV_DONTNEED)
