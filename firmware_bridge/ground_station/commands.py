"""The command protocol (https://mavlink.io/en/services/command.html): ask, wait for the answer, ask again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.wire import Wire, enum_name, refused
from hil.signals.time import NS_PER_S

_CommandLong = message_class("COMMAND_LONG")

ACCEPTED = 0
TEMPORARILY_REJECTED = 1
FAILED = 4
IN_PROGRESS = 5

_ANSWER_LIMIT_NS = NS_PER_S


class Commands:
    """One COMMAND_LONG at a time, asked `tries` times. `result` is None while it runs, then its MAV_RESULT."""

    def __init__(self, wire: Wire, *, tries: int = 5) -> None:
        self._wire = wire
        self._most_tries = tries
        self._command = 0
        self._params: tuple[float, ...] = ()
        self._tries = 0
        self.due_ns: int | None = None  # when the answer is overdue; None if nothing is asked
        self.result: int | None = None

    @property
    def busy(self) -> bool:
        return self.due_ns is not None

    def ask(self, t_ns: int, command: int, params: Sequence[float]) -> None:
        """Send `command` (MAV_CMD) with up to seven parameters; the others are zero."""
        self._command = command
        self._params = (*params, *(0.0,) * (7 - len(params)))
        self._tries = 0
        self.result = None
        self._send(t_ns)

    def drop(self) -> None:
        """Wait for no answer any more."""
        self.due_ns = self.result = None

    def _send(self, t_ns: int) -> None:
        wire = self._wire
        self._wire.say(_CommandLong(wire.target_sysid, wire.target_compid, self._command, self._tries, *self._params))
        self._tries += 1
        self.due_ns = t_ns + _ANSWER_LIMIT_NS

    def on_ack(self, t_ns: int, message: Any) -> None:
        if self.due_ns is None or message.command != self._command or not self._wire.for_us(message):
            return
        if message.result == IN_PROGRESS:
            self.due_ns = t_ns + 10 * _ANSWER_LIMIT_NS
            return
        self.result = message.result
        self.due_ns = None

    def step(self, t_ns: int) -> None:
        """Ask again if the answer is overdue. HandshakeError when asking has not helped."""
        if self.due_ns is None or t_ns < self.due_ns:
            return
        if self._tries >= self._most_tries:
            raise refused(
                f"{enum_name('MAV_CMD', self._command)} was asked {self._most_tries} times and never answered; "
                "is the autopilot's MAVLink command service running?"
            )
        self._send(t_ns)
