"""Numbers of the flights that run on this machine at the same time, whatever campaign or node they belong to.

The number keeps the ports of simulated autopilots apart, and gives each flight processors of its own. It is held by a
lock on a file (flock), which the kernel releases when the process ends.
"""

from __future__ import annotations

import fcntl
import os

from hil.cluster.trees import user_folder
from signals.errors import RecordingError, file_errors

_MOST = 1024


class FlightNumber:
    """The lowest free number on this machine, held until `free`."""

    def __init__(self) -> None:
        """Raises RecordingError."""
        folder = user_folder() / "slots"
        with file_errors(folder, "cannot be used for locks", hint="; set TMPDIR"):
            folder.mkdir(exist_ok=True)
            for number in range(_MOST):
                self._file = os.open(folder / str(number), os.O_RDWR | os.O_CREAT, 0o600)
                try:
                    fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    os.close(self._file)
                    continue
                self.number = number
                return
        raise RecordingError(f"{_MOST} flights run on this machine already")

    def free(self) -> None:
        """Give the number back."""
        os.close(self._file)
