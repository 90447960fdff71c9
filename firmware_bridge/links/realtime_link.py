"""What links to autopilots that wait for nobody have in common: ticks by the wall clock, wires that may come back.

Order of a tick, k * period after the start on the wall clock:

    begin   listen until the lead before the deadline; what the autopilot commanded last is latched
    send    the tick's samples go to a real-time process, which writes them at the deadline: late is what hurts the
            autopilot's estimator, which stamps samples on arrival
    wait    nothing: an answer belongs to no tick

A line that has hung up ends the run, unless it comes back in time: an unplugged board stops simulated time until it is
found again, by its USB serial number where it has one. Both are events of the run.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Sequence

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.links.autopilot_link import AutopilotLink, LinkCaps, LinkStats
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.deadline_schedule import DeadlineSchedule
from firmware_bridge.links.lockstep import SIMULATOR_COMPID, SIMULATOR_SYSID
from firmware_bridge.links.paced_line import PacedLine, SendStats
from firmware_bridge.links.realtime_health import GAP_NS, ActuatorAge, Finding, judge_actuators, judge_sending
from firmware_bridge.links.timesync import TIMESYNC, TimeSync
from firmware_bridge.transports.transport import Transport
from hil.signals.errors import LinkClosed, LinkError
from hil.signals.samples import ActuatorFrame
from hil.signals.time import NS_PER_MS, NS_PER_S

LEAD_NS = 1_500_000  # from the moment a tick is computed to the moment its samples leave
_REOPEN_S = 0.1
_SLIPS_TOLD = 256


class RealtimeLink(AutopilotLink):
    """One tick each `period_ns` of wall clock; samples go out on the first of `wires`.

    `on_event(kind, text)` hears of unplugging, replugging and slips. `reconnect_s`: how long a wire may be away.
    """

    # Whether a wire may be opened again while the program that the bench started still runs.
    _process_outlives_wires = False

    def __init__(
        self,
        caps: LinkCaps,
        *wires: Transport,
        period_ns: int,
        silence_limit_s: float,
        heartbeat_limit_s: float,
        gap_ns: int = GAP_NS,
        start_process: Callable[[], ChildProcess] | None = None,
        deaf: bool = False,
        on_event: Callable[[str, str], None] | None = None,
        own_sender: bool = True,
        reconnect_s: float = 10.0,
    ) -> None:
        self._wires = wires
        self._period_ns = period_ns
        self._gap_ns = gap_ns
        self._own_sender = own_sender
        self._silence_limit_ns = int(silence_limit_s * NS_PER_S)
        self._heartbeat_limit_s = heartbeat_limit_s
        self._reconnect_s = reconnect_s
        super().__init__(caps, *wires, start_process=start_process, deaf=deaf, on_event=on_event)

    def _reset(self) -> None:
        self._stats = LinkStats()
        self._parser = FrameParser()
        self._encoder = FrameEncoder(SIMULATOR_SYSID, SIMULATOR_COMPID)
        self._line: PacedLine | None = None
        self._deadline_ns = 0
        self._heard_ns = 0  # anything, on any wire
        self._commanded_ns = 0  # a motor command
        self.age = ActuatorAge(gap_ns=self._gap_ns)
        self.timesync = TimeSync(rate_hz=5.0)
        self.reconnects = 0
        self.schedule = DeadlineSchedule(
            period_ns=self._period_ns,
            lead_ns=LEAD_NS,
            clock_ns=time.monotonic_ns,
            sleep_s=self._listen,
            on_slip=self._tell_slip,
        )

    # ---- what each kind of autopilot has of its own

    def _await_autopilot(self) -> None:
        """Return once it is there."""
        raise NotImplementedError

    def _take(self, wire: Transport, data: bytes) -> None:
        """Bytes that came on `wire`."""
        raise NotImplementedError

    def _hear(self, frame: Frame, now_ns: int) -> bool:
        """A frame that came; whether it is a motor command."""
        raise NotImplementedError

    def _command(self, tick: int) -> ActuatorFrame | None:
        """The newest motor command, once; None if none came since."""
        raise NotImplementedError

    def _check_silence(self, now_ns: int) -> None:
        """Called at a tick without a command: named LinkErrors where that has gone on for too long."""
        raise NotImplementedError

    # ---- the tick

    def _parsers(self) -> Sequence[FrameParser]:
        return (self._parser,)

    @property
    def stats(self) -> LinkStats:
        """Counters; brought up to date by reading this property."""
        stats = super().stats
        stats.rtt = self.timesync.rtt
        if self._line is not None:
            stats.late = self._line.stats().late_2ms
        return stats

    def send_stats(self) -> SendStats | None:
        """How punctual the samples were; None before `open`."""
        return None if self._line is None else self._line.stats()

    def findings(self) -> list[Finding]:
        """What in this run's timing was bad for the autopilot."""
        sending = [] if self._line is None else judge_sending(self._line.stats(), self.schedule)
        return sending + judge_actuators(self.age)

    def _await_far_side(self) -> None:
        self._await_autopilot()
        self._line = PacedLine(self._wires[0], period_ns=self._period_ns, own_process=self._own_sender)
        self._heard_ns = self._commanded_ns = time.monotonic_ns()

    def close(self) -> None:
        if self._line is not None:
            self._line.stop()
        super().close()

    def begin(self, tick: int) -> ActuatorFrame | None:
        """Wait for the tick's time; the newest command, or None if none has come since the last tick.

        LinkClosed: a wire is gone and has not come back. HandshakeError: the autopilot talks, but commands nothing.
        """
        while True:
            reconnects = self.reconnects
            self._deadline_ns = self.schedule.wait_until_due(tick)
            self._listen(0.0)
            assert self._line is not None
            failure = self._line.failure(self._wires[0].name)
            if failure is not None:
                self._reopen(self._wires[0], failure)
            if self.reconnects == reconnects:
                break
        now_ns = time.monotonic_ns()
        self.age.used(now_ns)
        command = self._command(tick)
        if command is None:
            self._check_silence(now_ns)
        return command

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:  # noqa: ARG002
        """Nothing to wait for."""
        return None

    def _push(self, data: bytes, *, keep: bool) -> None:
        """Hand `data` to the sender, for this tick's deadline."""
        assert self._line is not None
        try:
            self._line.push(self._deadline_ns, data, keep=keep)
        except LinkClosed as error:
            self._reopen(self._wires[0], error)

    def _listen(self, for_s: float) -> None:
        """Take in what comes on all wires for so long; what comes is stamped when it comes."""
        end_ns = time.monotonic_ns() + int(for_s * NS_PER_S)
        while True:
            left_ns = end_ns - time.monotonic_ns()
            fds = [fd for wire in self._wires if (fd := wire.fileno()) is not None]
            # poll's own unit is a millisecond: too coarse for a deadline.
            if fds:
                select.select(fds, [], [], max(left_ns, 0) / NS_PER_S)
            heard = False
            for wire in self._wires:
                data = self._read(wire)
                if data:
                    heard = True
                    self._stats.rx_bytes += len(data)
                    self._take(wire, data)
            if not heard and (left_ns <= 0 or not fds):
                return

    def _read(self, wire: Transport) -> bytes:
        try:
            return wire.read(0.0)
        except LinkClosed as error:
            self._reopen(wire, error)
            return b""

    def _take_mavlink(self, data: bytes) -> None:
        now_ns = time.monotonic_ns()
        frames = self._parser.feed(data)
        if frames:
            self._heard_ns = now_ns
        for frame in frames:
            if self._hear(frame, now_ns):
                self._commanded_ns = now_ns
                self.age.arrived(now_ns)
            elif frame[0] == TIMESYNC and frame[2] == 1:
                self.timesync.take(frame, now_ns)
        self._frames += frames

    # ---- what goes wrong

    def _tell_slip(self, moved_ns: int) -> None:
        if self.schedule.slip_count <= _SLIPS_TOLD:
            self._on_event("slip", f"the bench fell {moved_ns / NS_PER_MS:.0f} ms behind the wall clock and let go")

    def _reopen(self, wire: Transport, error: LinkClosed) -> None:
        """Wait for `wire` to come back; simulated time stands still. LinkClosed if it does not, or may not."""
        process, port = self._process, self.name if len(self._wires) == 1 else wire.name
        if process is not None and not (self._process_outlives_wires and process.running()):
            # It may not have quite ended yet; and nobody would be on the far side of a new pseudo-terminal.
            raise LinkClosed(self.name, f"{error}; {process.describe_end()}", cause="crashed") from error
        if self._reconnect_s <= 0.0:
            raise LinkClosed(self.name, str(error), cause="unplugged") from error
        gone_ns = time.monotonic_ns()
        self._on_event("unplugged", f"{wire.name} is gone: {error}")
        line = self._line if wire is self._wires[0] else None
        if line is not None:
            line.stop()
        wire.close()
        while True:
            try:
                wire.open()
                break
            except LinkError as still:
                if time.monotonic_ns() - gone_ns > self._reconnect_s * NS_PER_S:
                    text = f"{error}; it did not come back within {self._reconnect_s:g} s ({still})"
                    raise LinkClosed(port, text, cause="unplugged") from error
            time.sleep(_REOPEN_S)
        if line is not None:
            line.renew(wire)
        self.reconnects += 1
        self._heard_ns = self._commanded_ns = time.monotonic_ns()
        self._on_event("replugged", f"{wire.name} is back after {(self._heard_ns - gone_ns) / NS_PER_S:.1f} s")
