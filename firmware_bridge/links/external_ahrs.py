"""ArduPilot on a real board, or its SITL on pseudo-terminals: the bench plays its External AHRS.

ArduPilot has no hardware-in-the-loop mode. What it has is a driver for a navigation system on a serial port, which can
replace all of its own sensors:

    sensor wire     the bench is a VectorNav: answers the driver's set-up, then sends IMU, solution and GNSS packets
    MAVLink wire    commands out, telemetry in; motor commands are the pulse widths of SERVO_OUTPUT_RAW

Order of a tick, k * period after the start on the wall clock:

    begin   listen on both wires until the lead before the deadline; the newest motor commands are latched
    send    commands leave at once; the packets due go to a real-time thread, which writes them at the deadline
    wait    nothing: an answer belongs to no tick

The main loop of ArduPilot waits for an IMU packet in each of its rounds, so packets must come clearly faster than
SCHED_LOOP_RATE: a tick of 400 Hz serves a loop of 200 Hz, one of 800 Hz a loop of 400 Hz. Without packets the board
stands still, MAVLink included; hence `open` waits for the set-up only, and the board boots while simulated time runs.

A board that asks for the set-up again has rebooted: an event, and its motors have stopped. A board that booted before
the bench does not ask: it gets what ArduPilot asks for by default.
"""

from __future__ import annotations

import os
import select
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from firmware_bridge.codecs.ardupilot_json import PwmRange
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.vectornav import VectorNavDevice, ardupilot_outputs
from firmware_bridge.links.actuator_age import ActuatorAge
from firmware_bridge.links.autopilot_link import LinkCaps, LinkStats
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.deadline_schedule import DeadlineSchedule
from firmware_bridge.links.free_running import LEAD_NS, Events
from firmware_bridge.links.ins_solution import Geodetic, InsErrors, InsSolution
from firmware_bridge.links.lockstep import SIMULATOR_COMPID, SIMULATOR_SYSID
from firmware_bridge.links.paced_line import PacedLine
from firmware_bridge.links.realtime_health import Finding, judge_actuators, judge_sending
from firmware_bridge.links.send_stats import SendStats
from firmware_bridge.links.servo_outputs import INTERVALS_US, ServoOutputs
from firmware_bridge.links.timesync import TIMESYNC, TimeSync
from firmware_bridge.links.vectornav_stream import VectorNavStream
from firmware_bridge.transports.transport import Transport
from hil.signals.errors import HandshakeError, LinkClosed, LinkError
from hil.signals.samples import ActuatorFrame, BaroSample, GpsSample, ImuSample, MagSample, Sample, TruthState, Vec3
from hil.signals.time import NS_PER_MS, NS_PER_S

KIND = "ardupilot_eahrs"
_MAX_RATE_HZ = 1000.0
_SLICE_S = 0.02
_REOPEN_S = 0.1
_PATIENCE_S = 5.0  # a booting board asks every 0.5 s
_SENSORS_WITHIN_NS = 3 * NS_PER_S
# The outputs come in bursts where a loop is late; four of a 100 Hz stream missing is a hole.
_GAP_NS = 50 * NS_PER_MS
_ONE_BOOT_NS = 20 * NS_PER_S  # both wires tell of a reboot, not at the same moment


def _tell_nobody(kind: str, text: str) -> None:
    """No events are wanted."""


@dataclass
class ExternalAhrsStats(LinkStats):
    """`steps` counts ticks, `tx_frames` those that carried packets."""

    reboots: int = 0
    commands: int = 0  # of the autopilot to the device: the set-up
    silent_ticks: int = 0  # in which nothing was due, or nothing could be sent


