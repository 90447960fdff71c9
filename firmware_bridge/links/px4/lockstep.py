"""MAVLink lockstep with PX4 SITL or the mock: one HIL_SENSOR out, one HIL_ACTUATOR_CONTROLS of the same time back.

Order of a tick, which makes runs repeatable:

    send   one write: [extra][HIL_GPS if due][HIL_SENSOR id 0]. Where commands have a connection of their own (PX4
           SITL), `extra` goes there first, and the link waits until PX4 has read it
    wait   read until the answer with the same time_usec. All messages before it belong to this tick; messages after it
           in the same read belong to the next one. The division of the bytes into reads, and its timing, has no effect.

A booting autopilot does not answer. If the number of those first HIL_SENSORs is known (`boot_sensors`), the link does
not read during them, so that the run does not depend on the arrival of bytes. If it is unknown (PX4 SITL), they are
sent at wall-clock pace until the first answer; a run then depends on the firmware's boot and is not deterministic.

The link never invents a command: a late, wrong or missing answer ends the run with a named error. Before that it
listens a little longer and sends probes to find the cause (`silence`); they do not move the vehicle. Bytes outside of
frames are counted and otherwise ignored.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.hil import (
    HIL_ACTUATOR_CONTROLS,
    HIL_GPS,
    HIL_SENSOR,
    actuator_frame,
    hil_gps_payload,
    hil_sensor_payload,
)
from firmware_bridge.codecs.hil_ranging import ranging_message
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.links.autopilot_link import (
    SIMULATOR_COMPID,
    SIMULATOR_SYSID,
    AutopilotLink,
    InvalidControls,
    LinkCaps,
    LinkStats,
    LinkTimeouts,
    TickSamples,
)
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.px4.ground_channel import GroundChannel
from firmware_bridge.links.silence import Diagnosis, VehicleMonitor, process_is_stopped
from firmware_bridge.links.timesync import TIMESYNC
from firmware_bridge.transports.transport import Transport
from signals.errors import HandshakeError, LinkClosed, LinkError, LockstepLost
from signals.samples import ActuatorFrame, BaroSample, DifferentialPressureSample, ImuSample, MagSample, VaneSample

_HEARTBEAT = MSGID["HEARTBEAT"]


# After a quiet line for this long the parser scans its held bytes again, and the process is checked.
_SLICE_S = 0.05
# PX4's first answer came after 12 to 36 HIL_SENSORs; after this many none will come.
_BOOT_SENSORS_LIMIT = 2500
# Diagnosis of a missing answer: how much longer to listen, and the probes after that. A heartbeat comes once a
# (simulated) second.
_LINGER_S = 1.0
# While PX4 boots, simulated time is this much slower than the wall clock: at real-time pace the first answer in time
# came at tick 13 to 15, at this pace at tick 9 in every run.
_BOOT_SLOWNESS = 6
# PX4's vtol_att_control publishes torques for the inputs of one controller or of both, by its mode: where the mode
# changes this is twice in a tick, or not at all. Its motors then keep their commands, and it answers the next tick.
_HOLD_S, _MOST_HELD = 0.5, 3
_COUNTED_ANSWERS = 256  # whose times are counted at once
_PROBE_STEP_NS = 4_000_000
_PROBES = 350
_PROBES_INTO_SILENCE = 128
_PROBE_WAIT_S = 0.002

_NO_IMU = (
    "this tick's HIL_SENSOR carried no IMU sample (a declared drop-out?), and PX4 only answers with one; set the IMU's "
    "rate to the tick's, or end the drop-out"
)
_LOST = "it answers later messages: this one, or its answer, was lost or damaged on the link; check cable and baud rate"
# TCP loses no bytes.
_SKIPPED = (
    "it answers later messages but skipped this one: a declared fault of the link, or a tick of 400 Hz or more, which "
    "PX4 answers one to one only with IMU_INTEG_RATE at the tick's rate and SDLOG_MODE -1 (the bench sets both if it "
    "starts PX4; otherwise PX4_PARAM_... in PX4's environment)"
)
_TIMEOUTS = LinkTimeouts()


class AirTemperature:
    """Temperature of the air in HIL_SENSOR: the pitot's newest, in place of the barometer's.

    PX4 takes the temperature of HIL_SENSOR for that of its differential pressure sensor, and this one for the air's:
    from it and the static pressure come the density and the true airspeed. With a barometer that its board has warmed
    to 40 degC in air of 12 degC the true airspeed was 5 % too high, and the estimate of the wind wrong by it.
    """

    def __init__(self) -> None:
        self._degc: float | None = None  # None: as the barometer measures it

    def put(self, samples: TickSamples) -> TickSamples:
        """Return the samples of a tick, that of the barometer with the temperature of the air."""
        for sample in samples.others:
            if isinstance(sample, DifferentialPressureSample):
                self._degc = sample.temperature_degc
        baro = samples.baro
        if baro is None or self._degc is None:
            return samples
        return samples._replace(baro=baro._replace(temperature_degc=self._degc))


def tick_messages(encoder: FrameEncoder, t_ns: int, samples: TickSamples, *, request: bytes | None = None) -> bytes:
    """Return [range, flow, vision][TIMESYNC if there is a `request`][HIL_GPS if given][HIL_SENSOR id 0].

    HIL_SENSOR has the newest differential pressure of the others; no message has the angles of vanes.
    CodecError if a sample is not a number.
    """
    imu, mag, baro, gps, others = samples
    data = b""
    pitot: DifferentialPressureSample | None = None
    for sample in others:
        if isinstance(sample, DifferentialPressureSample):
            pitot = sample
        elif not isinstance(sample, VaneSample):
            data += encoder.frame(*ranging_message(t_ns, sample))
    if request is not None:
        data += encoder.frame(TIMESYNC, request)
    if gps is not None:
        data += encoder.frame(HIL_GPS, hil_gps_payload(t_ns, gps))
    data += encoder.frame(HIL_SENSOR, hil_sensor_payload(t_ns, imu, mag, baro, pitot))
    return data


class LockstepLink(AutopilotLink):
    """Lockstep over `transport`; `ground` is a second connection, for commands."""

    def __init__(
        self,
        transport: Transport,
        caps: LinkCaps,
        *,
        start_process: Callable[[], ChildProcess] | None = None,
        ground: GroundChannel | None = None,
        timeouts: LinkTimeouts = _TIMEOUTS,
    ) -> None:
        self._transport = transport
        self._ground = ground
        self._timeouts = timeouts
        super().__init__(caps, transport, unnamed=ground, start_process=start_process)

    def _reset(self) -> None:
        self._stats = LinkStats()
        self._parser = FrameParser()
        self._encoder = FrameEncoder(SIMULATOR_SYSID, SIMULATOR_COMPID)
        self._vehicle = VehicleMonitor()
        self._imu_sent = True
        self._imu: ImuSample | None = None  # the newest of each that was sent
        self._mag: MagSample | None = None
        self._baro: BaroSample | None = None
        self._air = AirTemperature() if self._caps.air_temperature else None
        self._answer: Frame | None = None  # the newest
        self._rtts_ns: list[int] = []  # not yet in the statistics
        self._unseen: list[Frame] = []  # by the monitor
        self._held_ticks = 0  # without an answer, in a row
        self._ground_read = False  # in the present tick, before its answer came
        self._held: list[Frame] = []  # came after the last answer: they belong to the next tick
        self._booting = self._caps.boot_sensors != 0
        self._last_t_ns: int | None = None
        self._sent_at_ns = 0
        self._before_wait = (0, 0)  # frames and damaged bytes when the wait began, for the error message
        self._boot_due_ns = 0

    def _parsers(self) -> Sequence[FrameParser]:
        return (self._parser,) if self._ground is None else (self._parser, self._ground.parser)

    def _await_far_side(self) -> None:
        """Wait for the first heartbeat."""
        deadline = time.monotonic() + self._timeouts.connect_s
        while True:
            left_s = deadline - time.monotonic()
            frames = self._parser.feed(self._read(min(max(left_s, 0.0), _SLICE_S)))
            for i, frame in enumerate(frames):
                if frame.msgid == _HEARTBEAT:
                    self._frames += frames[: i + 1]
                    self._held = frames[i + 1 :]
                    self._check_ours()
                    return
            self._frames += frames
            self._check_process("ended before its first heartbeat")
            if left_s <= 0.0 or (not frames and self._transport.fileno() is None):
                raise HandshakeError(self.name, self._no_heartbeat())

    def _check_ours(self) -> None:
        """Raise LinkClosed if another program answers than the one that the link started."""
        if self._process is not None and not self._process.running():
            raise LinkClosed(
                self.name,
                "another program answers instead of the one that was started, which has ended: stop it, or choose "
                f"another autopilot.instance; {self._process.describe_end()}",
                cause="second_autopilot",
            )

    def _no_heartbeat(self) -> str:
        if self._ground is not None and self._process is None and not self._stats.rx_bytes:
            why = (
                "a PX4 of this instance runs but does not connect: once its simulator has gone it never connects "
                "again; start PX4 anew for every run"
                if self._ground.far_side_bound()
                else "no program connected; start PX4 with PX4_SIM_MODEL=none_iris, of the same instance"
            )
            return f"no heartbeat within {self._timeouts.connect_s:g} s of wall clock: {why}"
        parser = self._parser
        seen = (
            f"{parser.frames} other messages came"
            if parser.frames
            else f"{self._stats.rx_bytes} bytes came, none of them a MAVLink message; check baud rate and device"
            if self._stats.rx_bytes
            else "no bytes came at all; is it powered and started, and is the port right?"
        )
        return f"no heartbeat within {self._timeouts.connect_s:g} s of wall clock; {seen}"

    def send(self, tick: int, t_ns: int, samples: TickSamples, extra: bytes) -> bytes:  # noqa: ARG002 (only the time)
        """Write and return [extra][range and flow][HIL_GPS][HIL_SENSOR]. CodecError if a sample is not a number."""
        encoder, stats = self._encoder, self._stats
        data = b""
        if extra:
            self._vehicle.sent(extra)
            if self._ground is None:
                data = extra
            else:
                self._ground.write(extra)
        if self._air is not None and (samples.baro is not None or samples.others):
            samples = self._air.put(samples)
        data += tick_messages(encoder, t_ns, samples)
        try:
            self._transport.write(data)
        except LinkClosed as error:
            raise self._closed(error) from error
        self._sent_at_ns = time.perf_counter_ns()
        # What does not have to be done before the write is done here, while the autopilot computes.
        imu, mag, baro, _, _ = samples
        self._imu_sent = imu is not None
        self._imu, self._mag, self._baro = imu or self._imu, mag or self._mag, baro or self._baro
        self._vehicle.received(self._unseen)
        if len(self._rtts_ns) >= _COUNTED_ANSWERS:
            self._count_answers()
        stats.steps += 1
        if self._ground is not None:
            data = extra + data
        stats.tx_bytes += len(data)
        return data

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        """Return the answer to `t_ns`, or None while the autopilot boots.

        The module's header lists the errors that end the run.
        """
        if self._booting:
            boot_sensors = self._caps.boot_sensors
            if boot_sensors is None:
                return self._wait_while_booting(tick, t_ns)
            if self._stats.steps <= boot_sensors:
                return None
            self._booting = False
        want_us = t_ns // 1000
        self._ground_read = False
        ground_read = False
        if self.busy_wait_ns and self._ground is not None:
            # On a processor of its own, while PX4 computes. A datagram that comes later belongs to the next tick.
            self._frames += self._ground.read()
            ground_read = True
        self._before_wait = (len(self._frames), self._parser.garbage_bytes)
        frames = self._held
        if frames:
            self._held = []
        else:
            frames = self._parser.feed(self._read(_SLICE_S))
        deadline_ns = 0
        while True:
            answer = self._find_answer(frames, want_us)
            if answer is not None:
                self._rtts_ns.append(time.perf_counter_ns() - self._sent_at_ns)
                self._answer, self._held_ticks = answer, 0
                self._ground_read = ground_read
                return self._decode(tick, answer)
            if not deadline_ns:
                deadline_ns = self._sent_at_ns + int(self._timeouts.reply_s * 1e9)
            now_ns = time.perf_counter_ns()
            if self._holds(now_ns):
                return self._hold(tick)
            left_s = (deadline_ns - now_ns) * 1e-9
            if left_s <= 0.0:
                raise self._lost(want_us)
            frames = self._feed(min(left_s, _SLICE_S))
            if not frames:
                frames = self._quiet(want_us)

    def _holds(self, now_ns: int) -> bool:
        """Return True if an autopilot that leaves single ticks out has left out this one."""
        return (
            self._caps.uneven_answers
            and self._answer is not None
            and self._held_ticks < _MOST_HELD
            and now_ns - self._sent_at_ns > _HOLD_S * 1e9
        )

    def _hold(self, tick: int) -> ActuatorFrame:
        """Return the command before, which the motors of such an autopilot hold, too."""
        self._held_ticks += 1
        self._stats.unanswered += 1
        assert self._answer is not None
        return self._decode(tick, self._answer)

    def _feed(self, timeout_s: float) -> list[Frame]:
        """Return the frames completed by one read."""
        return self._parser.feed(self._read(timeout_s))

    def _read(self, timeout_s: float) -> bytes:
        read, data = self._transport.read, b""
        try:
            if self.busy_wait_ns:
                until_ns = time.perf_counter_ns() + self.busy_wait_ns
                while not data and time.perf_counter_ns() < until_ns:
                    data = read(0.0)
            data = data or read(timeout_s)
        except LinkClosed as error:
            raise self._closed(error) from error
        self._stats.rx_bytes += len(data)
        return data

    def _find_answer(self, frames: list[Frame], want_us: int) -> Frame | None:
        """Return the answer to `want_us` in `frames`. Frames up to it join this tick's, later ones the next tick's."""
        for i, frame in enumerate(frames):
            if frame[0] == HIL_ACTUATOR_CONTROLS:
                got_us = int.from_bytes(frame[4][:8], "little")
                if got_us < want_us and self._caps.uneven_answers:
                    self._stats.repeated += 1
                    continue
                if got_us != want_us:
                    self._frames += frames
                    raise LockstepLost(self.name, self._wrong_time(got_us, want_us))
                if i + 1 == len(frames):
                    self._frames += frames
                else:
                    self._frames += frames[: i + 1]
                    self._held = frames[i + 1 :]
                return frame
        self._frames += frames
        return None

    def _decode(self, tick: int, answer: Frame) -> ActuatorFrame:
        try:
            return actuator_frame(tick, answer)
        except CodecError as error:
            raise InvalidControls(self.name, f"tick {tick}: {error}") from error

    def _wait_while_booting(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        """Wait, in a boot of unknown length, until the wall clock has caught up with `t_ns`."""
        want_us = t_ns // 1000
        now_ns = time.perf_counter_ns()
        if self._last_t_ns is None:
            self._boot_due_ns = now_ns
        else:
            self._boot_due_ns = max(self._boot_due_ns, now_ns) + _BOOT_SLOWNESS * (t_ns - self._last_t_ns)
        self._last_t_ns = t_ns
        while True:
            left_s = (self._boot_due_ns - time.perf_counter_ns()) * 1e-9
            frames, self._held = self._held + self._feed(max(left_s, 0.0)), []
            for i, frame in enumerate(frames):
                # Late answers still count as booting: lockstep begins with the first one in time.
                if frame[0] == HIL_ACTUATOR_CONTROLS and int.from_bytes(frame[4][:8], "little") == want_us:
                    self._booting = False
                    self._check_ours()
                    self._frames += frames[: i + 1]
                    self._held = frames[i + 1 :]
                    return self._decode(tick, frame)
            self._frames += frames
            if left_s <= 0.0:
                break
        if self._stats.steps >= _BOOT_SENSORS_LIMIT:
            raise self._lost(want_us)
        return None

    def _quiet(self, want_us: int) -> list[Frame]:
        """Handle a read without data: scan the held bytes again, and check that the far side still runs."""
        frames = self._parser.rescan()
        if frames:
            return frames
        self._check_process(f"ended before it answered {want_us} us")
        if self._transport.fileno() is None:
            # In memory, no more bytes can come.
            raise self._lost(want_us)
        return []

    def _closed(self, error: LinkClosed) -> LinkClosed:
        """Return the transport's error, with the end of the process if the link started one and it closed the line."""
        if error.cause:
            return LinkClosed(self.name, str(error), cause=error.cause)
        if self._process is None:
            return LinkClosed(self.name, str(error), cause="crashed")
        return LinkClosed(self.name, f"{error}; {self._process.describe_end()}", cause="crashed")

    def _lost(self, want_us: int) -> LinkError:
        """Return the error for a missing answer, with its cause as far as it can be found."""
        said = self._silence(want_us)
        try:
            cause, why = self._find_cause(want_us)
        except LinkClosed as error:
            return error
        return LockstepLost(
            self.name,
            f"{said}. {cause}: {why}" if cause != "silent" else f"{said}. Is it hung? See its log",
            cause=cause,
        )

    def _find_cause(self, want_us: int) -> Diagnosis:
        waited_from = time.perf_counter_ns()
        while self._transport.fileno() is not None and time.perf_counter_ns() - waited_from < _LINGER_S * 1e9:
            if self._take_answers(self._feed(_SLICE_S), {want_us}):
                waited_s = (time.perf_counter_ns() - self._sent_at_ns) * 1e-9
                return Diagnosis("slow", f"it answered after {waited_s:.1f} s; raise `reply_timeout_s` to allow that")
        if process_is_stopped(None if self._process is None else self._process.pid):
            return Diagnosis("stopped", "its process is halted (SIGSTOP, or a debugger); resume it")
        self._vehicle.probing()
        probed: set[int] = set()
        received_before = self._stats.rx_bytes
        for probe in range(1, _PROBES + 1):
            if self._ground is None and probe > _PROBES_INTO_SILENCE and self._stats.rx_bytes == received_before:
                break  # no message comes although its clock advances: it is hung, and a serial line would fill up
            t_ns = want_us * 1000 + probe * _PROBE_STEP_NS
            probed.add(t_ns // 1000)
            # The last values again, at later times: an autopilot that only missed one message answers the next one, and
            # one that no longer answers still sends its state. (PX4 does not answer without an IMU, and ends the flight
            # when its sensors fall silent.)
            payload = hil_sensor_payload(t_ns, self._imu, self._mag, self._baro)
            try:
                self._transport.write(self._encoder.frame(HIL_SENSOR, payload))
            except LinkClosed as error:
                raise self._closed(error) from error
            if self._take_answers(self._feed(_PROBE_WAIT_S) or self._parser.rescan(), probed):
                if not self._imu_sent:
                    return Diagnosis("no_imu", _NO_IMU)
                return Diagnosis("lost", _SKIPPED if self._ground is not None else _LOST)
        return self._vehicle.diagnosis() or Diagnosis("silent", "")

    def _take_answers(self, frames: list[Frame], times_us: set[int]) -> bool:
        """Take frames that came after the limit. Return True if one answers one of these times."""
        if self._ground is not None:
            frames = frames + self._ground.read()
        self._frames += frames
        self._vehicle.received(frames)
        return any(
            frame[0] == HIL_ACTUATOR_CONTROLS and int.from_bytes(frame[4][:8], "little") in times_us for frame in frames
        )

    def _wrong_time(self, got_us: int, want_us: int) -> str:
        hint = ""
        if self._answer is None:
            hint = (
                f"; it is the first answer: does the autopilot leave {self._caps.boot_sensors} HIL_SENSORs unanswered "
                "at boot, as the rig's `boot_sensors` says?"
            )
        elif got_us < want_us:
            hint = "; it answers an earlier tick late, or twice: does another program send HIL_SENSORs, too?"
        return f"the HIL_SENSOR had time_usec {want_us}, its answer {got_us}{hint}"

    def _silence(self, want_us: int) -> str:
        parser = self._parser
        frames_before, damaged_before = self._before_wait
        telemetry = sum(frame.msgid != HIL_ACTUATOR_CONTROLS for frame in self._frames[frames_before:])
        damaged = parser.garbage_bytes + parser.pending - damaged_before
        what = f"no answer to time_usec {want_us} within {self._timeouts.reply_s:g} s of wall clock"
        facts = []
        if telemetry:
            facts.append(f"telemetry came ({telemetry} messages) but no HIL_ACTUATOR_CONTROLS")
        if damaged:
            facts.append(
                f"some bytes were damaged ({damaged} outside of messages, {parser.bad_crc} bad checksums so far)"
            )
        said = "; ".join(facts) or "no bytes came"
        if self._process is not None:
            said += "; its process still runs"
        if self._answer is None and self._caps.boot_sensors is not None:
            said += (
                f"; does it leave more than {self._caps.boot_sensors} HIL_SENSORs unanswered at boot (`boot_sensors`)?"
            )
        return f"{what}: {said}"

    def take_frames(self) -> list[Frame]:
        """Return every frame received since the last call, in order, the answers included."""
        frames, self._frames = self._frames, []
        if self._ground is not None and not self._ground_read:
            frames += self._ground.read()
        self._ground_read = False
        self._unseen = frames
        return frames

    def _count_answers(self) -> None:
        self._stats.rtt.add_all(self._rtts_ns)
        self._rtts_ns.clear()

    @property
    def stats(self) -> LinkStats:
        self._count_answers()
        return super().stats
