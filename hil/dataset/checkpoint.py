"""Making sure that what was written is on the disk, beside the work and not in its way.

A checkpoint is: sync the file system, then append to the tables the rows of what was written before the sync. One is
under way at a time, on a thread of its own.
"""

from __future__ import annotations

import ctypes
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

from hil.dataset.tree import unwritable
from hil.signals.errors import RecordingError

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
    """Call `maybe` after every batch, `finish` at the end."""

    def __init__(self, folder: Path, *, period_s: float = PERIOD_S, sync: Callable[[Path], None] = sync_file_system):
        self._folder, self._period_s, self._sync = folder, period_s, sync
        self._next_s = time.monotonic() + period_s
        self._thread: threading.Thread | None = None
        self._error: RecordingError | None = None

    def maybe(self, prepare: Callable[[], Callable[[], None]]) -> None:
        """`prepare` says what is to be done after a sync that begins now; asked only where one is due. RecordingError:
        what an earlier one has met."""
        if time.monotonic() < self._next_s or (self._thread is not None and self._thread.is_alive()):
            return
        self._join()
        self._thread = threading.Thread(target=self._run, args=(prepare(),), name="hil-dataset-sync")
        self._thread.start()
        self._next_s = time.monotonic() + self._period_s

    def finish(self, prepare: Callable[[], Callable[[], None]]) -> None:
        """A last one, waited for."""
        self._join()
        self._run(prepare())
        self._join()

    def _run(self, after: Callable[[], None]) -> None:
        try:
            self._sync(self._folder)
            after()
        except RecordingError as error:
            self._error = error

    def _join(self) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._error is not None:
            error, self._error = self._error, None
            raise error
