"""Whether to stay awake for what is about to come: going to sleep and being woken takes as long as a short answer."""

from __future__ import annotations

import os
import time

AWAKE_S = 300e-6  # and no longer in vain
CROWDED_S = 15e-6  # to get this core back after offering it to others: somebody else runs on it too
BUSY_S = 500e-6  # the same of somebody who computes, and will want this core again
BUSY_WAITS = 64  # that are then slept through: who yields to such a one has to wait for its whole slice
SHORT_S = 600e-6  # a wait that was over by then was worth staying awake for, sleep and waking included


class Patience:
    """Of one that waits again and again. Awake only where the wait before was short, and another core is there for
    whom is waited for."""

    def __init__(self) -> None:
        self._short = self._crowded = False
        self._asleep = 0  # waits to come that are slept through
        self._possible = hasattr(os, "sched_getaffinity") and len(os.sched_getaffinity(0)) > 1

    def stays_awake(self, waited_s: float, *, begun: bool = False) -> bool:
        """Whether to look again at once, after so long. Lets others go first who want this core. `begun`: part of what
        is waited for is here, so that the rest cannot be far."""
        if not (self._short or begun) or self._crowded or self._asleep or waited_s >= AWAKE_S or not self._possible:
            return False
        offered_s = time.perf_counter()
        os.sched_yield()
        # Two that wait for each other on one core, both awake, would share it for ever: who sleeps can be moved.
        away_s = time.perf_counter() - offered_s
        self._crowded = away_s > CROWDED_S
        if away_s > BUSY_S:
            self._asleep = BUSY_WAITS
        return True

    def waited(self, waited_s: float) -> None:
        """How long it took in the end."""
        self._crowded = False
        self._asleep = max(0, self._asleep - 1)
        self._short = waited_s < SHORT_S
