"""The command protocol (https://mavlink.io/en/services/command.html): send, wait for the answer, repeat."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.vehicle_link import VehicleLink, enum_name, refused
from signals.time import NS_PER_S

_CommandLong = message_class("COMMAND_LONG")

ACCEPTED = 0
TEMPORARILY_REJECTED = 1
FAILED = 4
IN_PROGRESS = 5

_ANSWER_LIMIT_NS = NS_PER_S


class Commands:
    """One COMMAND_LONG at a time, sent up to `tries` times. `result` is None while it runs, then its MAV_RESULT."""

    def __init__(self, link: VehicleLink, *, tries: int = 5) -> None:
        self._link = link
        self._max_tries = tries
        self._command = 0
        self._params: tuple[float, ...] = ()
        self._tries = 0
        self.due_ns: int | None = None  # when the answer is overdue; None if no command is under way
        self.result: int | None = None

    @property
    def busy(self) -> bool:
        return self.due_ns is not None

    def send(self, t_ns: int, command: int, params: Sequence[float]) -> None:
        """Send `command` (MAV_CMD) with up to seven parameters; the others are zero."""
        self._command = command
        self._params = (*params, *(0.0,) * (7 - len(params)))
        self._tries = 0
        self.result = None
        self._transmit(t_ns)

    def drop(self) -> None:
        """Stop waiting for an answer."""
        self.due_ns = self.result = None

    def _transmit(self, t_ns: int) -> None:
        link = self._link
        self._link.send(_CommandLong(link.target_sysid, link.target_compid, self._command, self._tries, *self._params))
        self._tries += 1
        self.due_ns = t_ns + _ANSWER_LIMIT_NS

    def on_ack(self, t_ns: int, message: Any) -> None:
        if self.due_ns is None or message.command != self._command or not self._link.is_for_us(message):
            return
        if message.result == IN_PROGRESS:
            self.due_ns = t_ns + 10 * _ANSWER_LIMIT_NS
            return
        self.result = message.result
        self.due_ns = None

    def step(self, t_ns: int) -> None:
        """Send again if the answer is overdue. HandshakeError after the last try."""
        if self.due_ns is None or t_ns < self.due_ns:
            return
        if self._tries >= self._max_tries:
            raise refused(
                f"{enum_name('MAV_CMD', self._command)} was sent {self._max_tries} times without an answer; "
                "is the autopilot's MAVLink command service running?"
            )
        self._transmit(t_ns)
