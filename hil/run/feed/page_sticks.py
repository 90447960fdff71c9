"""Stick positions and buttons from the page. Each message is valid for 0.4 s.

The dead-man switch counts as held only while the page repeats the message that it is held. A page that is closed, loses
its network or moves to the background therefore releases the switch.

The time counts where messages are looked for (`listened`): a tick that takes half a second on a loaded machine leaves
the messages of the page unread, and is no reason to release.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from firmware_bridge.manual.manual_control import Buttons
from firmware_bridge.manual.sticks import NEUTRAL, Sticks, StickState
from hil.run.feed.messages import is_number

_MESSAGE_VALID_NS = 400_000_000  # wall clock; the page sends a message every 50 ms while the switch is held
_PRESS_NS = 250_000_000

# Requests to the autopilot that the page has buttons for; `Buttons` numbers them from 1.
REQUESTS = ("arm", "disarm", "position", "altitude", "stabilized", "hold", "return", "land", "mission")


def page_buttons(modes: Mapping[str, Any]) -> Buttons:
    """Return the page's buttons, limited to the modes that this autopilot has."""
    mode_buttons = {number: name for number, name in enumerate(REQUESTS, start=1) if number > 2 and name in modes}
    return Buttons(arm=1, disarm=2, modes=mode_buttons)


class PageSticks:
    """A `StickDevice` that the page moves. It uses wall-clock time, as a pilot does."""

    name = "dashboard"

    def __init__(self, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._clock_ns = clock_ns
        self._now_ns = 0  # when messages were looked for last
        self._sticks = NEUTRAL
        self._held_until_ns = 0
        self._pressed: dict[int, int] = {}  # button -> end of the press [ns]

    def move(self, message: Mapping[str, Any]) -> None:
        """Take a message of the page: `axes` [pitch, roll, throttle, yaw], `held`, and optionally `ask` (a request)."""
        axes = message.get("axes")
        now_ns = self._now_ns = self._clock_ns()
        held = message.get("held") is True
        self._held_until_ns = now_ns + _MESSAGE_VALID_NS if held else now_ns
        if held and isinstance(axes, list | tuple) and len(axes) == 4 and all(is_number(axis) for axis in axes):
            self._sticks = Sticks(*(max(-1.0, min(1.0, float(axis))) for axis in axes))
        elif not held:
            self._sticks = NEUTRAL
        request = message.get("ask")
        if request in REQUESTS:
            self._pressed[REQUESTS.index(request) + 1] = now_ns + _PRESS_NS

    def listened(self) -> None:
        """Take notice that all messages which have arrived were given to `move`."""
        self._now_ns = self._clock_ns()

    @property
    def held(self) -> bool:
        return self._now_ns < self._held_until_ns

    def poll(self) -> StickState | None:
        held = self.held
        self._pressed = {button: end_ns for button, end_ns in self._pressed.items() if self._now_ns < end_ns}
        return StickState(self._sticks if held else NEUTRAL, held, frozenset(self._pressed))

    def close(self) -> None:
        """Do nothing: there is no device to release."""