class ExternalAhrsLink:
    """One tick each `period_ns` of wall clock; `sensor` and `mavlink` are the two wires.

    `geodetic` turns a place in W into latitude, longitude and altitude. `baud` of the sensor wire is only checked
    against what has to go through it. `on_event(kind, text)` hears of reboots, unplugging, replugging and slips.
    """

    def __init__(
        self,
        sensor: Transport,
        mavlink: Transport,
        *,
        period_ns: int,
        geodetic: Geodetic,
        model: str = "VN-200T",
        errors: InsErrors | None = None,
        seed: int = 1,
        pwm: PwmRange | None = None,
        baud: int | None = None,
        start_process: Callable[[], ChildProcess] | None = None,
        on_event: Events | None = None,
        native_sender: bool = True,
        silence_limit_s: float = 15.0,
        heartbeat_limit_s: float = 40.0,
        reconnect_s: float = 10.0,
        patience_s: float = _PATIENCE_S,
    ) -> None:
        self._sensor = sensor
        self._mavlink = mavlink
        self._period_ns = period_ns
        self._geodetic = geodetic
        self._model = model
        self._errors = errors if errors is not None else InsErrors()
        self._seed = seed
        self._pwm = pwm if pwm is not None else PwmRange()
        self._baud = baud
        self._start_process = start_process
        self._on_event = on_event or _tell_nobody
        self._native_sender = native_sender
        self._silence_limit_ns = int(silence_limit_s * NS_PER_S)
        self._heartbeat_limit_s = heartbeat_limit_s
        self._reconnect_s = reconnect_s
        self._patience_s = patience_s
        self._caps = LinkCaps(
            KIND, lockstep=False, deterministic=False, max_rate_hz=_MAX_RATE_HZ, boot_sensors=0, takes_truth=True
        )
        self._process: ChildProcess | None = None
        self._line: PacedLine | None = None
        self._reset()

    def _reset(self) -> None:
        self._stats = ExternalAhrsStats()
        self._parser = FrameParser()
        self._encoder = FrameEncoder(SIMULATOR_SYSID, SIMULATOR_COMPID)
        self._frames: list[Frame] = []
        self._truth: TruthState | None = None
        self._deadline_ns = 0
        self._started_ns: int | None = None  # of the run
        self._heard_ns = 0  # anything, on either wire
        self._commanded_ns = 0  # SERVO_OUTPUT_RAW
        self._rebooted_ns: int | None = None
        self._starts = 0
        self._slips_told = 0
        device = VectorNavDevice(self._model)
        self.device = device
        self._stream = VectorNavStream(
            device, InsSolution(self._geodetic, self._errors, seed=self._seed), period_ns=self._period_ns
        )
        self._servos = ServoOutputs(self._encoder, self._pwm, loop_hz=NS_PER_S / self._period_ns / 2)
        self.age = ActuatorAge(gap_ns=_GAP_NS)
        self.timesync = TimeSync(rate_hz=5.0)
        self.reconnects = 0
        self.schedule = DeadlineSchedule(
            period_ns=self._period_ns, lead_ns=LEAD_NS, clock_ns=time.monotonic_ns, sleep_s=self._listen
        )

    @property
    def caps(self) -> LinkCaps:
        return self._caps

    @property
    def stats(self) -> ExternalAhrsStats:
        """Counters; brought up to date by reading this property."""
        stats = self._stats
        stats.take_received(self._parser)
        stats.rtt = self.timesync.rtt
        stats.commands = self.device.commands
        if self._line is not None:
            stats.late = self._line.stats().late_2ms
        return stats

    @property
    def name(self) -> str:
        return f"autopilot ({KIND}, {self._sensor.name}, {self._mavlink.name})"

    @property
    def servo_interval_us(self) -> int | None:
        """How often the autopilot agreed to tell its outputs; None before it did."""
        return self._servos.granted_us

    def send_stats(self) -> SendStats | None:
        """How punctual the packets were; None before `open`."""
        return None if self._line is None else self._line.stats()

    def findings(self) -> list[Finding]:
        """What in this run's timing was bad for the autopilot."""
        self.age.finish(time.monotonic_ns())
        found = [Finding("warning", text) for text in self._stream.problems(self._baud)]
        if self._line is not None:
            found += judge_sending(self._line.stats(), self.schedule)
        return found + judge_actuators(self.age)

    # ---- opening and closing

    def open(self) -> None:
        """Open both wires, start the process if there is one, answer the set-up, or find that none is asked for."""
        self._reset()
        self._line = None
        try:
            self._sensor.open()
            self._mavlink.open()
            if self._start_process is not None:
                self._process = self._start_process()
                self._process.start()
            self._await_setup()
            self._line = PacedLine(self._sensor, period_ns=self._period_ns, native=self._native_sender)
        except BaseException:
            self.close()
            raise
        self._starts = self.device.starts
        for text in self._stream.problems(self._baud):
            self._on_event("warning", text)

    def close(self) -> None:
        if self._line is not None:
            self._line.stop()
        self._sensor.close()
        self._mavlink.close()
        process, self._process = self._process, None
        if process is not None:
            if process.running() and process.pid is not None:
                # SITL whose IMU is silent does not hear SIGTERM.
                os.kill(process.pid, signal.SIGKILL)
            process.close()

    def _await_setup(self) -> None:
        device = self.device
        began_s = time.monotonic()
        while True:
            self._listen(_SLICE_S)
            if device.starts:
                return
            self._check_process("ended before it set up its External AHRS")
            waited_s = time.monotonic() - began_s
            asked = bool(device.commands or device.refused)
            if self._process is None and not asked and waited_s >= self._patience_s:
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

    def begin(self, tick: int) -> ActuatorFrame | None:
        """Wait for the tick's time; the newest command, or None if none has come since the last tick.

        LinkClosed: a wire is gone and has not come back. HandshakeError: it talks, but does not tell its outputs.
        """
        self._deadline_ns = self.schedule.wait_until_due(tick)
        self._listen(0.0)
        assert self._line is not None
        failure = self._line.failure(self._sensor.name)
        if failure is not None:
            self._reopen(self._sensor, failure)
        for slip in self.schedule.slips[self._slips_told :]:
            self._on_event(
                "slip", f"the bench fell {slip.moved_ns / NS_PER_MS:.0f} ms behind the wall clock and let go"
            )
        self._slips_told = len(self.schedule.slips)
        now_ns = time.monotonic_ns()
        if self._started_ns is None:
            self._started_ns = now_ns
        self.age.used(now_ns)
        command = self._servos.take(tick)
        if command is None:
            self._check_silence(now_ns)
        return command

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
            assert self._line is not None
            try:
                self._line.push(self._deadline_ns, packets, keep=False)  # better dropped than late
            except LinkClosed as error:
                self._reopen(self._sensor, error)
            stats.tx_frames += 1
        else:
            stats.silent_ticks += 1
        self.schedule.note_handed_over(tick)
        stats.steps += 1
        stats.tx_bytes += len(said) + len(packets)
        return said

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:  # noqa: ARG002
        """Nothing to wait for."""
        return None

    def take_frames(self) -> list[Frame]:
        """Every MAVLink frame received since the last call, in order."""
        frames, self._frames = self._frames, []
        return frames

    # ---- what comes in

    @property
    def _heard_mavlink(self) -> bool:
        return self._parser.frames > 0

    def _listen(self, for_s: float) -> None:
        """Take in what comes on both wires for so long; what comes is stamped when it comes."""
        end_ns = time.monotonic_ns() + int(for_s * NS_PER_S)
        while True:
            left_ns = end_ns - time.monotonic_ns()
            fds = [fd for fd in (self._sensor.fileno(), self._mavlink.fileno()) if fd is not None]
            # poll's own unit is a millisecond: too coarse for a deadline.
            if fds:
                select.select(fds, [], [], max(left_ns, 0) / NS_PER_S)
            asked = self._read(self._sensor)
            if asked:
                self._take_asked(asked)
            told = self._read(self._mavlink)
            if told:
                self._take_told(told)
            if not asked and not told and (left_ns <= 0 or not fds):
                return

    def _read(self, wire: Transport) -> bytes:
        try:
            return wire.read(0.0)
        except LinkClosed as error:
            self._reopen(wire, error)
            return b""

    def _take_asked(self, data: bytes) -> None:
        """The autopilot's driver speaks to the device."""
        device = self.device
        before = device.commands
        answers = device.take(data)
        self._stats.rx_bytes += len(data)
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

    def _take_told(self, data: bytes) -> None:
        now_ns = time.monotonic_ns()
        self._stats.rx_bytes += len(data)
        frames = self._parser.feed(data)
        if frames:
            self._heard_ns = now_ns
        servos = self._servos
        for frame in frames:
            count = servos.count
            if servos.heard(frame, now_ns):
                self._rebooted(now_ns, "its time since boot began anew")
            if servos.count != count:
                self._commanded_ns = now_ns
                self.age.arrived(now_ns)
            elif frame[0] == TIMESYNC and frame[2] == 1:
                self.timesync.take(frame, now_ns)
        self._frames += frames

    def _rebooted(self, now_ns: int, how: str) -> None:
        if self._rebooted_ns is not None and now_ns - self._rebooted_ns < _ONE_BOOT_NS:
            return  # the other wire has told already
        self._rebooted_ns = now_ns
        self._commanded_ns = now_ns
        self._stats.reboots += 1
        self._servos.start_again()
        self._on_event("rebooted", f"the autopilot has started again: {how}; its motors have stopped")

    def _write_mavlink(self, data: bytes) -> None:
        try:
            self._mavlink.write(data)
        except LinkClosed as error:
            self._reopen(self._mavlink, error)

    # ---- what goes wrong

    def _check_process(self, when: str) -> None:
        process = self._process
        if process is not None and not process.running():
            raise LinkClosed(self.name, f"{when}: {process.describe_end()}", cause="crashed")

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

    def _reopen(self, wire: Transport, error: LinkClosed) -> None:
        """Wait for `wire` to come back; simulated time stands still. LinkClosed if it does not, or may not."""
        process = self._process
        if process is not None and not process.running():
            raise LinkClosed(self.name, f"{error}; {process.describe_end()}", cause="crashed") from error
        if self._reconnect_s <= 0.0:
            raise LinkClosed(self.name, str(error), cause="unplugged") from error
        gone_ns = time.monotonic_ns()
        self._on_event("unplugged", f"{wire.name} is gone: {error}")
        if wire is self._sensor and self._line is not None:
            self._line.stop()
        wire.close()
        while True:
            try:
                wire.open()
                break
            except LinkError as still:
                if time.monotonic_ns() - gone_ns > self._reconnect_s * NS_PER_S:
                    text = f"{error}; it did not come back within {self._reconnect_s:g} s ({still})"
                    raise LinkClosed(wire.name, text, cause="unplugged") from error
            time.sleep(_REOPEN_S)
        if wire is self._sensor and self._line is not None:
            self._line = self._line.renewed(wire)
        self.reconnects += 1
        self._heard_ns = self._commanded_ns = time.monotonic_ns()
        self._on_event("replugged", f"{wire.name} is back after {(self._heard_ns - gone_ns) / NS_PER_S:.1f} s")
