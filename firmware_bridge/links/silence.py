"""Diagnoses why an autopilot in lockstep has stopped answering, from its last messages and from probes.

    cause                        symptom
    slow                         the answer comes past the limit
    lost                         later messages are answered: this one, or its answer, was lost on the link
    terminated                   flight termination: HEARTBEAT.system_status is 8, a STATUSTEXT reports it, or it was
                                 commanded. PX4's last answer then still carries hover thrust and the armed bit
    offboard_without_setpoints   mode OFFBOARD while disarmed, without a stream of set-points
    stopped                      its process is halted (SIGSTOP, a debugger)
    silent                       none of these: it seems to run, and no message explains the silence

A process that has ended, or a connection that has closed, is `LinkClosed` with cause `crashed` instead, or with cause
`unplugged` by a declared fault.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser
from firmware_bridge.codecs.messages import MSGID, unpack

_HEARTBEAT = MSGID["HEARTBEAT"]
_STATUSTEXT = MSGID["STATUSTEXT"]
_COMMAND_LONG = MSGID["COMMAND_LONG"]

_AUTOPILOT_PX4 = 12
_STATE_FLIGHT_TERMINATION = 8
_ARMED_BIT = 0x80
_PX4_OFFBOARD = 6 << 16
_DO_FLIGHTTERMINATION = 185
_DO_SET_MODE = 176
_TEXTS = 3


class Diagnosis(NamedTuple):
    """A cause of the table above, and its explanation for the user."""

    cause: str
    text: str


class VehicleMonitor:
    """Memory of the vehicle's last heartbeat and texts, and of the last commands to it."""

    def __init__(self) -> None:
        self.texts: deque[str] = deque(maxlen=_TEXTS)
        self.base_mode = 0  # of the newest heartbeat
        self._heartbeat: Any = None
        self._sent: deque[bytes] = deque(maxlen=256)
        self._probing = False

    def sent(self, data: bytes) -> None:
        """Add the commands that went to the vehicle in one tick."""
        self._sent.append(data)

    def probing(self) -> None:
        """Ignore sensor failures in its texts from now on: the probes cause them."""
        self._probing = True

    def received(self, frames: Iterable[Frame]) -> None:
        """Add frames from the vehicle."""
        for frame in frames:
            if frame[0] == _HEARTBEAT:
                if frame[2] == 1:  # the autopilot's own, not that of a camera or gimbal on the same link
                    self._heartbeat = unpack(frame)
                    self.base_mode = self._heartbeat.base_mode
            elif frame[0] == _STATUSTEXT:
                text = unpack(frame).text.strip()
                if not self._probing or "terminat" in text.lower():
                    self.texts.append(text)

    @property
    def last_texts(self) -> str:
        """The last texts, for an error message; "" if there are none."""
        return f"it last said: {' / '.join(self.texts)}" if self.texts else ""

    def diagnosis(self) -> Diagnosis | None:
        """Explain a silence from the messages in both directions; None if they do not explain it."""
        terminated = any(m.param1 == 1.0 for m in self._sent_commands(_DO_FLIGHTTERMINATION))
        offboard = [m.param2 for m in self._sent_commands(_DO_SET_MODE)][-1:] == [_PX4_OFFBOARD >> 16]
        beat = self._heartbeat
        if beat is not None:
            terminated = terminated or beat.system_status == _STATE_FLIGHT_TERMINATION
            if beat.autopilot == _AUTOPILOT_PX4:
                offboard = offboard or beat.custom_mode & 0xFF0000 == _PX4_OFFBOARD
        terminated = terminated or any("terminat" in text.lower() for text in self.texts)
        said = f"; {self.last_texts}" if self.texts else ""
        if terminated:
            return Diagnosis(
                "terminated",
                "the flight was terminated: PX4 does not answer afterwards, and the thrust in its last answer is not "
                f"valid; look for the reason in its texts and log{said}",
            )
        if offboard and not self.base_mode & _ARMED_BIT:
            return Diagnosis(
                "offboard_without_setpoints",
                "mode OFFBOARD was selected while disarmed and no set-points come, which silences PX4: send "
                f"set-points first, or arm first{said}",
            )
        return None

    def _sent_commands(self, command: int) -> list[Any]:
        """Return the commands of this kind that were sent, in order."""
        frames = FrameParser().feed(b"".join(self._sent))
        messages = [unpack(frame) for frame in frames if frame.msgid == _COMMAND_LONG]
        return [message for message in messages if message.command == command]


def process_is_stopped(pid: int | None) -> bool:
    """Return True if process `pid` is halted. False where the system does not report it."""
    if pid is None:
        return False
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] in ("T", "t")
