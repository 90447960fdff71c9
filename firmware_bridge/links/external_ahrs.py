"""ArduPilot on a real board, or its SITL on pseudo-terminals: the bench plays its External AHRS.

ArduPilot has no hardware-in-the-loop mode. What it has is a driver for a navigation system on a serial port, which can
replace all of its own sensors:

    sensor wire     the bench is a VectorNav: answers the driver's set-up, then sends IMU, solution and GNSS packets
    MAVLink wire    commands out, telemetry in; motor commands are the pulse widths of SERVO_OUTPUT_RAW

Ticks are those of `realtime_link`; commands leave at once, the packets due at the tick's deadline.

The main loop of ArduPilot waits for an IMU packet in each of its rounds, so packets must come clearly faster than
SCHED_LOOP_RATE: a tick of 400 Hz serves a loop of 200 Hz, one of 800 Hz a loop of 400 Hz. Without packets the board
stands still, MAVLink included; hence `open` waits for the set-up only, and the board boots while simulated time runs.

A board that asks for the set-up again has rebooted: an event, and its motors have stopped. A board that booted before
the bench does not ask: it gets what ArduPilot asks for by default.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from firmware_bridge.codecs.ardupilot_json import PwmRange
from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.vectornav import VectorNavDevice, ardupilot_outputs
from firmware_bridge.links.autopilot_link import LinkCaps
from firmware_bridge.links.realtime_health import Finding
from firmware_bridge.links.realtime_link import RealtimeLink
from firmware_bridge.links.servo_outputs import INTERVALS_US, ServoOutputs
from firmware_bridge.links.timesync import TIMESYNC
from firmware_bridge.links.vectornav_stream import Geodetic, InsErrors, InsSolution, VectorNavStream
from firmware_bridge.transports.transport import Transport
from hil.signals.errors import HandshakeError, LinkClosed, LinkError
from hil.signals.samples import ActuatorFrame, BaroSample, GpsSample, ImuSample, MagSample, Sample, TruthState, Vec3
from hil.signals.time import NS_PER_MS, NS_PER_S

KIND = "ardupilot_eahrs"
_MODEL = "VN-200T"
_SLICE_S = 0.02
_BOOTED_BEFORE_S = 5.0  # without a question: a booting board asks every 0.5 s
_SENSORS_WITHIN_NS = 3 * NS_PER_S
# The outputs come in bursts where a loop is late; four of a 100 Hz stream missing is a hole.
_GAP_NS = 50 * NS_PER_MS
_ONE_BOOT_NS = 20 * NS_PER_S  # both wires tell of a reboot, not at the same moment


class ExternalAhrsLink(RealtimeLink):
    """One tick each period of wall clock; `sensor` and `mavlink` are the two wires.

    `geodetic` turns a place in W into latitude, longitude and altitude. `baud` of the sensor wire is only checked
    against what has to go through it. `on_event(kind, text)` hears of reboots too. Other settings as `RealtimeLink`.
    """

    _process_outlives_wires = True

    def __init__(
        self,
        sensor: Transport,
        mavlink: Transport,
        *,
        geodetic: Geodetic,
        errors: InsErrors | None = None,
        seed: int = 1,
        pwm: PwmRange | None = None,
        baud: int | None = None,
        silence_limit_s: float = 15.0,
        heartbeat_limit_s: float = 40.0,
        **settings: Any,
    ) -> None:
        self._sensor = sensor
        self._mavlink = mavlink
        self._geodetic = geodetic
        self._errors = errors if errors is not None else InsErrors()
        self._seed = seed
        self._pwm = pwm if pwm is not None else PwmRange()
        self._baud = baud
        caps = LinkCaps(KIND, lockstep=False, deterministic=False, boot_sensors=0, takes_truth=True)
        super().__init__(
            caps,
            sensor,
            mavlink,
            silence_limit_s=silence_limit_s,
            heartbeat_limit_s=heartbeat_limit_s,
            gap_ns=_GAP_NS,
            deaf=True,  # SITL whose IMU is silent
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
        solution = InsSolution(self._geodetic, self._errors, seed=self._seed)
        self._stream = VectorNavStream(self.device, solution, period_ns=self._period_ns)
        self._servos = ServoOutputs(self._encoder, self._pwm, loop_hz=NS_PER_S / self._period_ns / 2)

    @property
    def servo_interval_us(self) -> int | None:
        """How often the autopilot agreed to tell its outputs; None before it did."""
        return self._servos.granted_us

    def findings(self) -> list[Finding]:
        """What in this run's timing was bad for the autopilot."""
        return [Finding("warning", text) for text in self._stream.problems(self._baud)] + super().findings()

    # ---- opening

    def open(self) -> None:
        """Open both wires, start the process if there is one, answer the set-up, or find that none is asked for."""
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
            asked = bool(device.commands or device.refused)
            if self._process is None and not asked and waited_s >= _BOOTED_BEFORE_S:
                rate_hz = NS_PER_S // self._period_ns
                device.outputs = ardupilot_outputs(device, rate_hz)
                self._on_event(
                    "resumed",
                    f"the board has not asked for a set-up (it booted before?): it gets what ArduPilot asks of a "
                    f"{device.model} with EAHRS_RATE {rate_hz}",
                )
                return
            if waited_s >= self._heartbeat_limit_s:
                raise HandshakeError(self._sensor.name, self._setup_failure(), cause="setup")

    def _setup_failure(self) -> str:
        limit = f"within {self._heartbeat_limit_s:g} s of wall clock"
        if self.device.refused:
            return f"its set-up of the External AHRS was not completed {limit}: {self.device.refused}"
        if self.device.commands:
            return f"its set-up of the External AHRS was not completed {limit}, after {self.device.commands} commands"
        return (
            f"it has not asked for the set-up of an External AHRS {limit}. Are EAHRS_TYPE 1 and SERIALn_PROTOCOL 36 "
            "set on this port since its last boot, is SERIALn_BAUD the same on both sides, and TX wired to RX?"
        )

    # ---- one tick

    def observe(self, truth: TruthState, wind_W: Vec3 = (0.0, 0.0, 0.0)) -> None:  # noqa: ARG002 (it feels none)
        """The vehicle's true state, out of which the next `send` makes the device's solution."""
        self._truth = truth

    def send(
        self,
        tick: int,
        t_ns: int,
        imu: ImuSample | None,
        mag: MagSample | None,
        baro: BaroSample | None,
        gps: GpsSample | None,
        extra: bytes,
        ranging: Sequence[Sample] = (),  # noqa: ARG002 (a VectorNav has none)
    ) -> bytes:
        """Write `extra` to the MAVLink wire and hand the tick's packets to the sender; what went over the MAVLink wire.

        The packets are not in what is returned: a MAVLink log would take them for frames, and the recording has the
        samples that they are made of. CodecError if a sample is not a number. LinkError if a sensor that the packets
        need gives none.
        """
        truth = self._truth
        if truth is None or truth.t_ns != t_ns:
            raise LinkError(self.name, f"tick {tick}: `observe` was not called with the truth of {t_ns} ns")
        stats = self._stats
        packets = self._stream.packets(t_ns, truth, imu, mag, baro, gps)
        if t_ns > _SENSORS_WITHIN_NS and self._stream.missing:
            raise LinkError(
                self.name,
                f"no sample of {' and '.join(self._stream.missing)} in {_SENSORS_WITHIN_NS / NS_PER_S:g} s, and its "
                "packets need one: the rig must have one that feeds the autopilot",
            )
        said = extra + self._servos.request(self._deadline_ns)
        question = self.timesync.request(self._deadline_ns)
        if question is not None and self._heard_mavlink:
            said += self._encoder.frame(TIMESYNC, question)
        if said:
            self._write_mavlink(said)
        if packets:
            self._push(packets, keep=False)  # better dropped than late
        stats.steps += 1
        stats.tx_bytes += len(said) + len(packets)
        return said

    # ---- what comes in

    @property
    def _heard_mavlink(self) -> bool:
        return self._parser.frames > 0

    def _take(self, wire: Transport, data: bytes) -> None:
        if wire is self._sensor:
            self._take_asked(data)
        else:
            self._take_mavlink(data)

    def _take_asked(self, data: bytes) -> None:
        """The autopilot's driver speaks to the device."""
        device = self.device
        before = device.commands
        answers = device.take(data)
        now_ns = time.monotonic_ns()
        if device.commands != before:
            self._heard_ns = now_ns
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

    def _hear(self, frame: Frame, now_ns: int) -> bool:
        count = self._servos.count
        if self._servos.heard(frame, now_ns):
            self._rebooted(now_ns, "its time since boot began anew")
        return self._servos.count != count

    def _command(self, tick: int) -> ActuatorFrame | None:
        if self._started_ns is None:
            self._started_ns = time.monotonic_ns()
        return self._servos.take(tick)

    def _rebooted(self, now_ns: int, how: str) -> None:
        if self._rebooted_ns is not None and now_ns - self._rebooted_ns < _ONE_BOOT_NS:
            return  # the other wire has told already
        self._rebooted_ns = now_ns
        self._commanded_ns = now_ns
        self.reboots += 1
        self._servos.start_again()
        self._on_event("rebooted", f"the autopilot has started again: {how}; its motors have stopped")

    def _write_mavlink(self, data: bytes) -> None:
        try:
            self._mavlink.write(data)
        except LinkClosed as error:
            self._reopen(self._mavlink, error)

    # ---- what goes wrong

    def _check_silence(self, now_ns: int) -> None:
        started_ns = self._started_ns or now_ns
        if not self._heard_mavlink:
            if now_ns - started_ns > self._heartbeat_limit_s * NS_PER_S:
                self._check_process("ended before it said anything over MAVLink")
                raise HandshakeError(self._mavlink.name, self._no_mavlink(), cause="no_heartbeat")
            return
        silent_ns = now_ns - self._heard_ns
        if silent_ns > self._silence_limit_ns:
            self._check_process("fell silent")
            raise LinkError(
                self.name,
                f"nothing was heard of it for {silent_ns / NS_PER_S:.1f} s, on either wire: hung? "
                "(ArduPilot stands still while no IMU packets reach it)",
                cause="silent",
            )
        talks = silent_ns < self._silence_limit_ns // 2
        if talks and now_ns - max(self._commanded_ns, started_ns) > self._silence_limit_ns:
            raise HandshakeError(self._mavlink.name, self._no_outputs(), cause="no_controls")

    def _no_mavlink(self) -> str:
        asked = (
            "it did set up its External AHRS on the sensor wire, so it runs"
            if self.device.starts
            else "nor did it ask for anything on the sensor wire (powered? the right ports?)"
        )
        return (
            f"no MAVLink within {self._heartbeat_limit_s:g} s, {asked}. Is SERIALn_PROTOCOL 2 on this port and "
            "SERIALn_BAUD the same on both sides?"
        )

    def _no_outputs(self) -> str:
        servos = self._servos
        if servos.result is None:
            why = "it never answered the request for them: is its system id 1, and nobody else its only ground station?"
        elif servos.granted_us is None:
            why = f"it refused them even every {INTERVALS_US[-1]} us (MAV_RESULT {servos.result})"
        else:
            why = f"it had agreed to {servos.granted_us} us: is the MAVLink line too slow (57600 baud is), or full?"
        return f"it talks, but has sent no SERVO_OUTPUT_RAW for {self._silence_limit_ns / NS_PER_S:g} s; {why}"
