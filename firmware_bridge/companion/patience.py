"""Whether to stay awake for what is about to come: going to sleep and being woken takes as long as a short answer."""

from __future__ import annotations

import os
import time

_AWAKE_NS = 300_000  # and no longer in vain
_CROWDED_NS = 15_000  # to get this core back after offering it to others: somebody else runs on it too
_BUSY_NS = 500_000  # the same of somebody who computes, and will want this core again
_BUSY_WAITS = 64  # that are then slept through: who yields to such a one has to wait for its whole slice
_SHORT_NS = 600_000  # a wait that was over by then was worth staying awake for, sleep and waking included


class Patience:
    """Of one that waits again and again. Awake only where the wait before was short, and another core is there for
    whom is waited for: a slow client costs nothing, a fast one some hundred microseconds of a core per frame."""

    def __init__(self) -> None:
        self._short = self._crowded = False
        self._asleep = 0  # waits to come that are slept through
        self._cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1

    def stays_awake(self, waited_ns: int) -> bool:
        """Whether to look again at once, after so long. Lets others go first who want this core."""
        if not self._short or self._crowded or self._asleep or waited_ns >= _AWAKE_NS or self._cores < 2:
            return False
        offered_ns = time.monotonic_ns()
        os.sched_yield()
        # Two that wait for each other on one core, both awake, would share it for ever: who sleeps can be moved.
        away_ns = time.monotonic_ns() - offered_ns
        self._crowded = away_ns > _CROWDED_NS
        if away_ns > _BUSY_NS:
            self._asleep = _BUSY_WAITS
        return True

    def waited(self, waited_ns: int) -> None:
        """How long it took in the end."""
        self._crowded = False
        self._asleep = max(0, self._asleep - 1)
        self._short = waited_ns < _SHORT_NS
