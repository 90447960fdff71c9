"""Random numbers of a map: a named stream read in order.

Each feature of a map (trees, people, houses) rolls its own dice, so a change to one leaves the others where they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from hil.signals.noise import NoiseStream

T = TypeVar("T")


class Dice:
    """Uniform draws of stream `map.<name>` under `seed`, one after the other."""

    def __init__(self, seed: int, name: str) -> None:
        self._stream = NoiseStream(seed, f"map.{name}")
        self._block: list[float] = []
        self._next_block = 0

    def unit(self) -> float:
        """On (0, 1)."""
        if not self._block:
            self._block = self._stream.uniform_block(self._next_block)[::-1, 0].tolist()
            self._next_block += 1
        return self._block.pop()

    def between(self, low: float, high: float) -> float:
        return low + (high - low) * self.unit()

    def index(self, count: int) -> int:
        """Whole number in 0 .. count-1."""
        return min(int(self.unit() * count), count - 1)

    def pick(self, options: Sequence[T]) -> T:
        return options[self.index(len(options))]

    def chance(self, probability: float) -> bool:
        return self.unit() < probability

    def shuffled(self, items: Sequence[T]) -> list[T]:
        result = list(items)
        for i in range(len(result) - 1, 0, -1):
            j = self.index(i + 1)
            result[i], result[j] = result[j], result[i]
        return result
