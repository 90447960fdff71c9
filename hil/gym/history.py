"""Start of each present episode of a batch, and the actions since: they are flown again in a copy of the environment.

An episode is a pure function of the random numbers at its start and of its actions, so this is all of its state.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

_FORGET_AT = 1024  # steps of no present episode that are kept at most


class History:
    """Present episodes of a batch."""

    def __init__(self, count: int) -> None:
        self._random: list[Any] = [None] * count  # state of the generator before the episode; None: never begun
        self._begun = [0] * count  # step at which each episode began
        self._actions: list[tuple[NDArray[np.float64], NDArray[np.bool_]]] = []
        self._first = 0  # step of the first of `_actions`

    def begin(self, row: int, random: np.random.Generator) -> None:
        """An episode begins, with these random numbers."""
        self._random[row] = (type(random.bit_generator), random.bit_generator.state)
        self._begun[row] = self._first + len(self._actions)
        unused = min(self._begun) - self._first
        if unused >= _FORGET_AT or unused == len(self._actions):
            del self._actions[:unused]
            self._first += unused

    def add(self, actions: NDArray[np.float64], flies: NDArray[np.bool_]) -> None:
        """A step is flown. The arrays must not change afterwards."""
        self._actions.append((actions, flies))

    def copy(self) -> History:
        """Return a history that goes on by itself."""
        other = History(0)
        other._random, other._begun = list(self._random), list(self._begun)
        other._actions, other._first = list(self._actions), self._first
        return other

    def starts(self) -> list[np.random.Generator | None]:
        """Return the random numbers at the start of each episode, in generators of their own."""
        generators: list[np.random.Generator | None] = []
        for stored in self._random:
            if stored is None:
                generators.append(None)
                continue
            kind, state = stored
            bits = kind()
            bits.state = state
            generators.append(np.random.Generator(bits))
        return generators

    def steps(self) -> Iterator[tuple[NDArray[np.float64], NDArray[np.bool_]]]:
        """Yield the steps: actions, and which vehicles fly them in their present episode."""
        begun = np.array(self._begun)
        for step, (actions, flies) in enumerate(self._actions, self._first):
            yield actions, flies & (begun <= step)
