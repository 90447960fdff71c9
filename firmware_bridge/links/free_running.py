"""An autopilot that waits for nobody: a Pixhawk in HITL, real or mocked, on a serial line.

Order of a tick, k * period after the start on the wall clock:

    begin   listen until the lead before the deadline; what the autopilot commanded last is latched
    send    [extra][range and flow][HIL_GPS if due][HIL_SENSOR id 0] goes to a real-time thread, which writes it at the
            deadline: late is what hurts PX4's estimator, which stamps samples on arrival
    wait    nothing: an answer belongs to no tick

A silent line, or one that has hung up, ends the run, unless the board comes back in time: an unplugged board stops
simulated time until it is found again, by its USB serial number where it has one. Both are events of the run.
Never is HIL_STATE_QUATERNION sent: it overwrites what PX4's estimator works with.
"""

from __future__ import annotations

import select
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
from firmware_bridge.links.actuator_age import ActuatorAge
from firmware_bridge.links.autopilot_link import InvalidControls, LinkCaps, LinkStats
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.deadline_schedule import DeadlineSchedule
from firmware_bridge.links.lockstep import SIMULATOR_COMPID, SIMULATOR_SYSID
from firmware_bridge.links.paced_line import PacedLine
from firmware_bridge.links.realtime_health import Finding, judge_actuators, judge_sending
from firmware_bridge.links.send_stats import SendStats
from firmware_bridge.links.timesync import TIMESYNC, TimeSync
from firmware_bridge.transports.transport import Transport
from hil.signals.errors import HandshakeError, LinkClosed, LinkError
from hil.signals.samples import ActuatorFrame, BaroSample, GpsSample, ImuSample, MagSample, Sample
from hil.signals.time import NS_PER_MS, NS_PER_S

_HEARTBEAT = MSGID["HEARTBEAT"]
_SLICE_S = 0.05
_MOST_BAD_IN_A_ROW = 25  # commands that are no numbers: a tenth of a second of them
LEAD_NS = 1_500_000  # from the moment a tick is computed to the moment its samples leave
_REOPEN_S = 0.1

Events = Callable[[str, str], None]


def _nobody(kind: str, text: str) -> None:
    """Takes events where nobody wants to hear them."""


