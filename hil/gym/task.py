"""Interface of a task. Arrays have a row for each vehicle of the batch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray

from hil.config import Bench
from hil.gym.flight import Flight
from hil.gym.options import FlightOptions
from signals.samples import Vec3

Rewards = NDArray[np.float64]
Ends = NDArray[np.bool_]


class Step(NamedTuple):
    """One step of a batch."""

    actions: NDArray[np.float64]  # a row for each vehicle
    flies: Ends  # False: begins an episode
    observations: Any  # after the step
    crashed: Ends  # contact in any tick of the action, or beyond the range of the model


class Task(ABC):
    """Task of a batch of flights."""

    Options: ClassVar[type[FlightOptions]] = FlightOptions
    bench: ClassVar[str | None] = None  # default bench file in rigs/benches; None: that of the working directory
    observation_space: Space[Any]  # of one vehicle

    @classmethod
    def ports(cls, bench: Bench, options: Any) -> tuple[str, ...]:  # noqa: ARG003 (for those that observe ports)
        """Return the ports that the flights observe."""
        return ()

    @abstractmethod
    def __init__(self, flights: Sequence[Flight], options: Any, name: str) -> None:
        """`name`: that of the environment, for messages."""

    @abstractmethod
    def begin(self, row: int, flight: Flight, random: np.random.Generator) -> None:
        """Begin an episode of one vehicle, which is at the start of its bench at tick 0: put it to its start.

        The flight may be another than before, in another map. The task calls `flight.begin`.
        """

    @abstractmethod
    def observe(self) -> Any:
        """Return new observations of all vehicles: an array, or a dictionary of arrays."""

    @abstractmethod
    def judge(self, step: Step) -> tuple[Rewards, Ends]:
        """Return reward and termination of a step; rows of vehicles that have not flown mean nothing."""

    def judge_alone(self, step: Step) -> tuple[float, bool]:
        """Return what `judge` does for a batch of one, as numbers."""
        rewards, ends = self.judge(step)
        return float(rewards[0]), bool(ends[0])

    def info(self) -> dict[str, NDArray[Any]]:
        """Return what `info` has at every step, a value for each vehicle."""
        return {}

    def info_of(self, row: int) -> dict[str, Any]:
        """Return `info` of one vehicle in a new dictionary, as plain numbers."""
        return {name: value[row].item() for name, value in self.info().items()}

    def marks(self, row: int) -> Sequence[Vec3]:  # noqa: ARG002 (for those that have some)
        """Return places in W that a picture of the vehicle shows."""
        return ()


def seed_of(random: np.random.Generator) -> int:
    """Return a seed of the noise of an episode."""
    return int(random.integers(2**63 - 1))
