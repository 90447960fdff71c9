"""The autopilot's software from boot to reboot: its parts and their connections.

It does no I/O and has no clock: the timing (`lockstep`, `hitl`) hands it samples, other messages and the time, and
writes the messages of its outbox. Parameters and mission outlast a reboot.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from firmware_bridge import _native
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class
from firmware_bridge.mock_pixhawk.estimate.sensors import HITL_TIMEOUT_US, TIMEOUT_US, SensorIntake
from firmware_bridge.mock_pixhawk.estimate.state import Estimate, declination_deg
from firmware_bridge.mock_pixhawk.flight.commander import Commander, Output
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.flight.guidance import PERIOD_US
from firmware_bridge.mock_pixhawk.flight.mission_item import REPERTOIRES
from firmware_bridge.mock_pixhawk.flight.mission_runner import MissionRunner
from firmware_bridge.mock_pixhawk.flight.preflight import Preflight
from firmware_bridge.mock_pixhawk.flight.stack import FlightStack, MultirotorStack
from firmware_bridge.mock_pixhawk.ids import Severity
from firmware_bridge.mock_pixhawk.parameters.params import ParamService, ParamTable
from firmware_bridge.mock_pixhawk.services.commands import Commands
from firmware_bridge.mock_pixhawk.services.mission_store import MissionStore
from firmware_bridge.mock_pixhawk.services.outbox import Outbox
from firmware_bridge.mock_pixhawk.services.services import Services
from firmware_bridge.mock_pixhawk.services.telemetry import autopilot_version
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.errors import ConfigError
from signals.mission import MissionItem

HEARTBEAT, AUTOPILOT_VERSION = MSGID["HEARTBEAT"], MSGID["AUTOPILOT_VERSION"]
_PARAM_PERIOD_US, _MISSION_PERIOD_US = 8_000, 50_000
_Reached = message_class("MISSION_ITEM_REACHED")


NEVER_US = 1 << 62
_MULTIROTOR, _FIXED_WING = 0, 1  # CA_AIRFRAME


class Timer:
    """A callback and its next due time. `period_us` 0 = off."""

    __slots__ = ("action", "due_us", "period_us")

    def __init__(self, action: Callable[[int], None]) -> None:
        self.action = action
        self.period_us = 0
        self.due_us = NEVER_US


class Timers:
    """Timers of one autopilot, in simulated time, run in the order in which they were added.

    A timer of period P fires on the first step at or after each multiple of P (integer microseconds): the rate is exact
    on average and missed instants are skipped. Between due times a step costs one comparison, `now_us >=
    timers.next_due_us`.
    """

    __slots__ = ("_timers", "next_due_us")

    def __init__(self) -> None:
        self._timers: list[Timer] = []
        self.next_due_us = NEVER_US

    def add(self, action: Callable[[int], None]) -> Timer:
        """Add a timer, off. `action(now_us)` may start and stop timers, itself included."""
        timer = Timer(action)
        self._timers.append(timer)
        return timer

    def start(self, timer: Timer, period_us: int, now_us: int) -> None:
        """Run `timer` every `period_us` > 0, first at the next multiple of the period after `now_us`."""
        timer.period_us = period_us
        timer.due_us = now_us - now_us % period_us + period_us
        self.next_due_us = min(self.next_due_us, timer.due_us)

    def stop(self, timer: Timer) -> None:
        """Stop `timer`."""
        timer.period_us = 0
        timer.due_us = NEVER_US

    def run(self, now_us: int) -> None:
        """Run the timers due at `now_us`."""
        for timer in self._timers:
            if timer.due_us <= now_us:
                period = timer.period_us
                timer.due_us = now_us - now_us % period + period
                timer.action(now_us)
        next_due_us = NEVER_US
        for timer in self._timers:  # an action may have started or stopped any
            if timer.due_us < next_due_us:
                next_due_us = timer.due_us
        self.next_due_us = next_due_us


class Host(Protocol):
    """Functions of the board on which the software runs."""

    def fall_silent(self) -> None:
        """Stop answering until the next boot, after writing the outbox."""

    def request_reboot(self) -> None:
        """Reboot, after writing the outbox."""


class Firmware:
    """The parts of the autopilot. `hitl`: SYS_HITL was on at boot. `offboard_silence`: see `MockPixhawk`."""

    def __init__(
        self,
        *,
        params: ParamTable,
        outbox: Outbox,
        sysid: int,
        hitl: bool,
        host: Host,
        mission: list[MissionItem],
        offboard_silence: bool,
    ) -> None:
        self.params, self.outbox, self.hitl = params, outbox, hitl
        self._sysid = sysid
        self._origin_known = False
        self.ignored = 0

        kind = int(params["CA_AIRFRAME"]) if "CA_AIRFRAME" in params else _MULTIROTOR
        names = list(_native.PARAM_NAMES)
        self.native_index = {name: index for index, name in enumerate(names)}
        try:
            values = np.array([float(params[name]) for name in names])
            self.core = _native.FlightCore(values, rotors=kind != _FIXED_WING)
        except ValueError as error:  # each value is in range, but their combination is not a vehicle
            raise ConfigError.at("parameters", str(error), "check the CA_ROTOR parameters") from error

        vehicle = self.vehicle = Vehicle()
        self.estimate = Estimate(self.core, vehicle)
        self.sensors = SensorIntake(self.core, HITL_TIMEOUT_US if hitl else TIMEOUT_US)
        stack = self._stack = self._make_stack(kind)
        self.rotors = int(params["CA_ROTOR_COUNT"])
        self.outputs = stack.outputs  # the 16 commands of an instant
        self.preflight = Preflight(vehicle, self.estimate, self.sensors, params)
        failsafe = stack.failsafe(outbox.say, hitl=hitl)
        self.navigator: MissionRunner = stack.modes.navigator
        self.commander = Commander(
            vehicle,
            self.estimate,
            params,
            stack.modes,
            self.preflight,
            failsafe,
            Output(outbox.say, host.fall_silent, offboard_silence),
            hitl=hitl,
        )
        self.telemetry = stack.telemetry(self._mission_state, system_type=int(params["MAV_TYPE"]), hil=hitl)
        self.missions = MissionStore(outbox.send, outbox.warn, self._on_mission, repertoire=REPERTOIRES[kind])
        self.missions.items = mission
        self.navigator.load(mission)
        param_service = ParamService(params, outbox.send_payload, self._start_param_list, outbox.warn)
        commands = Commands(
            self.commander, self.navigator, vehicle, self.estimate, self, host.request_reboot, stack.commands
        )
        self.handlers = Services(
            sysid=sysid,
            vehicle=vehicle,
            commands=commands,
            params=param_service,
            missions=self.missions,
            offboard=stack.modes.offboard,
            failsafe=failsafe,
            outbox=outbox,
        ).handlers
        self._set_up_timers(param_service)
        params.on_change = self._on_param
        params.after_change = stack.modes.guidance.refresh_params
        stack.modes.guidance.off()

    def _make_stack(self, kind: int) -> FlightStack:
        parts = FirmwareParts(self.core, self.vehicle, self.estimate, self.sensors, self.params, self)
        if kind == _MULTIROTOR:
            return MultirotorStack(parts)
        if kind == _FIXED_WING:
            from firmware_bridge.mock_pixhawk.plane.plane_stack import PlaneStack  # a multirotor needs none of it

            return PlaneStack(parts)
        from firmware_bridge.mock_pixhawk.vtol.vtol_stack import VtolStack

        return VtolStack(parts)

    def _set_up_timers(self, param_service: ParamService) -> None:
        """Guidance first: telemetry of the same instant then tells what it decided."""
        timers = self.timers = Timers()
        self._guidance_timer = timers.add(self._guide)
        self._mission_timer = timers.add(self.missions.tick)

        def send_param(now_us: int) -> None:  # noqa: ARG001
            if not param_service.send_next():
                timers.stop(self._param_timer)

        self._param_timer = timers.add(send_param)
        self._streams: dict[int, Timer] = {}
        for msgid, maker in self.telemetry.makers.items():

            def send(now_us: int, maker: Any = maker) -> None:
                self.estimate.refresh(now_us)
                message = maker(now_us)
                if message is not None:
                    self.outbox.send(message)

            self._streams[msgid] = timers.add(send)

    # -- called by the timing -----------------------------------------------------------------------------------

    def begin(self, now_us: int) -> None:
        """Start the timers at the first time of the clock."""
        self.vehicle.now_us = now_us
        self.preflight.begin(now_us, hitl=self.hitl)
        self.timers.start(self._guidance_timer, PERIOD_US, now_us)
        self.timers.start(self._mission_timer, _MISSION_PERIOD_US, now_us)
        for msgid, period_us in self.telemetry.periods_us.items():
            if period_us:
                self.timers.start(self._streams[msgid], period_us, now_us)

    def handle(self, frame: Frame) -> None:
        """Handle any message but those of HIL."""
        handler = self.handlers.get(frame.msgid)
        if handler is None:
            self.ignored += 1
            return
        try:
            handler(frame, self.vehicle.now_us)
        except (CodecError, ArithmeticError, ValueError, IndexError, KeyError):
            # No received frame may end the autopilot.
            self.ignored += 1

    def send_heartbeat(self) -> None:
        """Send a HEARTBEAT now, besides the periodic ones."""
        self.outbox.send(self.telemetry.makers[HEARTBEAT](self.vehicle.now_us))

    # -- callbacks of the parts ---------------------------------------------------------------------------------

    def _guide(self, now_us: int) -> None:
        self.estimate.publish(now_us)
        self._stack.observe(now_us)
        if not self._origin_known and self.estimate.has_origin:
            self._on_origin()
        self.commander.step(now_us)

    def _on_origin(self) -> None:
        """Set the magnetic declination for the position of the first fix."""
        self._origin_known = True
        if self.params["EKF_MAG_DECL"] == 0.0:
            lat_deg, lon_deg, _ = self.estimate.geodetic(0.0, 0.0, 0.0)
            self.params.set("EKF_MAG_DECL", declination_deg(lat_deg, lon_deg))

    def _on_param(self, name: str, value: float) -> str | None:
        index = self.native_index.get(name)
        if index is not None:
            try:
                self.core.set_param(index, float(value))
            except ValueError as error:
                return str(error)
        return None

    def _start_param_list(self) -> None:
        self.timers.start(self._param_timer, _PARAM_PERIOD_US, self.vehicle.now_us)

    def _mission_state(self) -> tuple[int, int, int]:
        return self.navigator.current_seq(), len(self.navigator.items), self.navigator.state()

    def _on_mission(self) -> None:
        self.navigator.load(self.missions.items)

    def on_reached(self, seq: int) -> None:
        self.outbox.send(_Reached(seq))
        self.send_once(MSGID["MISSION_CURRENT"], self.vehicle.now_us)

    def info(self, text: str) -> None:
        """Send a STATUSTEXT of severity INFO."""
        self.outbox.say(Severity.INFO, text)

    def set_mission_home(self, position: tuple[float, float, float] | None) -> None:
        if not self.commander.set_home(position):
            self.outbox.warn("Home not set: no position")

    # -- streams ------------------------------------------------------------------------------------------------

    def add_stream(self, msgid: int, action: Callable[[int], None], period_us: int, now_us: int) -> None:
        """Add a stream that runs after all others due at the same time."""
        self._streams[msgid] = timer = self.timers.add(action)
        self.timers.start(timer, period_us, now_us)

    def set_interval(self, msgid: int, period_us: int, now_us: int) -> bool:
        """Send `msgid` every `period_us` (0: never). Return False if the mock does not have that message."""
        timer = self._streams.get(msgid)
        if timer is None:
            return False
        if period_us > 0:
            self.timers.start(timer, period_us, now_us)
        else:
            self.timers.stop(timer)
        return True

    def default_interval_us(self, msgid: int) -> int:
        """Return the default period of a message."""
        return self.telemetry.periods_us.get(msgid, 0)

    def send_once(self, msgid: int, now_us: int) -> bool:
        """Send `msgid` now. Return False if the mock does not have that message or its data."""
        if msgid == AUTOPILOT_VERSION:
            self.outbox.send(autopilot_version(self._sysid))
            return True
        maker = self.telemetry.makers.get(msgid)
        if maker is None:
            return False
        self.estimate.refresh(now_us)
        message = maker(now_us)
        if message is None:
            return False
        self.outbox.send(message)
        return True