class FreeRunningLink:
    """HITL over `transport`, one tick each `period_ns` of wall clock.

    `prepare`, if given, is called once the board has been heard, with its system id: it may ask the board about its
    set-up, and raise.
    `on_event(kind, text)` hears of unplugging, replugging and slips.
    """

    def __init__(
        self,
        transport: Transport,
        caps: LinkCaps,
        *,
        period_ns: int,
        start_process: Callable[[], ChildProcess] | None = None,
        prepare: Callable[[Transport, FrameParser, int], None] | None = None,
        on_event: Events | None = None,
        native_sender: bool = True,
        silence_limit_s: float = 5.0,
        heartbeat_limit_s: float = 20.0,
        reconnect_s: float = 10.0,
    ) -> None:
        self._transport = transport
        self._caps = caps
        self._period_ns = period_ns
        self._start_process = start_process
        self._prepare = prepare
        self._on_event = on_event or _nobody
        self._native_sender = native_sender
        self._silence_limit_ns = int(silence_limit_s * NS_PER_S)
        self._heartbeat_limit_s = heartbeat_limit_s
        self._reconnect_s = reconnect_s
        self._process: ChildProcess | None = None
        self._line: PacedLine | None = None
        self._reset()

    def _reset(self) -> None:
        self._stats = LinkStats()
        self._parser = FrameParser()
        self._encoder = FrameEncoder(SIMULATOR_SYSID, SIMULATOR_COMPID)
        self._frames: list[Frame] = []
        self._latest: Frame | None = None
        self._bad_in_a_row = 0
        self._deadline_ns = 0
        self._heard_ns = 0  # anything
        self._commanded_ns = 0  # HIL_ACTUATOR_CONTROLS
        self._slips_told = 0
        self.age = ActuatorAge()
        self.timesync = TimeSync(rate_hz=5.0)
        self.reconnects = 0
        self.schedule = DeadlineSchedule(
            period_ns=self._period_ns, lead_ns=LEAD_NS, clock_ns=time.monotonic_ns, sleep_s=self._listen
        )

    @property
    def caps(self) -> LinkCaps:
        return self._caps

    @property
    def stats(self) -> LinkStats:
        """Counters; brought up to date by reading this property."""
        stats = self._stats
        stats.take_received(self._parser)
        stats.rtt = self.timesync.rtt
        if self._line is not None:
            stats.late = self._line.stats().late_2ms
        return stats

    @property
    def name(self) -> str:
        return f"autopilot ({self._caps.kind}, {self._transport.name})"

    def send_stats(self) -> SendStats | None:
        """How punctual the samples were; None before `open`."""
        return None if self._line is None else self._line.stats()

    def findings(self) -> list[Finding]:
        """What in this run's timing was bad for the autopilot."""
        self.age.finish(time.monotonic_ns())
        sending = [] if self._line is None else judge_sending(self._line.stats(), self.schedule)
        return sending + judge_actuators(self.age)

    def open(self) -> None:
        """Open the line, start the process if there is one, wait for the first heartbeat, ask about the set-up."""
        self._reset()
        self._line = None
        try:
            self._transport.open()
            if self._start_process is not None:
                self._process = self._start_process()
                self._process.start()
            sysid = self._await_heartbeat()
            if self._prepare is not None:
                self._prepare(self._transport, self._parser, sysid)
            self._line = PacedLine(self._transport, period_ns=self._period_ns, native=self._native_sender)
        except BaseException:
            self.close()
            raise
        self._heard_ns = self._commanded_ns = time.monotonic_ns()

    def close(self) -> None:
        line = self._line
        if line is not None:
            line.stop()
        self._transport.close()
        process, self._process = self._process, None
        if process is not None:
            process.close()

    def _await_heartbeat(self) -> int:
        """System id of the autopilot that sent the first heartbeat."""
        deadline = time.monotonic() + self._heartbeat_limit_s
        while True:
            frames = self._parser.feed(self._transport.read(_SLICE_S))
            self._frames += frames
            for frame in frames:
                if frame.msgid == _HEARTBEAT and frame.compid == 1:
                    return frame.sysid
            if self._process is not None and not self._process.running():
                text = f"ended before its first heartbeat: {self._process.describe_end()}"
                raise LinkClosed(self.name, text, cause="crashed")
            if time.monotonic() >= deadline:
                raise HandshakeError(
                    self.name,
                    f"no heartbeat within {self._heartbeat_limit_s:g} s of wall clock; {self._parser.frames} other "
                    f"messages and {self._parser.garbage_bytes + self._parser.pending} bytes that are none came "
                    "(powered? the right port, the right baud rate?)",
                )

    def begin(self, tick: int) -> ActuatorFrame | None:
        """Wait for the tick's time; the newest command, or None if none has come since the last tick.

        LinkClosed: the board is gone and has not come back. HandshakeError: it talks, but commands nothing.
        InvalidControls: it keeps sending commands that are no numbers. A single one is counted and passed over: about
        one damaged message in 65536 has a good checksum.
        """
        while True:
            try:
                self._deadline_ns = self.schedule.wait_until_due(tick)
                self._listen(0.0)
                self._check_line()
                break
            except LinkClosed as error:
                self._reconnect(error)
        self._tell_slips()
        now_ns = time.monotonic_ns()
        self.age.used(now_ns)
        latest, self._latest = self._latest, None
        if latest is None:
            self._check_silence(now_ns)
            return None
        try:
            frame = actuator_frame(tick, latest)
        except CodecError as error:
            self._stats.bad_controls += 1
            self._bad_in_a_row += 1
            if self._bad_in_a_row > _MOST_BAD_IN_A_ROW:
                text = f"tick {tick}: {error}; so were the {_MOST_BAD_IN_A_ROW} commands before"
                raise InvalidControls(self.name, text) from error
            self._check_silence(now_ns)
            return None
        self._bad_in_a_row = 0
        return frame

    def send(
        self,
        tick: int,
        t_ns: int,
        imu: ImuSample | None,
        mag: MagSample | None,
        baro: BaroSample | None,
        gps: GpsSample | None,
        extra: bytes,
        ranging: Sequence[Sample] = (),
    ) -> bytes:
        """Hand the tick's bytes to the sender; these bytes. CodecError if a sample is not a number."""
        encoder, stats = self._encoder, self._stats
        data = b""
        for sample in ranging:
            data += encoder.frame(*ranging_message(t_ns, sample))
            stats.tx_frames += 1
        question = self.timesync.request(self._deadline_ns)
        if question is not None:
            data += encoder.frame(TIMESYNC, question)
        if gps is not None:
            data += encoder.frame(HIL_GPS, hil_gps_payload(t_ns, gps))
            stats.tx_frames += 1
        data += encoder.frame(HIL_SENSOR, hil_sensor_payload(t_ns, imu, mag, baro))
        assert self._line is not None
        try:
            # Commands must arrive; a stale sample is better dropped than sent late.
            if extra:
                self._line.push(self._deadline_ns, extra, keep=True)
            self._line.push(self._deadline_ns, data, keep=False)
        except LinkClosed as error:
            self._reconnect(error)
        self.schedule.note_handed_over(tick)
        stats.tx_frames += 1
        stats.steps += 1
        data = extra + data
        stats.tx_bytes += len(data)
        return data

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:  # noqa: ARG002
        """Nothing to wait for."""
        return None

    def take_frames(self) -> list[Frame]:
        """Every frame received since the last call, in order."""
        frames, self._frames = self._frames, []
        return frames

    def _listen(self, for_s: float) -> None:
        """Take in what comes for so long. What comes is stamped when it comes, not when the tick is over."""
        end_ns = time.monotonic_ns() + int(for_s * NS_PER_S)
        fd = self._transport.fileno()
        while True:
            left_ns = end_ns - time.monotonic_ns()
            if fd is None or left_ns > 0:
                # poll's own unit is a millisecond: too coarse for a deadline.
                ready = fd is not None and select.select([fd], [], [], max(left_ns, 0) / NS_PER_S)[0]
                if not ready:
                    return
            data = self._transport.read(0.0)
            if not data:
                if left_ns <= 0:
                    return
                continue
            self._take(data)

    def _take(self, data: bytes) -> None:
        now_ns = time.monotonic_ns()
        self._stats.rx_bytes += len(data)
        frames = self._parser.feed(data)
        if frames:
            self._heard_ns = now_ns
        for frame in frames:
            if frame[0] == HIL_ACTUATOR_CONTROLS:
                self._latest = frame
                self._commanded_ns = now_ns
                self.age.arrived(now_ns)
            elif frame[0] == TIMESYNC and frame[2] == 1:
                self.timesync.take(frame, now_ns)
        self._frames += frames

    def _check_line(self) -> None:
        assert self._line is not None
        failure = self._line.failure(self.name)
        if failure is not None:
            raise failure

    def _check_silence(self, now_ns: int) -> None:
        if now_ns - self._heard_ns > self._silence_limit_ns:
            said = f"nothing was heard of it for {(now_ns - self._heard_ns) / NS_PER_S:.1f} s"
            if self._process is not None:
                said += "; its process still runs" if self._process.running() else f"; {self._process.describe_end()}"
            raise LinkError(self.name, f"{said}. Hung, or terminated?", cause="silent")
        if now_ns - self._commanded_ns > self._silence_limit_ns:
            raise HandshakeError(
                self.name,
                f"it talks, but has sent no HIL_ACTUATOR_CONTROLS for {self._silence_limit_ns / NS_PER_S:g} s: is "
                "SYS_HITL 1 since its last boot, and the line's data rate above 5000 bytes/s (57600 baud is not)? "
                "`hil devices --check PORT` looks",
                cause="no_controls",
            )

    def _tell_slips(self) -> None:
        for slip in self.schedule.slips[self._slips_told :]:
            self._on_event(
                "slip", f"the bench fell {slip.moved_ns / NS_PER_MS:.0f} ms behind the wall clock and let go"
            )
        self._slips_told = len(self.schedule.slips)

    def _reconnect(self, error: LinkClosed) -> None:
        """Wait for the board to come back; simulated time stands still. LinkClosed if it does not, or may not."""
        if self._process is not None:
            # It may not have quite ended yet; and nobody would be on the far side of a new pseudo-terminal.
            raise LinkClosed(self.name, f"{error}; {self._process.describe_end()}", cause="crashed") from error
        if self._reconnect_s <= 0.0:
            raise LinkClosed(self.name, str(error), cause="unplugged") from error
        gone_ns = time.monotonic_ns()
        self._on_event("unplugged", f"{self._transport.name} is gone: {error}")
        assert self._line is not None
        self._line.stop()
        self._transport.close()
        while True:
            try:
                self._transport.open()
                break
            except LinkError as still:
                if time.monotonic_ns() - gone_ns > self._reconnect_s * NS_PER_S:
                    text = f"{error}; it did not come back within {self._reconnect_s:g} s ({still})"
                    raise LinkClosed(self.name, text, cause="unplugged") from error
            time.sleep(_REOPEN_S)
        away_s = (time.monotonic_ns() - gone_ns) / NS_PER_S
        self._line = self._line.renewed(self._transport)
        self.reconnects += 1
        self._heard_ns = self._commanded_ns = time.monotonic_ns()
        self._on_event("replugged", f"{self._transport.name} is back after {away_s:.1f} s")
