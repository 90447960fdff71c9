"""Nobody may flood the bench while it is busy elsewhere: a thread that looks after all its sockets now and then.

One for all of them: each look takes Python's lock, which whoever waits for a frame's answer wants too.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Protocol

_LOOK_S = 0.02


class Watched(Protocol):
    """What can be looked after."""

    def look(self) -> None: ...


class Sentry:
    """Runs until it is closed, which comes before what it watches is."""

    def __init__(self, watched: Sequence[Watched]) -> None:
        self._watched = tuple(watched)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._keep_looking, name="companion sentry", daemon=True)
        self._thread.start()

    def _keep_looking(self) -> None:
        while not self._closing.wait(_LOOK_S):
            for one in self._watched:
                one.look()

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
