"""Dispatch of the messages of ground stations and SDKs to the MAVLink services.

One handler per message id, in `Services.handlers`; the autopilot's hot path only looks up that table. Messages for
another system or component are dropped here.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class, unpack
from firmware_bridge.mock_pixhawk.flight.failsafe import Failsafe
from firmware_bridge.mock_pixhawk.flight.mission_item import UNKNOWN_POSITION
from firmware_bridge.mock_pixhawk.flight.offboard import Offboard
from firmware_bridge.mock_pixhawk.ids import COMPONENT_AUTOPILOT, Result
from firmware_bridge.mock_pixhawk.modes import mode_from_custom_mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamService
from firmware_bridge.mock_pixhawk.services.commands import Command, Commands
from firmware_bridge.mock_pixhawk.services.mission_store import MissionStore
from firmware_bridge.mock_pixhawk.services.outbox import Outbox
from firmware_bridge.mock_pixhawk.vehicle import ManualControl, Vehicle

_TYPE_GCS = 6  # MAV_TYPE_GCS
_NO_JOYSTICK = (0, 4)  # COM_RC_IN_MODE: a radio only; no sticks at all
_Ack = message_class("COMMAND_ACK")
_Timesync = message_class("TIMESYNC")
_Ping = message_class("PING")
_Ftp = message_class("FILE_TRANSFER_PROTOCOL")

_FTP_NAK, _FTP_FILE_NOT_FOUND, _FTP_UNKNOWN_COMMAND = 129, 10, 7
_FTP_OPENS = frozenset({3, 4, 6, 7, 8, 11, 12, 13, 14, 15})  # requests that name a file
_FTP_TERMINATE = (1, 2)
_FTP_ACK = 128
_LOCAL_FRAMES = frozenset({1, 7, 8, 9})  # local frames: x, y are 1e4 metres, which no command here takes

Sender = tuple[int, int]


class Services:
    """Dispatcher of all messages but those of HIL; replies go to `outbox`."""

    def __init__(
        self,
        *,
        sysid: int,
        vehicle: Vehicle,
        commands: Commands,
        params: ParamService,
        missions: MissionStore,
        offboard: Offboard,
        failsafe: Failsafe,
        outbox: Outbox,
    ) -> None:
        self._sysid = sysid
        self._vehicle, self._commands, self._table = vehicle, commands, params.table
        self._failsafe = failsafe
        self._outbox, self._send = outbox, outbox.send
        by_name: dict[str, Callable[[Any, Sender, int], None]] = {
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_MODE": self._set_mode,
            "MANUAL_CONTROL": self._manual_control,
            "SET_POSITION_TARGET_LOCAL_NED": lambda m, _sender, now: offboard.on_local(m, now),
            "SET_POSITION_TARGET_GLOBAL_INT": lambda m, _sender, now: offboard.on_global(m, now),
            "SET_ATTITUDE_TARGET": lambda m, _sender, now: offboard.on_attitude(m, now),
            "PARAM_REQUEST_LIST": lambda _m, _sender, _now: params.request_list(),
            "MISSION_COUNT": missions.on_count,
            "MISSION_ITEM_INT": missions.on_item_int,
            "MISSION_ITEM": missions.on_item,
            "MISSION_REQUEST_LIST": lambda m, s, _now: missions.on_request_list(m, s),
            "MISSION_REQUEST_INT": lambda m, s, _now: missions.on_request(m, s, as_int=True),
            "MISSION_REQUEST": lambda m, s, _now: missions.on_request(m, s, as_int=False),
            "MISSION_ACK": lambda _m, s, _now: missions.on_ack(s),
            "MISSION_CLEAR_ALL": lambda m, s, _now: missions.on_clear(m, s),
            "MISSION_SET_CURRENT": lambda m, _sender, now: self._set_current(m, now),
            "PING": self._ping,
            "FILE_TRANSFER_PROTOCOL": self._ftp,
        }
        self.handlers: dict[int, Callable[[Frame, int], None]] = {
            MSGID[name]: self._decoded(handler) for name, handler in by_name.items()
        }
        self.handlers[MSGID["HEARTBEAT"]] = self._heartbeat
        self.handlers[MSGID["TIMESYNC"]] = self._timesync
        # Parameter values are raw bits: these payloads are not decoded.
        self.handlers[MSGID["PARAM_REQUEST_READ"]] = lambda frame, _now: self._raw_param(frame, 2, params.request_read)
        self.handlers[MSGID["PARAM_SET"]] = lambda frame, _now: self._raw_param(frame, 4, params.set)

    def _is_addressed(self, system: int, component: int) -> bool:
        return system in (0, self._sysid) and component in (0, COMPONENT_AUTOPILOT)

    def _decoded(self, handler: Callable[[Any, Sender, int], None]) -> Callable[[Frame, int], None]:
        def handle(frame: Frame, now_us: int) -> None:
            message = unpack(frame)
            system = getattr(message, "target_system", getattr(message, "target", 0))
            if self._is_addressed(system, getattr(message, "target_component", 0)):
                handler(message, (frame.sysid, frame.compid), now_us)

        return handle

    def _raw_param(self, frame: Frame, target_at: int, handler: Callable[[bytes], None]) -> None:
        if self._is_addressed(frame.payload[target_at], frame.payload[target_at + 1]):
            handler(frame.payload)

    # -- commands -----------------------------------------------------------------------------------------------

    def _acknowledge(self, command: int, result: int, sender: Sender) -> None:
        self._send(_Ack(command, result, 0, 0, *sender))

    def _command_long(self, m: Any, sender: Sender, now_us: int) -> None:
        c = Command(m.command, m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7, -1)
        self._acknowledge(m.command, self._commands.run(c, now_us), sender)

    def _command_int(self, m: Any, sender: Sender, now_us: int) -> None:
        x = nan if m.x == UNKNOWN_POSITION else m.x / 1e7
        y = nan if m.y == UNKNOWN_POSITION else m.y / 1e7
        c = Command(m.command, m.param1, m.param2, m.param3, m.param4, x, y, m.z, m.frame)
        result = Result.DENIED if m.frame in _LOCAL_FRAMES else self._commands.run(c, now_us)
        self._acknowledge(m.command, result, sender)

    def _set_mode(self, m: Any, sender: Sender, now_us: int) -> None:  # noqa: ARG002
        """Change the mode. SET_MODE has no acknowledgement; the next HEARTBEAT shows the mode."""
        mode = mode_from_custom_mode(m.custom_mode)
        if m.base_mode & 1 and mode is not None:
            self._commands.set_mode(mode, now_us)

    def _set_current(self, m: Any, now_us: int) -> None:
        if not self._commands.set_mission_current(m.seq, now_us):
            self._outbox.warn(f"No mission item {m.seq}")

    # -- external control ---------------------------------------------------------------------------------------

    def _heartbeat(self, frame: Frame, now_us: int) -> None:
        if unpack(frame).type == _TYPE_GCS:
            self._failsafe.last_gcs_us = now_us

    def _manual_control(self, m: Any, sender: Sender, now_us: int) -> None:  # noqa: ARG002
        if self._table["COM_RC_IN_MODE"] in _NO_JOYSTICK:
            return
        if any(abs(axis) > 1000 for axis in (m.x, m.y, m.z, m.r)):
            return  # INT16_MAX marks an axis that is not there
        self._vehicle.manual = ManualControl(now_us, m.x / 1e3, m.y / 1e3, max(m.z, 0) / 1e3, m.r / 1e3)

    # -- small services -----------------------------------------------------------------------------------------

    def _timesync(self, frame: Frame, now_us: int) -> None:
        m = unpack(frame)
        if m.tc1 == 0:
            self._send(_Timesync(now_us * 1000, m.ts1))

    def _ping(self, m: Any, sender: Sender, now_us: int) -> None:  # noqa: ARG002
        if m.target_system == 0 and m.target_component == 0:
            self._send(_Ping(m.time_usec, m.seq, *sender))

    def _ftp(self, m: Any, sender: Sender, now_us: int) -> None:  # noqa: ARG002
        """Acknowledge the end of a session and refuse everything else at once: the mock has no files."""
        request = bytes(m.payload)
        seq = (request[0] | request[1] << 8) + 1 & 0xFFFF
        opcode = request[3]
        reply = bytearray(251)
        reply[0:3] = bytes((seq & 0xFF, seq >> 8, request[2]))
        if opcode in _FTP_TERMINATE:
            reply[3] = _FTP_ACK
        else:
            reply[3], reply[4] = _FTP_NAK, 1
            reply[12] = _FTP_FILE_NOT_FOUND if opcode in _FTP_OPENS else _FTP_UNKNOWN_COMMAND
        reply[5] = opcode
        self._send(_Ftp(0, *sender, tuple(reply)))
