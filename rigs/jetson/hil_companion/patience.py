"""Whether to stay awake for what is about to come: going to sleep and being woken takes as long as a short answer."""

from __future__ import annotations

import os

AWAKE_S = 300e-6  # and no longer in vain
SHORT_S = 600e-6  # a wait that was over by then was worth staying awake for, sleep and waking included


class Patience:
    """Of one that waits again and again. Awake only where the wait before was short, and another core is there for
    whom is waited for."""

    def __init__(self) -> None:
        self._short = False
        self._possible = hasattr(os, "sched_getaffinity") and len(os.sched_getaffinity(0)) > 1

    def stays_awake(self, waited_s: float) -> bool:
        """Whether to look again at once, after so long. Lets others go first who want this core."""
        if not self._short or waited_s >= AWAKE_S or not self._possible:
            return False
        os.sched_yield()
        return True

    def waited(self, waited_s: float) -> None:
        """How long it took in the end."""
        self._short = waited_s < SHORT_S
