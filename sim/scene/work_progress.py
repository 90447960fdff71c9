"""Progress of work in the process with limits (limited_process.py), for a display of the bench.

The work tells what it does; the process writes that to a file, at most ten times a second, which the bench reads while
it waits. Without a display nothing is written.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

FILE = "progress.txt"
_PERIOD_S = 0.1


class State(NamedTuple):
    """`done` of `total` things are done; a total of 0 is unknown."""

    what: str
    done: int = 0
    total: int = 0


class WorkProgress:
    """Report of the work of this process. `display`: begins a display with a title, and returns what shows a state."""

    def __init__(self) -> None:
        self.display: Callable[[str], AbstractContextManager[Callable[[State], None]]] | None = None
        self._file: Path | None = None
        self._next_s = 0.0

    def write_to(self, folder: Path) -> None:
        """Write what is told from now on to a file in a folder."""
        self._file = folder / FILE

    def tell(self, what: str, done: int = 0, total: int = 0) -> None:
        """Tell what is done now; calls within the period are ignored."""
        if self._file is None or time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + _PERIOD_S
        with contextlib.suppress(OSError):
            self._file.write_text(f"{done} {total} {what}\n", encoding="utf-8")


progress = WorkProgress()


def read_state(folder: Path, otherwise: str) -> State:
    """Return what was told last; a state named `otherwise` if nothing was."""
    with contextlib.suppress(OSError, ValueError):
        done, total, what = (folder / FILE).read_text(encoding="utf-8").strip().split(" ", 2)
        return State(what, int(done), int(total))
    return State(otherwise)
