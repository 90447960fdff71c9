"""Links ArduPilot on a real board, or its SITL on pseudo-terminals: the bench simulates its External AHRS.

ArduPilot has no hardware-in-the-loop mode, but it has a driver for a navigation system on a serial port that can
replace all of its own sensors:

    sensor line     the bench is a VectorNav: answers the driver's set-up, then sends IMU, solution and GNSS packets
    MAVLink line    commands out, telemetry in; motor commands are the pulse widths of SERVO_OUTPUT_RAW

Ticks are those of `realtime.link`; commands leave at once, packets at the tick's deadline.

The main loop of ArduPilot waits for an IMU packet in each of its rounds, so packets must come clearly faster than
SCHED_LOOP_RATE: a tick of 400 Hz serves a loop of 200 Hz, one of 800 Hz a loop of 400 Hz. Without packets the board
stands still, MAVLink included; so `open` waits for the set-up only, and the board boots while simulated time runs.

A board that requests the set-up again has rebooted: an event, and its motors have stopped. A board that booted before
the bench does not request it: it gets the outputs that ArduPilot requests by default.
"""

from __future__ import annotations

import time
from typing import Any

from firmware_bridge.codecs.ardupilot_json import PwmRange
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder
from firmware_bridge.codecs.vectornav import VectorNavDevice, ardupilot_outputs
from firmware_bridge.ground_station.vehicle_link import GCS_SYSID
from firmware_bridge.links.ardupilot.servo_outputs import INTERVALS_US, ServoOutputs
from firmware_bridge.links.ardupilot.vectornav_stream import Geodetic, InsErrors, InsSolution, VectorNavStream
from firmware_bridge.links.autopilot_link import SIMULATOR_COMPID, LinkCaps, LinkTimeouts, TickSamples
from firmware_bridge.links.realtime.health import Finding
from firmware_bridge.links.realtime.link import RealtimeLink
from firmware_bridge.links.timesync import TIMESYNC
from firmware_bridge.transports.transport import Transport
from signals.errors import HandshakeError, LinkClosed, LinkError
from signals.samples import ActuatorFrame, TruthState, Vec3
from signals.time import NS_PER_MS, NS_PER_S

KIND = "ardupilot_eahrs"
_MODEL = "VN-200T"
_SLICE_S = 0.02
_BOOTED_BEFORE_S = 5.0  # without a request: a booting board sends one every 0.5 s
_SENSORS_WITHIN_NS = 3 * NS_PER_S
_ONE_BOOT_NS = 20 * NS_PER_S  # both lines show a reboot, not at the same moment
_TIMEOUTS = LinkTimeouts(reply_s=15.0, connect_s=40.0)


