"""Whether to stay awake for what is about to come: going to sleep and being woken takes as long as a short answer."""

from __future__ import annotations

import os
import time

AWAKE_S = 300e-6  # and no longer in vain
CROWDED_S = 15e-6  # to get this core back after offering it to others: somebody else runs on it too
SHORT_S = 600e-6  # a wait that was over by then was worth staying awake for, sleep and waking included


class Patience:
    """Of one that waits again and again. Awake only where the wait before was short, and another core is there for
    whom is waited for."""

    def __init__(self) -> None:
        self._short = self._crowded = False
        self._possible = hasattr(os, "sched_getaffinity") and len(os.sched_getaffinity(0)) > 1

    def stays_awake(self, waited_s: float, *, begun: bool = False) -> bool:
        """Whether to look again at once, after so long. Lets others go first who want this core. `begun`: part of what
        is waited for is here, so that the rest cannot be far."""
        if not (self._short or begun) or self._crowded or waited_s >= AWAKE_S or not self._possible:
            return False
        offered_s = time.perf_counter()
        os.sched_yield()
        # Two that wait for each other on one core, both awake, would share it for ever: who sleeps can be moved.
        self._crowded = time.perf_counter() - offered_s > CROWDED_S
        return True

    def waited(self, waited_s: float) -> None:
        """How long it took in the end."""
        self._crowded = False
        self._short = waited_s < SHORT_S
