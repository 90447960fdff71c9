"""What every way of flying by hand comes to: four stick positions, a dead-man switch and the buttons pressed."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from hil.signals.errors import HilError


class ManualControlError(HilError):
    """A stick mapping or a device's description of itself cannot be used."""


class StickLost(HilError):
    """The device with the sticks is gone, or what it sends can no longer be read."""


class Sticks(NamedTuple):
    """Positions -1..1: positive is nose down (forward), roll right, climb, nose right. Throttle 0 is the centre."""

    pitch: float
    roll: float
    throttle: float
    yaw: float


NEUTRAL = Sticks(0.0, 0.0, 0.0, 0.0)


class StickState(NamedTuple):
    """What a device says now. `held`: the dead-man switch; `pressed`: button numbers from 1, as the device counts."""

    sticks: Sticks
    held: bool
    pressed: frozenset[int]


class StickDevice(Protocol):
    """Whatever has sticks."""

    @property
    def name(self) -> str: ...

    def poll(self) -> StickState | None:
        """The newest state; None until the device has said anything. Never waits. StickLost when it is gone."""
        ...

    def close(self) -> None: ...
