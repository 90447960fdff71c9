"""One writer to a folder at a time, whoever was killed before.

The lock is the kernel's (flock), so it is gone with the last process that holds it. Workers that were forked hold it
too: a folder whose workers are still at it cannot be taken by the next attempt.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hil.dataset.tree import unwritable
from hil.signals.errors import RecordingError

LOCK_NAME = "lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Raises RecordingError where somebody else is writing."""
    path = folder / LOCK_NAME
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise unwritable(path, error) from error
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RecordingError(
                f"{folder.parent}: another `hil dataset` is writing here; wait for it, or end it"
            ) from None
        yield
    finally:
        os.close(file)
