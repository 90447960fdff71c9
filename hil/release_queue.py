"""Samples between capture and arrival: a sensor's latency, delayed and out-of-order arrival, in one place."""

from __future__ import annotations

import heapq

from hil.signals.samples import Sample


class ReleaseQueue:
    """Holds captured samples until they arrive. Release order is (t_available_ns, port, seq): total and repeatable."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, str, int, Sample]] = []

    def push(self, port: str, sample: Sample) -> None:
        heapq.heappush(self._heap, (sample.t_available_ns, port, sample.seq, sample))

    def release(self, t_ns: int) -> list[tuple[str, Sample]]:
        """Every sample with t_available_ns <= t_ns, in release order."""
        heap = self._heap
        released = []
        while heap and heap[0][0] <= t_ns:
            _, port, _, sample = heapq.heappop(heap)
            released.append((port, sample))
        return released

    def __len__(self) -> int:
        return len(self._heap)
