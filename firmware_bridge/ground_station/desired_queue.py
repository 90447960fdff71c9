"""Desired states on their way: each takes effect at its simulated time, and stays until the next one does."""

from __future__ import annotations

import heapq
from typing import NamedTuple

from hil.signals.desired import DesiredState


class Applied(NamedTuple):
    """A desired state, from when on it counts, and the time that it speaks of [ns]."""

    t_apply_ns: int
    desired: DesiredState
    t_of_ns: int


class DesiredQueue:
    """Keeps those to come and the one that counts."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, DesiredState, int]] = []
        self._puts = 0
        self.current: Applied | None = None

    @property
    def next_ns(self) -> int | None:
        """When the next one takes effect; None if none waits."""
        return self._heap[0][0] if self._heap else None

    def put(self, desired: DesiredState, t_apply_ns: int, t_of_ns: int) -> None:
        """Of two for the same time the one put later counts; one for an earlier time than what counts is too late."""
        heapq.heappush(self._heap, (t_apply_ns, self._puts, desired, t_of_ns))
        self._puts += 1

    def advance(self, t_ns: int) -> None:
        """Make `current` the newest that applies at `t_ns`."""
        heap = self._heap
        while heap and heap[0][0] <= t_ns:
            t_apply_ns, _, desired, t_of_ns = heapq.heappop(heap)
            if self.current is None or t_apply_ns >= self.current.t_apply_ns:
                self.current = Applied(t_apply_ns, desired, t_of_ns)
