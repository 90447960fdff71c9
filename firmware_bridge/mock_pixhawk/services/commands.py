"""COMMAND_LONG and COMMAND_INT: one handler per MAV_CMD, each answered by exactly one COMMAND_ACK."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import NamedTuple, Protocol

from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.estimate.state import Estimate
from firmware_bridge.mock_pixhawk.flight.commander import Commander
from firmware_bridge.mock_pixhawk.flight.mission_item import MAX_ALTITUDE_M, RELATIVE_FRAMES
from firmware_bridge.mock_pixhawk.flight.mission_runner import MissionRunner
from firmware_bridge.mock_pixhawk.ids import BaseMode, Cmd, Result
from firmware_bridge.mock_pixhawk.modes import Mode, mode_from_px4
from firmware_bridge.mock_pixhawk.vehicle import Vehicle

_FORCE = 21196.0  # magic param2 of COMPONENT_ARM_DISARM
_MAX_INTERVAL_US = 600_000_000


class Command(NamedTuple):
    """A COMMAND_LONG or COMMAND_INT. `x`, `y` are degrees, NaN where not given; `frame` is -1 for COMMAND_LONG."""

    command: int
    p1: float
    p2: float
    p3: float
    p4: float
    x: float
    y: float
    z: float
    frame: int


class Streams(Protocol):
    """Message rates and single messages, as commands request them."""

    def set_interval(self, msgid: int, period_us: int, now_us: int) -> bool: ...

    def default_interval_us(self, msgid: int) -> int: ...

    def send_once(self, msgid: int, now_us: int) -> bool: ...


class Commands:
    """Handlers of the commands. `run(command, now_us)` returns the result to acknowledge."""

    def __init__(
        self,
        commander: Commander,
        navigator: MissionRunner,
        vehicle: Vehicle,
        estimate: Estimate,
        streams: Streams,
        reboot: Callable[[], None],
        more: Mapping[int, Callable[[Command, int], int]] = MappingProxyType({}),
    ) -> None:
        """`more`: handlers of the commands of this kind of vehicle."""
        self._commander, self._navigator = commander, navigator
        self._vehicle, self._estimate, self._streams = vehicle, estimate, streams
        self._reboot = reboot
        self._handlers: dict[int, Callable[[Command, int], int]] = {
            Cmd.COMPONENT_ARM_DISARM: self._arm_disarm,
            Cmd.DO_SET_MODE: self._set_mode,
            Cmd.NAV_TAKEOFF: self._takeoff,
            Cmd.NAV_LAND: lambda _, now: commander.set_mode(Mode.LAND, now),
            Cmd.NAV_RETURN_TO_LAUNCH: lambda _, now: commander.set_mode(Mode.RTL, now),
            Cmd.DO_REPOSITION: self._reposition,
            Cmd.DO_CHANGE_SPEED: self._change_speed,
            Cmd.DO_SET_HOME: self._set_home,
            Cmd.DO_SET_MISSION_CURRENT: self._set_mission_current,
            Cmd.DO_FLIGHTTERMINATION: self._terminate,
            Cmd.PREFLIGHT_REBOOT_SHUTDOWN: self._reboot_shutdown,
            Cmd.MISSION_START: self._mission_start,
            Cmd.GET_HOME_POSITION: self._get_home,
            Cmd.SET_MESSAGE_INTERVAL: self._set_interval,
            Cmd.REQUEST_MESSAGE: self._request_message,
            Cmd.REQUEST_AUTOPILOT_CAPABILITIES: self._capabilities,
            **more,
        }

    def run(self, command: Command, now_us: int) -> int:
        """Carry out `command`. Infinite parameters are refused for all commands."""
        handler = self._handlers.get(command.command)
        if handler is None:
            return Result.UNSUPPORTED
        if any(value in (float("inf"), float("-inf")) for value in command[1:8]):
            return Result.DENIED
        return handler(command, now_us)

    def set_mode(self, mode: Mode, now_us: int) -> int:
        """Change to the mode that a SET_MODE message requests."""
        return self._commander.set_mode(mode, now_us)

    def _arm_disarm(self, c: Command, now_us: int) -> int:
        force = c.p2 == _FORCE
        if c.p1 == 1.0:
            return self._commander.arm(now_us, force=force)
        if c.p1 == 0.0:
            return self._commander.disarm(now_us, force=force)
        return Result.DENIED

    def _set_mode(self, c: Command, now_us: int) -> int:
        if not int(_finite(c.p1)) & BaseMode.CUSTOM_MODE_ENABLED:
            return Result.DENIED
        mode = mode_from_px4(int(_finite(c.p2)) & 0xFF, int(_finite(c.p3)) & 0xFF)
        return Result.DENIED if mode is None else self._commander.set_mode(mode, now_us)

    def _takeoff(self, c: Command, now_us: int) -> int:
        if self._vehicle.armed and not self._vehicle.landed:
            return Result.TEMPORARILY_REJECTED
        estimate = self._estimate
        if isfinite(c.z) and estimate.has_origin and c.frame not in RELATIVE_FRAMES:
            # COMMAND_LONG carries metres above sea level; clients send 0 for the default altitude.
            if c.z != 0.0:
                if not abs(c.z) <= MAX_ALTITUDE_M:
                    return Result.DENIED
                self._commander.takeoff.altitude_d_m = estimate.origin_alt_m - c.z
        elif isfinite(c.z) and self._vehicle.home is not None:
            self._commander.takeoff.altitude_d_m = self._vehicle.home.d_m - c.z
        return self._commander.set_mode(Mode.TAKEOFF, now_us)

    def _reposition(self, c: Command, now_us: int) -> int:
        estimate, vehicle = self._estimate, self._vehicle
        if not estimate.has_origin:
            return Result.TEMPORARILY_REJECTED
        alt = c.z
        if isfinite(alt) and c.frame in RELATIVE_FRAMES and vehicle.home is not None:
            alt += vehicle.home.alt_m
        if not isfinite(alt):
            alt = estimate.origin_alt_m - vehicle.pos_d
        n, e = vehicle.pos_n, vehicle.pos_e
        if isfinite(c.x) and isfinite(c.y):
            if abs(c.x) > 90.0 or abs(c.y) > 180.0:
                return Result.DENIED
            n, e, _ = estimate.ned(c.x, c.y, alt)
        speed = c.p1 if isfinite(c.p1) and c.p1 > 0.0 else None
        yaw = el.wrap_pi(c.p4) if abs(c.p4) < 100.0 else None
        return self._commander.reposition((n, e, estimate.origin_alt_m - alt), speed, yaw, now_us)

    def _change_speed(self, c: Command, now_us: int) -> int:  # noqa: ARG002
        return Result.ACCEPTED if self._navigator.change_speed(c.p2) else Result.DENIED

    def _set_home(self, c: Command, now_us: int) -> int:  # noqa: ARG002
        if c.p1 == 1.0:
            done = self._commander.set_home(None)
        elif isfinite(c.x) and isfinite(c.y) and isfinite(c.z) and abs(c.x) <= 90.0 and abs(c.y) <= 180.0:
            done = self._commander.set_home((c.x, c.y, c.z))
        else:
            return Result.DENIED
        return Result.ACCEPTED if done else Result.TEMPORARILY_REJECTED

    def _set_mission_current(self, c: Command, now_us: int) -> int:
        return Result.ACCEPTED if self.set_mission_current(int(_finite(c.p1)), now_us) else Result.DENIED

    def set_mission_current(self, seq: int, now_us: int) -> bool:
        """Go on with mission item `seq` and report it. Return False if there is no such item."""
        if not self._navigator.set_current(seq):
            return False
        self._streams.send_once(MSGID["MISSION_CURRENT"], now_us)
        return True

    def _terminate(self, c: Command, now_us: int) -> int:
        if c.p1 < 0.5:
            return Result.DENIED
        self._commander.terminate(now_us)
        return Result.ACCEPTED

    def _reboot_shutdown(self, c: Command, now_us: int) -> int:  # noqa: ARG002
        """Reboot if parameter 1 is 1, do nothing if it is 0. The mock has no shutdown and no bootloader."""
        if self._vehicle.armed:
            return Result.DENIED
        if c.p1 == 1.0:
            self._reboot()
            return Result.ACCEPTED
        return Result.ACCEPTED if c.p1 == 0.0 else Result.DENIED

    def _mission_start(self, c: Command, now_us: int) -> int:
        if not self._navigator.items:
            return Result.DENIED
        first = int(_finite(c.p1))
        if first > 0 and not self._navigator.set_current(first):
            return Result.DENIED
        result = self._commander.set_mode(Mode.MISSION, now_us)
        return self._commander.arm(now_us) if result == Result.ACCEPTED else result

    def _get_home(self, c: Command, now_us: int) -> int:  # noqa: ARG002
        sent = self._streams.send_once(MSGID["HOME_POSITION"], now_us)
        return Result.ACCEPTED if sent else Result.TEMPORARILY_REJECTED

    def _set_interval(self, c: Command, now_us: int) -> int:
        msgid = int(_finite(c.p1))
        if c.p2 != c.p2:
            return Result.DENIED
        if c.p2 == 0.0:
            period_us = self._streams.default_interval_us(msgid)
        elif c.p2 < 0.0:
            period_us = 0
        else:
            period_us = int(min(c.p2, float(_MAX_INTERVAL_US)))
        return Result.ACCEPTED if self._streams.set_interval(msgid, period_us, now_us) else Result.UNSUPPORTED

    def _request_message(self, c: Command, now_us: int) -> int:
        return Result.ACCEPTED if self._streams.send_once(int(_finite(c.p1)), now_us) else Result.UNSUPPORTED

    def _capabilities(self, c: Command, now_us: int) -> int:
        if c.p1 == 1.0:
            self._streams.send_once(MSGID["AUTOPILOT_VERSION"], now_us)
        return Result.ACCEPTED


def _finite(value: float) -> float:
    """Return `value`, or 0 if it is NaN or too large for an integer field."""
    return value if abs(value) < 2.0**31 else 0.0