class ExternalAhrsLink(RealtimeLink):
    """One tick each period of wall clock; `sensor` and `mavlink` are the two lines.

    `geodetic` maps a place in W to latitude, longitude and altitude. `baud` of the sensor line is only checked against
    its load. `on_event(kind, text)` gets reboots too. Other settings as `RealtimeLink`.
    """

    _process_outlives_transports = True
    _ignores_sigterm = True  # SITL while its IMU is silent
    _gap_ns = 50 * NS_PER_MS  # the outputs come in bursts where a loop is late; four of 100 Hz missing are a gap

    def __init__(
        self,
        sensor: Transport,
        mavlink: Transport,
        *,
        geodetic: Geodetic,
        errors: InsErrors | None = None,
        pwm: PwmRange | None = None,
        baud: int | None = None,
        timeouts: LinkTimeouts = _TIMEOUTS,
        **settings: Any,
    ) -> None:
        self._sensor = sensor
        self._mavlink = mavlink
        self._geodetic = geodetic
        self._errors = errors if errors is not None else InsErrors()
        self._pwm = pwm if pwm is not None else PwmRange()
        self._baud = baud
        caps = LinkCaps(KIND, lockstep=False, deterministic=False, boot_sensors=0, takes_truth=True)
        super().__init__(
            caps,
            sensor,
            mavlink,
            timeouts=timeouts,
            **settings,
        )

    def _reset(self) -> None:
        super()._reset()
        self._truth: TruthState | None = None
        self._started_ns: int | None = None  # of the run
        self._rebooted_ns: int | None = None
        self._starts = 0
        self.reboots = 0
        self.device = VectorNavDevice(_MODEL)
        solution = InsSolution(self._geodetic, self._errors)
        self._stream = VectorNavStream(self.device, solution, period_ns=self._period_ns)
        # As the ground station: a board may obey no system id but that of its MAV_GCS_SYSID.
        requests = FrameEncoder(GCS_SYSID, SIMULATOR_COMPID)
        self._servos = ServoOutputs(requests, self._pwm, loop_hz=NS_PER_S / self._period_ns / 2)

    def findings(self) -> list[Finding]:
        """Return the faults in this run's timing that affect the autopilot."""
        return [Finding("warning", text) for text in self._stream.problems(self._baud)] + super().findings()

    # ---- opening

    def open(self) -> None:
        """Open both lines, start the process if there is one, answer the set-up, or find that none is requested."""
        super().open()
        self._starts = self.device.starts
        for text in self._stream.problems(self._baud):
            self._on_event("warning", text)

    def _await_autopilot(self) -> None:
        device = self.device
        began_s = time.monotonic()
        while True:
            self._listen(_SLICE_S)
            if device.starts:
                return
            self._check_process("ended before it set up its External AHRS")
            waited_s = time.monotonic() - began_s
            requested = bool(device.commands or device.refused)
            if self._process is None and not requested and waited_s >= _BOOTED_BEFORE_S:
                rate_hz = NS_PER_S // self._period_ns
                device.outputs = ardupilot_outputs(device, rate_hz)
                self._on_event(
                    "resumed",
                    f"the board has not requested a set-up (it booted before?): it gets what ArduPilot requests of a "
                    f"{device.model} with EAHRS_RATE {rate_hz}",
                )
                return
            if waited_s >= self._timeouts.connect_s:
                raise HandshakeError(self._sensor.name, self._setup_failure(), cause="setup")

    def _setup_failure(self) -> str:
        limit = f"within {self._timeouts.connect_s:g} s of wall clock"
        if self.device.refused:
            return f"its set-up of the External AHRS was not completed {limit}: {self.device.refused}. Is EAHRS_TYPE 1?"
        if self.device.commands:
            return (
                f"its set-up of the External AHRS was not completed {limit}, after {self.device.commands} commands: is "
                "the line damaged, or its baud rate wrong?"
            )
        return (
            f"it has not requested the set-up of an External AHRS {limit}. Are EAHRS_TYPE 1 and SERIALn_PROTOCOL 36 "
            "set on this port since its last boot, is SERIALn_BAUD the same on both sides, and TX wired to RX?"
        )

    # ---- one tick

    def observe(self, truth: TruthState, wind_W: Vec3 = (0.0, 0.0, 0.0)) -> None:  # noqa: ARG002 (no wind sensor)
        """Take the vehicle's true state, from which the next `send` makes the device's solution."""
        self._truth = truth

    def send(self, tick: int, t_ns: int, samples: TickSamples, extra: bytes) -> bytes:
        """Write `extra` to the MAVLink line and pass the tick's packets to the sender. Return the MAVLink bytes.

        The packets are not returned: a MAVLink log would take them for frames, and the recording has their samples.
        CodecError if a sample is not a number. LinkError if a sensor that the packets need gives no sample.
        """
        truth = self._truth
        if truth is None or truth.t_ns != t_ns:
            raise LinkError(self.name, f"tick {tick}: `observe` was not called with the truth of {t_ns} ns")
        stats = self._stats
        packets = self._stream.packets(t_ns, truth, samples)
        if t_ns > _SENSORS_WITHIN_NS and self._stream.missing:
            raise LinkError(
                self.name,
                f"no sample of {' and '.join(self._stream.missing)} in {_SENSORS_WITHIN_NS / NS_PER_S:g} s, and its "
                "packets need one: add such a sensor, which feeds the autopilot, to the rig",
            )
        sent = extra + self._servos.request(self._deadline_ns)
        request = self.timesync.request(self._deadline_ns)
        if request is not None and self._mavlink_seen:
            sent += self._encoder.frame(TIMESYNC, request)
        if sent:
            self._write_mavlink(sent)
        if packets:
            self._push(packets, keep=False)  # a late packet is worse than none
        stats.steps += 1
        stats.tx_bytes += len(sent) + len(packets)
        return sent

    # ---- received data

    @property
    def _mavlink_seen(self) -> bool:
        return self._parser.frames > 0

    def _take(self, transport: Transport, data: bytes) -> None:
        if transport is self._sensor:
            self._take_request(data)
        else:
            self._take_mavlink(data)

    def _take_request(self, data: bytes) -> None:
        """Answer the autopilot's driver for the device."""
        device = self.device
        before = device.commands
        answers = device.take(data)
        now_ns = time.monotonic_ns()
        if device.commands != before:
            self._received_ns = now_ns
        if answers:
            if self._line is None:
                self._sensor.write(answers)
            else:
                try:
                    self._line.push(now_ns, answers, keep=True)
                except LinkClosed as error:
                    self._reopen(self._sensor, error)
        if self._line is not None and device.starts != self._starts:
            self._starts = device.starts
            self._rebooted(now_ns, "it has set up its External AHRS again")

    def _take_frame(self, frame: Frame, now_ns: int) -> bool:
        count = self._servos.count
        if self._servos.take_frame(frame, now_ns):
            self._rebooted(now_ns, "its time since boot began anew")
        return self._servos.count != count

    def _command(self, tick: int) -> ActuatorFrame | None:
        if self._started_ns is None:
            self._started_ns = time.monotonic_ns()
        return self._servos.command(tick)

    def _rebooted(self, now_ns: int, how: str) -> None:
        if self._rebooted_ns is not None and now_ns - self._rebooted_ns < _ONE_BOOT_NS:
            return  # the other line has shown it already
        self._rebooted_ns = now_ns
        self._commanded_ns = now_ns
        self.reboots += 1
        self._servos.reset()
        self._on_event("rebooted", f"the autopilot has started again: {how}; its motors have stopped")

    def _write_mavlink(self, data: bytes) -> None:
        try:
            self._mavlink.write(data)
        except LinkClosed as error:
            self._reopen(self._mavlink, error)

    # ---- faults

    def _check_silence(self, now_ns: int) -> None:
        started_ns = self._started_ns or now_ns
        if not self._mavlink_seen:
            if now_ns - started_ns > self._timeouts.connect_s * NS_PER_S:
                self._check_process("ended before its first MAVLink message")
                raise HandshakeError(self._mavlink.name, self._no_mavlink(), cause="no_heartbeat")
            return
        silent_ns = now_ns - self._received_ns
        if silent_ns > self._silence_limit_ns:
            self._check_process("fell silent")
            raise LinkError(
                self.name,
                f"no byte has come for {silent_ns / NS_PER_S:.1f} s, on either line: is it hung? Restart it "
                "(ArduPilot stands still while no IMU packets reach it)",
                cause="silent",
            )
        uncommanded_ns = now_ns - max(self._commanded_ns, started_ns)
        if self._still_hears(now_ns) and uncommanded_ns > self._silence_limit_ns:
            raise HandshakeError(self._mavlink.name, self._no_outputs(), cause="no_controls")

    def _no_mavlink(self) -> str:
        sensor = (
            "it did set up its External AHRS on the sensor line, so it runs"
            if self.device.starts
            else "nor any request on the sensor line; is it powered, and are the ports right?"
        )
        return (
            f"no MAVLink within {self._timeouts.connect_s:g} s, {sensor}. Is SERIALn_PROTOCOL 2 on this port and "
            "SERIALn_BAUD the same on both sides?"
        )

    def _no_outputs(self) -> str:
        servos = self._servos
        if servos.result is None:
            why = f"it never answered the request for them: is MAV_GCS_SYSID not {GCS_SYSID}?"
        elif servos.granted_us is None:
            why = (
                f"it refused them even every {INTERVALS_US[-1]} us (MAV_RESULT {servos.result}); raise SCHED_LOOP_RATE"
            )
        else:
            why = f"it had accepted {servos.granted_us} us: is the MAVLink line too slow (57600 baud is), or full?"
        return f"messages come, but no SERVO_OUTPUT_RAW for {self._silence_limit_ns / NS_PER_S:g} s; {why}"
