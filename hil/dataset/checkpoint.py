"""Making sure that what was written is on the disk, beside the work and not in its way.

A checkpoint is: sync the file system, then append to the tables the rows of what was written before the sync. One is
under way at a time, on a thread of its own.
"""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from hil.dataset.tables import Tables
from hil.dataset.tree import unwritable

PERIOD_S = 2.0  # of wall-clock time: about what a power cut can take from the tables


def sync_file_system(folder: Path) -> None:
    """Everything on the file system that `folder` is on. RecordingError where the disk says no."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            syncfs = getattr(ctypes.CDLL(None, use_errno=True), "syncfs", None)
            if syncfs is None:
                os.sync()
            elif syncfs(descriptor) != 0:
                error = ctypes.get_errno()
                raise OSError(error, os.strerror(error))
        finally:
            os.close(descriptor)
    except OSError as error:
        raise unwritable(folder, error) from error


class Checkpoints:
    """Call `maybe` after every batch, `finish` at the end. Both raise RecordingError of what an earlier one met."""

    def __init__(
        self,
        folder: Path,
        tables: Tables,
        *,
        period_s: float = PERIOD_S,
        sync: Callable[[Path], None] = sync_file_system,
    ) -> None:
        self._folder, self._tables, self._period_s, self._sync = folder, tables, period_s, sync
        self._next_s = time.monotonic() + period_s
        self._thread = ThreadPoolExecutor(1, "hil-dataset-sync")
        self._under_way: Future[None] | None = None

    def maybe(self) -> None:
        """Begin one, if it is time and none is under way."""
        if time.monotonic() < self._next_s or (self._under_way is not None and not self._under_way.done()):
            return
        self._join()
        self._under_way = self._thread.submit(self._run, self._tables.take())
        self._next_s = time.monotonic() + self._period_s

    def finish(self) -> None:
        """A last one, waited for."""
        self._join()
        self._run(self._tables.take())

    def close(self) -> None:
        """End the thread; idempotent."""
        self._thread.shutdown()

    def _run(self, rows: Mapping[str, str]) -> None:
        self._sync(self._folder)
        self._tables.write_out(rows)

    def _join(self) -> None:
        if self._under_way is not None:
            under_way, self._under_way = self._under_way, None
            under_way.result()
