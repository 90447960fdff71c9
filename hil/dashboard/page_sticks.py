"""Sticks held in the page: the newest that came over the wire, good only for a moment.

The dead-man switch is held as long as the page says so, and says so again and again: a page that is closed, loses its
network or is no longer in front counts as a hand that let go.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from firmware_bridge.manual.manual_control import Buttons
from firmware_bridge.manual.sticks import NEUTRAL, Sticks, StickState
from hil.dashboard.wire import is_number

_HOLD_NS = 400_000_000  # wall clock; the page repeats itself every 50 ms while the switch is held
_PRESS_NS = 250_000_000

# What the page's buttons ask of the autopilot, numbered as `Buttons` wants them.
ASKS = ("arm", "disarm", "position", "altitude", "stabilized", "hold", "return", "land", "mission")


def page_buttons(modes: Mapping[str, Any]) -> Buttons:
    """The buttons, with those modes that this autopilot has."""
    numbered = {number: name for number, name in enumerate(ASKS, start=1) if number > 2 and name in modes}
    return Buttons(arm=1, disarm=2, modes=numbered)


class PageSticks:
    """A `StickDevice` that the page moves. Wall time: fingers are not simulated."""

    name = "dashboard"

    def __init__(self, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._clock_ns = clock_ns
        self._sticks = NEUTRAL
        self._held_until_ns = 0
        self._pressed: dict[int, int] = {}  # button -> until

    def move(self, message: Mapping[str, Any]) -> None:
        """What the page says: `axes` [pitch, roll, throttle, yaw], `held`, and perhaps `ask`, one of ASKS."""
        axes = message.get("axes")
        now_ns = self._clock_ns()
        held = message.get("held") is True
        self._held_until_ns = now_ns + _HOLD_NS if held else now_ns
        if held and isinstance(axes, list | tuple) and len(axes) == 4 and all(is_number(axis) for axis in axes):
            self._sticks = Sticks(*(max(-1.0, min(1.0, float(axis))) for axis in axes))
        elif not held:
            self._sticks = NEUTRAL
        ask = message.get("ask")
        if ask in ASKS:
            self._pressed[ASKS.index(ask) + 1] = now_ns + _PRESS_NS

    @property
    def held(self) -> bool:
        return self._clock_ns() < self._held_until_ns

    def poll(self) -> StickState | None:
        now_ns = self._clock_ns()
        held = now_ns < self._held_until_ns
        self._pressed = {button: until for button, until in self._pressed.items() if now_ns < until}
        return StickState(self._sticks if held else NEUTRAL, held, frozenset(self._pressed))

    def close(self) -> None:
        """Nothing to give back."""
