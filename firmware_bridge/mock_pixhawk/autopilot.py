"""The mock autopilot without I/O: bytes in, bytes out.

`MockPixhawk.feed(data)` takes what arrived on the wire and returns what the autopilot writes because of it. The clock
is HIL_SENSOR.time_usec, nothing else: fed the same bytes, however they are cut, it answers the same bytes.

One HIL_SENSOR (id 0), in this order:
    1 the clock moves; a clock that goes backwards silences the autopilot for good, as in PX4
    2 sensors go to the estimator; the flight core predicts, controls and mixes with the set-point it has
    3 timers that are due: guidance (failsafes, mode, set-point for the next step), then telemetry
    4 HIL_ACTUATOR_CONTROLS with the same time_usec
Until `boot_sensors` samples have come nothing at all is written; what other messages gave rise to waits.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from firmware_bridge import _native
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.mock_pixhawk.commander import Commander
from firmware_bridge.mock_pixhawk.commands import Commands
from firmware_bridge.mock_pixhawk.declination import declination_deg
from firmware_bridge.mock_pixhawk.estimate import Estimate
from firmware_bridge.mock_pixhawk.failsafe import Failsafe
from firmware_bridge.mock_pixhawk.faults import Fault, Misbehaviour
from firmware_bridge.mock_pixhawk.guidance import PERIOD_US, Guidance
from firmware_bridge.mock_pixhawk.ids import COMPONENT_AUTOPILOT, Cmd, MissionState, Severity
from firmware_bridge.mock_pixhawk.mission_store import MissionStore
from firmware_bridge.mock_pixhawk.navigator import Navigator
from firmware_bridge.mock_pixhawk.offboard import Offboard
from firmware_bridge.mock_pixhawk.params import ParamService, ParamTable
from firmware_bridge.mock_pixhawk.preflight import Preflight
from firmware_bridge.mock_pixhawk.sensors import SensorIntake
from firmware_bridge.mock_pixhawk.services import Services
from firmware_bridge.mock_pixhawk.streams import Timer, Timers
from firmware_bridge.mock_pixhawk.telemetry import DEFAULT_PERIOD_US, Telemetry
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from firmware_bridge.mock_pixhawk.version import autopilot_version
from hil.signals.errors import ConfigError, Problem

HIL_SENSOR, HIL_GPS = MSGID["HIL_SENSOR"], MSGID["HIL_GPS"]
HIL_ACTUATOR_CONTROLS = MSGID["HIL_ACTUATOR_CONTROLS"]
AUTOPILOT_VERSION = MSGID["AUTOPILOT_VERSION"]

_unpack_sensor = struct.Struct("<Q13fIB").unpack
_pack_actuators = struct.Struct("<QQ16fB").pack
_FLAGS_LOCKSTEP = 1
_MODE_DISARMED, _MODE_ARMED = 1, 129
_CHANNELS = 16
_LATEST_US = 1 << 60  # times beyond are no times: 36,000 years

_HIL_SENSOR_INTERVAL_US = 5000.0  # what PX4 asks the simulator for: message 115 every 5 ms
_HIL_STATE_QUATERNION = 115
_PARAM_PERIOD_US, _MISSION_PERIOD_US = 8_000, 50_000

_Text = message_class("STATUSTEXT")
_Reached = message_class("MISSION_ITEM_REACHED")
_CommandLong = message_class("COMMAND_LONG")
_TEXT_LENGTH = 50


class MockPixhawk:
    """One simulated autopilot.

    `airframe` names a file in `airframes/`, `params` are NAME=VALUE strings on top of it (ConfigError if wrong).
    `offboard_silence`: fall silent, as PX4 does, when OFFBOARD is selected while disarmed without set-points.
    """

    def __init__(
        self,
        *,
        airframe: str = "x500",
        boot_sensors: int = 20,
        sysid: int = 1,
        params: Sequence[str] = (),
        faults: Sequence[Fault] = (),
        offboard_silence: bool = True,
    ) -> None:
        self._parser = FrameParser()
        self._encoder = FrameEncoder(sysid, COMPONENT_AUTOPILOT)
        self._out: list[bytes] = []
        self._boot_left = boot_sensors
        self._answering = False  # the first HIL_ACTUATOR_CONTROLS has been made
        self._origin_known = False
        self._silent = False
        self._last_us = -1
        self._text_id = 0
        self._misbehaviour = Misbehaviour(tuple(faults))
        self.steps = 0
        self.ignored = 0

        self.params = ParamTable(_native_params())
        self.params.load_airframe(airframe)
        self.params.load([*params, f"MAV_SYS_ID={sysid}"])
        names = list(_native.PARAM_NAMES)
        self._native_index = {name: index for index, name in enumerate(names)}
        try:
            self._core = _native.FlightCore(np.array([float(self.params[name]) for name in names]))
        except ValueError as error:  # each value is in range, but together they make no vehicle
            raise ConfigError([Problem("parameters", str(error), "check the CA_ROTOR parameters")]) from error
        self._controls = self._core.controls
        self._rotors = int(self.params["CA_ROTOR_COUNT"])
        self._unused = (0.0,) * (_CHANNELS - self._rotors)

        vehicle = self.vehicle = Vehicle()
        self._estimate = Estimate(self._core, vehicle)
        self._sensors = SensorIntake(self._core)
        self._guidance = Guidance(self._core, vehicle, self.params)
        self._offboard = Offboard(self._core, vehicle, self._estimate.ned)
        self._preflight = Preflight(vehicle, self._estimate, self._sensors, self.params)
        failsafe = Failsafe(vehicle, self._estimate, self._sensors, self._offboard, self.params, self.say)
        self.navigator = Navigator(
            self._guidance,
            vehicle,
            self.params,
            project=self._estimate.ned,
            reached=self._on_reached,
            info=lambda text: self.say(Severity.INFO, text),
            set_home=self._set_home,
        )
        self.commander = Commander(
            vehicle,
            self._estimate,
            self._guidance,
            self.params,
            self._preflight,
            failsafe,
            self.navigator,
            self._offboard,
            say=self.say,
            silence=self._fall_silent,
            offboard_silence=offboard_silence,
        )
        self._telemetry = Telemetry(vehicle, self._estimate, self._sensors, self._mission_state)
        self._missions = MissionStore(self._send, self._warn, self._on_mission)
        param_service = ParamService(self.params, self._send_payload, self._start_param_list, self._warn)
        commands = Commands(self.commander, self.navigator, vehicle, self._estimate, self)
        services = Services(
            sysid=sysid,
            vehicle=vehicle,
            commands=commands,
            params=param_service,
            missions=self._missions,
            offboard=self._offboard,
            failsafe=failsafe,
            set_current=self._set_current,
            send=self._send,
        )
        self._handlers = services.handlers
        self._set_up_timers(param_service)
        self.params.on_change = self._on_param
        self.params.after_change = self._guidance.refresh_params
        self._guidance.off()

    def _set_up_timers(self, param_service: ParamService) -> None:
        """Guidance first: telemetry of the same instant then tells what it decided."""
        timers = self._timers = Timers()
        self._guidance_timer = timers.add(self._guide)
        self._mission_timer = timers.add(self._missions.tick)

        def send_param(now_us: int) -> None:  # noqa: ARG001
            if not param_service.send_next():
                timers.stop(self._param_timer)

        self._param_timer = timers.add(send_param)
        self._streams: dict[int, Timer] = {}
        for msgid, maker in self._telemetry.makers.items():

            def tell(now_us: int, maker: Any = maker) -> None:
                self._estimate.refresh(now_us)
                message = maker(now_us)
                if message is not None:
                    self._send(message)

            self._streams[msgid] = timers.add(tell)

    # -- the wire -----------------------------------------------------------------------------------------------

    def boot(self) -> bytes:
        """What PX4 writes before it has heard anything: it asks for HIL_STATE_QUATERNION, and one HEARTBEAT."""
        request = (0, 0, int(Cmd.SET_MESSAGE_INTERVAL), 0, float(_HIL_STATE_QUATERNION), _HIL_SENSOR_INTERVAL_US)
        self._send(_CommandLong(*request, 0.0, 0.0, 0.0, 0.0, 0.0))
        self._send(self._telemetry.makers[MSGID["HEARTBEAT"]](0))
        out = b"".join(self._out)
        self._out.clear()
        return out

    def feed(self, data: bytes) -> bytes:
        """Take `data` and return what the autopilot writes because of it. Raises `faults.Died` only."""
        for frame in self._parser.feed(data):
            msgid = frame[0]
            if msgid == HIL_SENSOR:
                self._on_sensor(frame[4])
            elif msgid == HIL_GPS:
                if not self._silent and self._last_us >= 0:
                    self._sensors.take_gps(frame[4], self._last_us)
            else:
                self._on_other(frame)
        if not self._out or self._silent or not self._answering:
            return b""
        out = b"".join(self._out)
        self._out.clear()
        return out

    def _on_other(self, frame: Frame) -> None:
        handler = self._handlers.get(frame.msgid)
        if handler is None or self._silent:
            self.ignored += 1
            return
        try:
            handler(frame, max(self._last_us, 0))
        except (CodecError, ArithmeticError, ValueError, IndexError, KeyError):
            # A backstop: whatever one frame holds, it does not end the autopilot.
            self.ignored += 1

    def _on_sensor(self, payload: bytes) -> None:
        values = _unpack_sensor(payload)
        now_us = values[0]
        if values[15] != 0 or self._silent or now_us > _LATEST_US:
            self.ignored += 1
            return
        last_us = self._last_us
        if now_us <= last_us:
            # The same instant twice is a duplicate; an earlier one is a clock that PX4 cannot follow.
            self._silent = now_us < last_us
            self.ignored += 1
            return
        self._last_us = self.vehicle.now_us = now_us
        if last_us < 0:
            self._begin(now_us)
        self.steps += 1
        self._sensors.take(now_us, values, payload)
        if now_us >= self._timers.next_due_us:
            self._timers.run(now_us)
        if self._boot_left:
            self._boot_left -= 1
        elif not self._silent:
            self._reply(now_us)

    def _begin(self, now_us: int) -> None:
        """The first sample: the clock starts."""
        self._preflight.begin(now_us)
        self._timers.start(self._guidance_timer, PERIOD_US, now_us)
        self._timers.start(self._mission_timer, _MISSION_PERIOD_US, now_us)
        for name, period_us in DEFAULT_PERIOD_US.items():
            if period_us:
                self._timers.start(self._streams[MSGID[name]], period_us, now_us)

    def _reply(self, now_us: int) -> None:
        if self.vehicle.armed:
            # PX4's outputs have steps of 1/1000.
            controls = [round(u * 1000.0) / 1000.0 for u in self._controls.tolist()[: self._rotors]]
            controls += self._unused
            mode = _MODE_ARMED
        else:
            controls = [0.0] * _CHANNELS
            mode = _MODE_DISARMED
        self._telemetry.controls = controls
        t_us = now_us
        misbehaving = now_us >= self._misbehaviour.earliest_us
        if misbehaving:
            t_us = self._misbehaviour.reply_time_us(now_us)
        frame = self._encoder.frame(HIL_ACTUATOR_CONTROLS, _pack_actuators(t_us, _FLAGS_LOCKSTEP, *controls, mode))
        if misbehaving:
            frame = self._misbehaviour.output(now_us, b"".join(self._out), frame)
            self._out.clear()
        self._out.append(frame)
        self._answering = True

    # -- what the parts need of the whole -----------------------------------------------------------------------

    def _send(self, message: Any) -> None:
        self._out.append(self._encoder.frame(message.MSGID, pack(message)))

    def _send_payload(self, msgid: int, payload: bytes) -> None:
        self._out.append(self._encoder.frame(msgid, payload))

    def say(self, severity: Severity, text: str) -> None:
        """STATUSTEXT, in chunks of 50 characters where it is longer. The field holds bytes: other than ASCII is '?'."""
        text = text.encode("ascii", "replace").decode("ascii")
        if len(text) <= _TEXT_LENGTH:
            self._send(_Text(int(severity), text))
            return
        self._text_id = self._text_id % 65535 + 1
        for chunk, at in enumerate(range(0, len(text), _TEXT_LENGTH)):
            self._send(_Text(int(severity), text[at : at + _TEXT_LENGTH], self._text_id, chunk))

    def _warn(self, text: str) -> None:
        self.say(Severity.WARNING, text)

    def _fall_silent(self) -> None:
        self._silent = True

    def _guide(self, now_us: int) -> None:
        self._estimate.publish(now_us)
        if not self._origin_known and self._estimate.has_origin:
            self._on_origin()
        self.commander.step(now_us)

    def _on_origin(self) -> None:
        """The first fix says where on Earth this is, and with that where magnetic north is."""
        self._origin_known = True
        if self.params["EKF_MAG_DECL"] == 0.0:
            lat_deg, lon_deg, _ = self._estimate.geodetic(0.0, 0.0, 0.0)
            self.params.set("EKF_MAG_DECL", declination_deg(lat_deg, lon_deg))

    def _on_param(self, name: str, value: float) -> str | None:
        index = self._native_index.get(name)
        if index is not None:
            try:
                self._core.set_param(index, float(value))
            except ValueError as error:
                return str(error)
        return None

    def _start_param_list(self) -> None:
        self._timers.start(self._param_timer, _PARAM_PERIOD_US, max(self._last_us, 0))

    def _mission_state(self) -> tuple[int, int, MissionState]:
        return self.navigator.current_seq(), len(self.navigator.items), self.navigator.state()

    def _on_mission(self) -> None:
        self.navigator.load(self._missions.items)

    def _on_reached(self, seq: int) -> None:
        self._send(_Reached(seq))
        self.send_once(MSGID["MISSION_CURRENT"], max(self._last_us, 0))

    def _set_home(self, place: tuple[float, float, float] | None) -> None:
        if not self.commander.set_home(place):
            self._warn("Home not set: no position")

    def _set_current(self, seq: int, now_us: int) -> None:
        if self.navigator.set_current(seq):
            self.send_once(MSGID["MISSION_CURRENT"], now_us)
        else:
            self._warn(f"No mission item {seq}")

    # -- streams, as commands ask for them ----------------------------------------------------------------------

    def set_interval(self, msgid: int, period_us: int, now_us: int) -> bool:
        """Send `msgid` every `period_us` (0: never). False if the mock has no such message."""
        timer = self._streams.get(msgid)
        if timer is None:
            return False
        if period_us > 0:
            self._timers.start(timer, period_us, now_us)
        else:
            self._timers.stop(timer)
        return True

    def default_interval_us(self, msgid: int) -> int:
        """The period a message has by default."""
        return next((period for name, period in DEFAULT_PERIOD_US.items() if MSGID[name] == msgid), 0)

    def send_once(self, msgid: int, now_us: int) -> bool:
        """Send `msgid` now. False if the mock has no such message or nothing to say in it."""
        if msgid == AUTOPILOT_VERSION:
            self._send(autopilot_version(self._encoder.sysid))
            return True
        maker = self._telemetry.makers.get(msgid)
        if maker is None:
            return False
        self._estimate.refresh(now_us)
        message = maker(now_us)
        if message is None:
            return False
        self._send(message)
        return True


def _native_params() -> list[tuple[str, float, float, float]]:
    return list(zip(_native.PARAM_NAMES, _native.PARAM_DEFAULTS, _native.PARAM_MIN, _native.PARAM_MAX, strict=True))
