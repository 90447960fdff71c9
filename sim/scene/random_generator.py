"""Random numbers of a scene: named streams of uniform draws, read in order.

Each feature (trees, people, houses, light) has its own generator, so that a change to one leaves the others as they
are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

from signals._kernel import det_pow
from signals.noise import NoiseStream

T = TypeVar("T")


class RandomGenerator:
    """Uniform draws of stream `map.<name>` under `seed`, one after the other."""

    def __init__(self, seed: int, name: str) -> None:
        self._seed, self._name = seed, name
        self._stream = NoiseStream(seed, f"map.{name}")
        self._block: list[float] = []
        self._next_block = 0

    def unit(self) -> float:
        """Draw evenly on (0, 1)."""
        if not self._block:
            self._block = self._stream.uniform_block(self._next_block)[::-1, 0].tolist()
            self._next_block += 1
        return self._block.pop()

    def branch(self, name: str) -> RandomGenerator:
        """Return a generator of its own under the same seed; draws from one do not change the other's."""
        return RandomGenerator(self._seed, f"{self._name}.{name}")

    def between(self, low: float, high: float) -> float:
        """Draw evenly on (low, high)."""
        return low + (high - low) * self.unit()

    def log_between(self, low: float, high: float) -> float:
        """Draw evenly in the logarithm: 1 to 10 is as likely as 10 to 100. Both limits are above 0."""
        value = low * det_pow(high / low, self.unit())
        return min(max(value, low), high)

    def index(self, count: int) -> int:
        """Draw a whole number in 0 .. count-1."""
        return min(int(self.unit() * count), count - 1)

    def pick(self, options: Sequence[T]) -> T:
        """Draw one of `options`, each as likely as the others."""
        return options[self.index(len(options))]

    def weighted(self, options: Mapping[T, float]) -> T:
        """Draw one of `options` by their weights."""
        return weighted_pick(options, self.unit())

    def chance(self, probability: float) -> bool:
        """Return True with this probability."""
        return self.unit() < probability

    def shuffled(self, items: Sequence[T]) -> list[T]:
        """Return the items in a random order (Fisher-Yates)."""
        result = list(items)
        for i in range(len(result) - 1, 0, -1):
            j = self.index(i + 1)
            result[i], result[j] = result[j], result[i]
        return result


def weighted_pick(options: Mapping[T, float], share: float) -> T:
    """Return the option at `share` (0 to 1) of the sum of all weights."""
    left = share * sum(options.values())
    for option, weight in options.items():
        left -= weight
        if left < 0.0:
            return option
    return list(options)[-1]


def feature_rng(seed: int, feature: str, *names: object) -> RandomGenerator:
    """Return the generator of a feature of `randomize`, or of one surface, person or sensor named in `names`."""
    return RandomGenerator(seed, ".".join(("randomize", feature, *map(str, names))))
