"""Restarts a board in HITL that has flown since its last boot: its estimator still holds the state of that flight.

PX4's estimator is not reset between two flights: fed with a vehicle that is back at its start, it fights against its
old state, and the vehicle flips at take-off. A board in HITL gets its first sample from the bench, so one that knows
its home position has been fed since its boot.

    asked for                                    answer of a fresh board
    HOME_POSITION (MAV_CMD_REQUEST_MESSAGE)      none: the request is denied
    ESTIMATOR_STATUS                             none, or without a valid attitude

A board that an earlier run left armed is disarmed by force first: its motors are simulated, as its HEARTBEAT says.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, unpack
from firmware_bridge.ground_station.vehicle_link import enum_name
from firmware_bridge.links.px4.hitl_setup import REBOOT, HitlSetup
from firmware_bridge.transports.transport import Transport
from signals.errors import HandshakeError, LinkClosed, LinkError

_HEARTBEAT, _ACK = MSGID["HEARTBEAT"], MSGID["COMMAND_ACK"]
_HOME, _ESTIMATOR = MSGID["HOME_POSITION"], MSGID["ESTIMATOR_STATUS"]
_REQUEST_MESSAGE, _ARM_DISARM = 512, 400
_FORCE = 21196.0
_ACCEPTED = 0
_ARMED_BIT, _HIL_BIT = 0x80, 0x20
_ATTITUDE_VALID = 1  # ESTIMATOR_STATUS.flags

_ASK_S = 1.2  # for the answer to one request, and for a HEARTBEAT (1 Hz)
_TRIES = 3
_RETURN_S = 40.0  # a board boots in 5 to 15 s; ModemManager may hold its new port for longer
_REOPEN_S = 0.2
_SLICE_S = 0.05


class BoardRestart:
    """Restarts the board behind `setup` on `line`, if it has flown. `say(kind, text)` tells the user what is done."""

    def __init__(self, line: Transport, setup: HitlSetup, say: Callable[[str, str], None], name: str) -> None:
        self._line, self._setup, self._say, self._name = line, setup, say, name
        self._base_mode: int | None = None
        self._fed = False
        self._results: dict[int, int] = {}  # MAV_RESULT by command

    def require_fresh(self) -> None:
        """Return at once if the board has not flown since its boot; restart it otherwise.

        HandshakeError (cause "restart") if the board has flown and cannot be restarted from here.
        """
        if not self._has_flown():
            return
        self._say("restart", "the board has flown since it was started, so its estimator is not fresh: restarting it")
        if (self._base_mode or 0) & _ARMED_BIT:
            self._ask(_ARM_DISARM, 0.0, _FORCE)
        began_s = time.monotonic()
        try:
            result = self._ask(REBOOT, 1.0)
        except LinkClosed:
            result = _ACCEPTED  # a USB port goes away with the board
        if result is not None and result != _ACCEPTED:
            self._refuse(f"it answers the command to restart with {enum_name('MAV_RESULT', result)}")
        while time.monotonic() - began_s < _RETURN_S:
            if self._is_fresh():
                took_s = time.monotonic() - began_s
                text = f"the board has restarted ({took_s:.0f} s); the flight begins once its estimator has converged"
                self._say("restart", text)
                return
        self._refuse(
            "it has not answered the command to restart"
            if result is None
            else f"it did not come back as a fresh board within {_RETURN_S:g} s"
        )

    def _refuse(self, why: str) -> None:
        raise HandshakeError(
            self._name,
            f"the board has flown since it was started, and its estimator still holds that flight; {why}. Restart it "
            "(unplug it for a moment, or `reboot` in its console), then start this run again",
            cause="restart",
        )

    def _is_fresh(self) -> bool:
        """Return True if the board is back and has not been fed. Opens the line again where it has gone."""
        try:
            self._base_mode = None
            return not self._has_flown() and self._base_mode is not None
        except LinkError:
            self._line.close()
            time.sleep(_REOPEN_S)
            with suppress(LinkError):
                self._line.open()
            return False

    def _has_flown(self) -> bool:
        """Return True if the board is in HITL and has been fed samples since its boot, as far as it tells."""
        self._fed = False
        for message in (_HOME, _ESTIMATOR):
            if not any(self._ask(_REQUEST_MESSAGE, float(message)) is not None for _ in range(_TRIES)) or self._fed:
                break
        self._listen_until(lambda: self._base_mode is not None)
        return self._fed and bool((self._base_mode or 0) & _HIL_BIT)

    def _ask(self, command: int, *params: float) -> int | None:
        """Send a command and return its MAV_RESULT; None without an answer."""
        self._results.pop(command, None)
        self._setup.command(command, *params)
        self._listen_until(lambda: command in self._results)
        return self._results.get(command)

    def _listen_until(self, done: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + _ASK_S
        while not done() and time.monotonic() < deadline_s:
            self._take(self._setup.listen(_SLICE_S))

    def _take(self, frames: Iterable[Frame]) -> None:
        for frame in frames:
            if frame.sysid != self._setup.sysid or frame.compid != 1:
                continue
            if frame.msgid in (_HEARTBEAT, _ACK, _HOME, _ESTIMATOR):
                message: Any = unpack(frame)
                if frame.msgid == _HEARTBEAT:
                    self._base_mode = message.base_mode
                elif frame.msgid == _ACK:
                    self._results[message.command] = message.result
                else:
                    self._fed |= frame.msgid == _HOME or bool(message.flags & _ATTITUDE_VALID)
