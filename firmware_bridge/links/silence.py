"""Why an autopilot in lockstep has stopped answering: told apart from what it said last, and from what a probe finds.

    cause                        how it shows
    slow                         the answer comes after all, past the limit
    lost                         later messages are answered: this one, or its answer, went astray on the wire
    terminated                   flight termination: HEARTBEAT.system_status is 8, it said so in words, or was told to.
                                 PX4's last answer then still carries hover thrust and the armed bit
    offboard_without_setpoints   mode OFFBOARD while disarmed, and nobody sends set-points
    stopped                      its process is halted (SIGSTOP, a debugger)
    silent                       none of these: it runs, or so it seems, and says nothing that explains it

A process that has ended, or a wire that has closed, is no silence: that is `LinkClosed`, cause `crashed`.
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


class Verdict(NamedTuple):
    """A cause of the table above, and what a person should know about it."""

    cause: str
    text: str


class VehicleWatch:
    """Keeps what the vehicle said last of itself, and what it was last told. Cheap enough for every tick."""

    def __init__(self) -> None:
        self.texts: deque[str] = deque(maxlen=_TEXTS)
        self.base_mode = 0  # of the newest heartbeat
        self._heartbeat: Any = None
        self._told: deque[bytes] = deque(maxlen=256)
        self._probing = False

    def told(self, data: bytes) -> None:
        """Commands that went to the vehicle in one tick."""
        self._told.append(data)

    def probing(self) -> None:
        """From now on it says what the probe made it say: sensors that seem to fail."""
        self._probing = True

    def heard(self, frames: Iterable[Frame]) -> None:
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
    def last_words(self) -> str:
        """Its last texts, for an error message; "" if there are none."""
        return f"it last said: {' / '.join(self.texts)}" if self.texts else ""

    def verdict(self) -> Verdict | None:
        """What explains a silence, if what was said and heard explains it."""
        terminated = any(m.param1 == 1.0 for m in self._told_commands(_DO_FLIGHTTERMINATION))
        offboard = [m.param2 for m in self._told_commands(_DO_SET_MODE)][-1:] == [_PX4_OFFBOARD >> 16]
        beat = self._heartbeat
        if beat is not None:
            terminated = terminated or beat.system_status == _STATE_FLIGHT_TERMINATION
            if beat.autopilot == _AUTOPILOT_PX4:
                offboard = offboard or beat.custom_mode & 0xFF0000 == _PX4_OFFBOARD
        terminated = terminated or any("terminat" in text.lower() for text in self.texts)
        said = f"; {self.last_words}" if self.texts else ""
        if terminated:
            return Verdict(
                "terminated",
                "the flight was terminated: PX4 answers nothing afterwards, and the thrust in its last answer means "
                f"nothing{said}",
            )
        if offboard and not self.base_mode & _ARMED_BIT:
            return Verdict(
                "offboard_without_setpoints",
                "mode OFFBOARD was chosen while disarmed and no set-points come: PX4 falls silent then. Send "
                f"set-points first, or arm first{said}",
            )
        return None

    def _told_commands(self, command: int) -> list[Any]:
        """Those that it was told, the last one last."""
        frames = FrameParser().feed(b"".join(self._told))
        messages = [unpack(frame) for frame in frames if frame.msgid == _COMMAND_LONG]
        return [message for message in messages if message.command == command]


def process_is_stopped(pid: int | None) -> bool:
    """Whether the system says that process `pid` is halted. False where it cannot be told."""
    if pid is None:
        return False
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] in ("T", "t")
