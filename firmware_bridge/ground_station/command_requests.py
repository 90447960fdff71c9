"""Sends single commands to the autopilot on request, one after the other, and tells the answers.

A function of (simulated time, frames received, requests), as the pilots are. It has a component id of its own, so that
its answers cannot be confused with theirs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.ground_station.commands import ACCEPTED, Commands
from firmware_bridge.ground_station.modes import mode_params
from firmware_bridge.ground_station.vehicle_link import VehicleLink, enum_name
from signals.errors import HandshakeError

_COMPID = 28  # MAV_COMP_ID_USER4, which ground stations and SDKs do not use
_DO_SET_MODE = 176
_COMPONENT_ARM_DISARM = 400
_MOST_WAITING = 16

Answered = Callable[[str], None]  # gets "" for an accepted command, otherwise why it was not


class _Request(NamedTuple):
    command: int
    params: Callable[[int, int], tuple[float, ...]]  # of the autopilot (MAV_AUTOPILOT) and the vehicle (MAV_TYPE)
    answered: Answered


class CommandRequests:
    """Command source of a run. Set-points and phases are the pilot's."""

    def __init__(self) -> None:
        self._link = VehicleLink(target_sysid=None, compid=_COMPID)
        self._commands = Commands(self._link)
        self._waiting: deque[_Request] = deque()
        self._running: _Request | None = None
        self._autopilot: int | None = None
        self._vehicle_type = 0
        self._t_ns = 0
        self._handlers: dict[int, Callable[[Any], None]] = {
            MSGID["HEARTBEAT"]: self._on_heartbeat,
            MSGID["COMMAND_ACK"]: lambda m: self._commands.on_ack(self._t_ns, m),
        }

    def arm(self, armed: bool, answered: Answered) -> None:
        """Arm or disarm."""
        self._ask(_Request(_COMPONENT_ARM_DISARM, lambda *_: (float(armed),), answered))

    def set_mode(self, word: str, answered: Answered) -> None:
        """Change to a mode of `modes.WORDS`."""
        self._ask(_Request(_DO_SET_MODE, lambda autopilot, kind: mode_params(autopilot, word, kind), answered))

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Take last tick's `frames`. Return the bytes to send at `t_ns`."""
        self._t_ns = t_ns
        self._link.dispatch(frames, self._handlers)
        if self._running is not None:
            self._await_answer(t_ns, self._running)
        if self._running is None and self._waiting and self._autopilot is not None:
            request = self._waiting.popleft()
            try:
                self._commands.send(t_ns, request.command, request.params(self._autopilot, self._vehicle_type))
                self._running = request
            except HandshakeError as error:  # no such mode
                request.answered(str(error))
        return self._link.take()

    def _ask(self, request: _Request) -> None:
        if len(self._waiting) >= _MOST_WAITING:
            request.answered(f"{_MOST_WAITING} commands are waiting already")
            return
        self._waiting.append(request)

    def _await_answer(self, t_ns: int, request: _Request) -> None:
        commands = self._commands
        if commands.busy:
            try:
                commands.step(t_ns)
            except HandshakeError as error:
                commands.drop()
                self._running = None
                request.answered(str(error))
            return
        self._running = None
        result = commands.result
        accepted = result == ACCEPTED
        request.answered("" if accepted else f"the autopilot answered {enum_name('MAV_RESULT', result or 0)}")

    def _on_heartbeat(self, message: Any) -> None:
        self._autopilot, self._vehicle_type = message.autopilot, message.type
