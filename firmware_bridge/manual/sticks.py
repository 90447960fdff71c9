"""The common result of all stick devices: four positions, a dead-man switch and the buttons pressed."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from signals.errors import HilError


class ManualControlError(HilError):
    """A stick mapping, or a device's own description, cannot be used."""


class StickLost(HilError):
    """The stick device is unplugged, or its reports can no longer be read."""


class Sticks(NamedTuple):
    """Positions -1..1: positive is nose down (forward), roll right, climb, nose right. Throttle 0 is the centre."""

    pitch: float
    roll: float
    throttle: float
    yaw: float


NEUTRAL = Sticks(0.0, 0.0, 0.0, 0.0)


class StickState(NamedTuple):
    """The present state of a device. `held`: the dead-man switch; `pressed`: button numbers from 1."""

    sticks: Sticks
    held: bool
    pressed: frozenset[int]


class StickDevice(Protocol):
    """A source of stick positions."""

    @property
    def name(self) -> str: ...

    def poll(self) -> StickState | None:
        """Return the newest state; None before the first report. Never waits. StickLost if it is unplugged."""
        ...

    def close(self) -> None: ...
