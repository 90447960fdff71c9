"""Checks over MAVLink that a board is set up for PX4's hardware in the loop, and corrects its parameters.

SYS_HITL         1 (HITL enabled); it takes effect at the next boot
HIL_ACT_FUNCn    100 + n for motor n: the mixer output in slot n of HIL_ACTUATOR_CONTROLS
data rate        above 5000 bytes/s: below, PX4 ignores all HIL messages and sends no HIL_ACTUATOR_CONTROLS
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from firmware_bridge.codecs.hil import HIL_ACTUATOR_CONTROLS
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.ground_station.parameter_check import Reported, parameter_problem
from firmware_bridge.ground_station.vehicle_link import (
    GCS_COMPID,
    GCS_SYSID,
    param_as_held,
    param_as_read,
    param_as_sent,
)
from firmware_bridge.transports.transport import Transport
from signals.errors import ConfigError, HandshakeError, Problem

_PARAM_VALUE = MSGID["PARAM_VALUE"]
_HEARTBEAT = MSGID["HEARTBEAT"]
_ParamRequestRead = message_class("PARAM_REQUEST_READ")
_ParamRequestList = message_class("PARAM_REQUEST_LIST")
_ParamSet = message_class("PARAM_SET")
_CommandLong = message_class("COMMAND_LONG")
_Heartbeat = message_class("HEARTBEAT")

_GCS_BEAT = _Heartbeat(6, 8, 0, 0, 4, 3)  # a ground station, no autopilot, active, MAVLink 2
REBOOT = 246  # MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
_TRIES, _TRY_S = 5, 1.0
_TRIES_OF_A_KNOWN = 3  # if the board has answered for other parameters: it lacks this one, or an answer was lost
_LIST_GAP_S, _LIST_LIMIT_S = 2.0, 30.0
_LISTEN_S = 3.0
_SILENT_S = 1.5  # without a heartbeat (1 Hz): the port may be the wrong one
_SLICE_S = 0.05
_BOARD = "the board"


@dataclass(frozen=True)
class Setting:
    """A parameter whose value is not the one that HITL needs. `found` is None if the board does not have it."""

    name: str
    found: float | None
    wanted: float

    def __str__(self) -> str:
        if self.found is None:
            return f"{self.name} is unknown to it: this firmware has no HITL outputs (pwm_out_sim); flash one that has"
        return f"{self.name} is {self.found:g}, must be {self.wanted:g}"


def await_autopilot(
    line: Transport,
    parser: FrameParser,
    *,
    limit_s: float,
    on_frames: Callable[[list[Frame]], None] = lambda _: None,
    on_delay: Callable[[str], None] = lambda _: None,
    name: str = "",
) -> int:
    """Return the system id of the first autopilot that sends a heartbeat. `on_frames` gets the frames of each read.

    Sends heartbeats meanwhile: PX4 with SYS_USB_AUTO 1 starts MAVLink on USB only when it receives some. `on_delay`
    gets a text once if none comes at first. HandshakeError of `name`, or of the line, if none comes in time.
    """
    began = time.monotonic()
    deadline = began + limit_s
    encoder, beat_due, told = FrameEncoder(GCS_SYSID, GCS_COMPID), began, False
    while True:
        now = time.monotonic()
        if now >= beat_due:
            beat_due = now + 1.0
            line.write(encoder.frame(_GCS_BEAT.MSGID, pack(_GCS_BEAT)))
        if not told and now - began >= _SILENT_S:
            told = True
            came = f"{parser.frames} other messages and {parser.garbage_bytes + parser.pending} bytes that are none"
            on_delay(
                f"no autopilot has sent a heartbeat on {line.name} for {_SILENT_S:g} s ({came}): waiting until "
                f"{limit_s:g} s. Is it the right port? `hil devices` lists the boards"
            )
        frames = parser.feed(line.read(_SLICE_S))
        on_frames(frames)
        for frame in frames:
            if frame.msgid == _HEARTBEAT and frame.compid == 1:
                return frame.sysid
        if time.monotonic() >= deadline:
            raise HandshakeError(
                name or line.name,
                f"no heartbeat within {limit_s:g} s of wall clock; {parser.frames} other messages and "
                f"{parser.garbage_bytes + parser.pending} bytes that are none came. Is it powered? Are the "
                "port and the baud rate right? Boards with two USB ports have MAVLink on one of them",
            )


class HitlSetup:
    """Reads and sets parameters over `transport`, which is open and has carried a heartbeat."""

    def __init__(self, transport: Transport, parser: FrameParser, *, motors: int, sysid: int = 1) -> None:
        self._transport = transport
        self._parser = parser
        self._encoder = FrameEncoder(GCS_SYSID, GCS_COMPID)
        self.sysid = sysid
        self.wanted = {"SYS_HITL": 1.0} | {f"HIL_ACT_FUNC{n}": 100.0 + n for n in range(1, motors + 1)}
        self._types: dict[str, int] = {}

    def read(self, names: Sequence[str]) -> dict[str, float | None]:
        """Return parameters by name; None for those without an answer. HandshakeError if there is no answer at all."""
        values: dict[str, float | None] = dict.fromkeys(names)
        for name in names:
            values[name] = self._read(name)
            if not self._types:
                break  # it answers no requests for parameters: each further one takes seconds
        if all(value is None for value in values.values()):
            raise HandshakeError(
                self._transport.name,
                f"it answered none of the requests for the parameters {', '.join(names)}: is it PX4, and is its "
                "MAVLink on this port not in a reduced mode?",
            )
        return values

    def problems(self) -> list[Setting]:
        """Return the parameters that are not as HITL needs them."""
        found = self.read(list(self.wanted))
        return [Setting(name, found[name], wanted) for name, wanted in self.wanted.items() if found[name] != wanted]

    def commands_come(self) -> bool:
        """Return True if HIL_ACTUATOR_CONTROLS come: then HITL is on, and the line is fast enough."""
        deadline = time.monotonic() + _LISTEN_S
        while time.monotonic() < deadline:
            if any(frame.msgid == HIL_ACTUATOR_CONTROLS for frame in self.listen(_SLICE_S)):
                return True
        return False

    def set(self, params: Mapping[str, float]) -> None:
        """Set parameters. ConfigError names those that the board does not have or does not take.

        HandshakeError if it answers for none.
        """
        problems: list[Problem] = []
        missing: list[str] = []
        for name, value in params.items():
            # PX4 takes a value only in the parameter's own type, which is known from reading it.
            found = self._read(name)
            if found is None:
                missing.append(name)
                continue
            kind = self._types[name]
            held = param_as_held(value, kind)
            if held is not None:
                found = self._set(name, held)
            if found is None:
                raise HandshakeError(self._transport.name, f"does not answer that {name} has been set to {value:g}")
            if found != held:
                problems.append(parameter_problem(name, value, {name: Reported(found, kind)}, _BOARD))
        if missing:
            known = self._names()
            if not known:
                raise HandshakeError(
                    self._transport.name, f"does not answer for the parameters {', '.join(missing)}, nor for any other"
                )
            problems += [parameter_problem(name, params[name], known, _BOARD) for name in missing]
        if problems:
            raise ConfigError(problems)

    def _names(self) -> dict[str, Reported]:
        """Return every parameter of the board, as far as they come."""
        found: dict[str, Reported] = {}
        self.send(_ParamRequestList(self.sysid, 1))
        began = came = time.monotonic()
        while time.monotonic() - came < _LIST_GAP_S and time.monotonic() - began < _LIST_LIMIT_S:
            for frame in self.listen(_SLICE_S):
                if frame.msgid == _PARAM_VALUE and frame.sysid == self.sysid:
                    message: Any = unpack(frame)
                    value = param_as_read(message.param_value, message.param_type)
                    found[message.param_id] = Reported(value, message.param_type)
                    came = time.monotonic()
                    if len(found) >= message.param_count:
                        return found
        return found

    def command(self, command: int, *params: float) -> None:
        """Send COMMAND_LONG with these parameters, the others 0."""
        self.send(_CommandLong(self.sysid, 1, command, 0, *params, *(0.0,) * (7 - len(params))))

    def reboot(self) -> None:
        """Request a reboot of the board. The line may go away meanwhile."""
        self.command(REBOOT, 1.0)

    def require(self) -> None:
        """Check everything. HandshakeError lists each wrong setting and its remedy.

        Commands that come prove that HITL is on, also where the board does not send its parameters.
        """
        come = self.commands_come()
        try:
            problems = [problem for problem in self.problems() if problem.found is not None or not come]
        except HandshakeError:
            if not come:
                raise
            return
        advice = "`hil devices --check PORT --fix` sets what can be set and restarts the board"
        if problems:
            raise HandshakeError(
                self._transport.name,
                "the board is not set up for hardware in the loop: " + "; ".join(map(str, problems)) + f". {advice}",
                cause="setup",
            )
        if not come:
            raise HandshakeError(
                self._transport.name,
                "its parameters are right, but it sends no HIL_ACTUATOR_CONTROLS: it has not been restarted since "
                "SYS_HITL was set, or the line's data rate is not above 5000 bytes/s (57600 baud is not; USB and "
                f"921600 are). {advice}",
                cause="setup",
            )

    def _read(self, name: str) -> float | None:
        for tries in range(1, _TRIES + 1):
            self.send(_ParamRequestRead(self.sysid, 1, name, -1))
            value = self._await_value(name)
            if value is not None:
                return value
            if self._types and tries >= _TRIES_OF_A_KNOWN:
                break
        return None

    def _set(self, name: str, value: float) -> float | None:
        kind = self._types[name]
        carried = param_as_sent(value, kind)
        for _ in range(_TRIES):
            self.send(_ParamSet(self.sysid, 1, name, carried, kind))
            answer = self._await_value(name)
            if answer is not None:
                return answer
        return None

    def _await_value(self, name: str) -> float | None:
        deadline = time.monotonic() + _TRY_S
        while time.monotonic() < deadline:
            for frame in self.listen(_SLICE_S):
                if frame.msgid == _PARAM_VALUE and frame.sysid == self.sysid:
                    message = unpack(frame)
                    if message.param_id == name:
                        self._types[name] = message.param_type
                        return param_as_read(message.param_value, message.param_type)
        return None

    def listen(self, for_s: float) -> list[Frame]:
        """Return the frames that come within `for_s`."""
        return self._parser.feed(self._transport.read(for_s))

    def send(self, message: Any) -> None:
        """Send `message` after a heartbeat of a ground station."""
        beat, encoder = _GCS_BEAT, self._encoder
        self._transport.write(encoder.frame(beat.MSGID, pack(beat)) + encoder.frame(message.MSGID, pack(message)))
