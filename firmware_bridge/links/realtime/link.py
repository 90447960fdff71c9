"""The common part of links to autopilots that run by their own clock: ticks by the wall clock, lines that reconnect.

Order of a tick, k * period after the start on the wall clock:

    begin   receive until the lead before the deadline; the autopilot's last command is latched
    send    pass the tick's samples to a real-time process, which writes them at the deadline: the autopilot stamps
            samples on arrival, so late ones harm its estimator
    wait    returns at once: an answer belongs to no tick

A line that has hung up ends the run, unless it comes back in time: an unplugged board stops simulated time until it is
found again, by its USB serial number where it has one. Both are events of the run.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Sequence

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.links.autopilot_link import (
    SIMULATOR_COMPID,
    SIMULATOR_SYSID,
    AutopilotLink,
    LinkCaps,
    LinkStats,
    LinkTimeouts,
)
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.realtime.deadline_schedule import DeadlineSchedule
from firmware_bridge.links.realtime.health import (
    GAP_NS,
    ActuatorAge,
    Finding,
    Punctuality,
    judge_actuators,
    judge_sending,
)
from firmware_bridge.links.realtime.paced_line import PacedLine
from firmware_bridge.links.realtime.sender import SendStats
from firmware_bridge.links.timesync import TIMESYNC, TimeSync
from firmware_bridge.transports.transport import Transport
from signals.errors import LinkClosed, LinkError
from signals.samples import ActuatorFrame
from signals.time import NS_PER_MS, NS_PER_S

LEAD_NS = 1_500_000  # from the moment a tick is computed to the moment its samples leave
_REOPEN_S = 0.1
_SLIP_EVENTS = 256


class RealtimeLink(AutopilotLink):
    """One tick each `period_ns` of wall clock; samples go out on the first of `transports`.

    `on_event(kind, text)` gets unplugging, replugging and slips, `say(kind, text)` what the user should know before the
    flight.
    """

    # True if a transport may be opened again while the program that the bench started still runs.
    _process_outlives_transports = False
    _gap_ns = GAP_NS  # a pause in the commands from which on it counts as a gap

    def __init__(
        self,
        caps: LinkCaps,
        *transports: Transport,
        period_ns: int,
        timeouts: LinkTimeouts,
        start_process: Callable[[], ChildProcess] | None = None,
        on_event: Callable[[str, str], None] | None = None,
        say: Callable[[str, str], None] | None = None,
        own_sender: bool = True,
    ) -> None:
        self._say = say or on_event or (lambda _kind, _text: None)
        self._transports = transports
        self._period_ns = period_ns
        self._own_sender = own_sender
        self._timeouts = timeouts
        self._silence_limit_ns = int(timeouts.reply_s * NS_PER_S)
        super().__init__(caps, *transports, start_process=start_process, on_event=on_event)

    def _reset(self) -> None:
        self._stats = LinkStats()
        self._parser = FrameParser()
        self._encoder = FrameEncoder(SIMULATOR_SYSID, SIMULATOR_COMPID)
        self._line: PacedLine | None = None
        self._deadline_ns = 0
        self._received_ns = 0  # the last bytes, on any transport
        self._commanded_ns = 0  # the last motor command
        self.age = ActuatorAge(gap_ns=self._gap_ns)
        self.timesync = TimeSync(rate_hz=5.0)
        self.reconnects = 0
        self.schedule = DeadlineSchedule(
            period_ns=self._period_ns,
            lead_ns=LEAD_NS,
            clock_ns=time.monotonic_ns,
            sleep_s=self._listen,
            on_slip=self._on_slip,
        )

    # ---- defined by each kind of autopilot

    def _await_autopilot(self) -> None:
        """Wait for the autopilot."""
        raise NotImplementedError

    def _take(self, transport: Transport, data: bytes) -> None:
        """Take bytes that came on `transport`."""
        raise NotImplementedError

    def _take_frame(self, frame: Frame, now_ns: int) -> bool:
        """Take a frame. Return True if it is a motor command."""
        raise NotImplementedError

    def _command(self, tick: int) -> ActuatorFrame | None:
        """Return the newest motor command, once; None if none came since the last call."""
        raise NotImplementedError

    def _check_silence(self, now_ns: int) -> None:
        """Raise a named LinkError if no command has come for too long. Called at a tick without one."""
        raise NotImplementedError

    def _still_hears(self, now_ns: int) -> bool:
        """Return True while messages come.

        Of a board that stopped, the last command may be older than the last message: it is silent, and not one that
        sends no commands.
        """
        return now_ns - self._received_ns < self._silence_limit_ns // 2

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
        """Return the counts of samples sent and of their lateness; None before `open`."""
        return None if self._line is None else self._line.stats()

    def punctuality(self) -> Punctuality | None:
        """Return the timing of the samples sent and of the motor commands; None before `open`."""
        sent = self.send_stats()
        return None if sent is None else Punctuality(sent, self.age, self.schedule, self.timesync, self.reconnects)

    def findings(self) -> list[Finding]:
        """Return the faults in this run's timing that affect the autopilot."""
        sending = [] if self._line is None else judge_sending(self._line.stats(), self.schedule)
        return sending + judge_actuators(self.age)

    def _await_far_side(self) -> None:
        self._await_autopilot()
        self._line = PacedLine(self._transports[0], period_ns=self._period_ns, own_process=self._own_sender)
        self._received_ns = self._commanded_ns = time.monotonic_ns()

    def close(self) -> None:
        if self._line is not None:
            self._line.stop()
        super().close()

    def begin(self, tick: int) -> ActuatorFrame | None:
        """Wait for the tick's time. Return the newest command, or None if none has come since the last tick.

        LinkClosed: a transport is gone and has not come back. HandshakeError: messages come, but no commands.
        """
        while True:
            reconnects = self.reconnects
            self._deadline_ns = self.schedule.wait_until_due(tick)
            self._listen(0.0)
            assert self._line is not None
            failure = self._line.failure(self._transports[0].name)
            if failure is not None:
                self._reopen(self._transports[0], failure)
            if self.reconnects == reconnects:
                break
        now_ns = time.monotonic_ns()
        self.age.used(now_ns)
        command = self._command(tick)
        if command is None:
            self._check_silence(now_ns)
        return command

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:  # noqa: ARG002
        """Return None: a free-running autopilot answers no tick."""
        return None

    def _push(self, data: bytes, *, keep: bool) -> None:
        """Pass `data` to the sender, for this tick's deadline."""
        assert self._line is not None
        try:
            self._line.push(self._deadline_ns, data, keep=keep)
        except LinkClosed as error:
            self._reopen(self._transports[0], error)

    def _listen(self, for_s: float) -> None:
        """Receive on all transports for this time. Data is stamped on arrival."""
        end_ns = time.monotonic_ns() + int(for_s * NS_PER_S)
        while True:
            left_ns = end_ns - time.monotonic_ns()
            fds = [fd for transport in self._transports if (fd := transport.fileno()) is not None]
            # poll's own unit is a millisecond: too coarse for a deadline.
            if fds:
                select.select(fds, [], [], max(left_ns, 0) / NS_PER_S)
            received = False
            for transport in self._transports:
                data = self._read(transport)
                if data:
                    received = True
                    self._stats.rx_bytes += len(data)
                    self._take(transport, data)
            if not received and (left_ns <= 0 or not fds):
                return

    def _read(self, transport: Transport) -> bytes:
        try:
            return transport.read(0.0)
        except LinkClosed as error:
            self._reopen(transport, error)
            return b""

    def _take_mavlink(self, data: bytes) -> None:
        now_ns = time.monotonic_ns()
        frames = self._parser.feed(data)
        if frames:
            self._received_ns = now_ns
        for frame in frames:
            if self._take_frame(frame, now_ns):
                self._commanded_ns = now_ns
                self.age.arrived(now_ns)
            elif frame[0] == TIMESYNC and frame[2] == 1:
                self.timesync.take(frame, now_ns)
        self._frames += frames

    # ---- faults

    def _on_slip(self, moved_ns: int) -> None:
        if self.schedule.slip_count <= _SLIP_EVENTS:
            self._on_event(
                "slip", f"the bench fell {moved_ns / NS_PER_MS:.0f} ms behind the wall clock: later ticks move by that"
            )

    def _reopen(self, transport: Transport, error: LinkClosed) -> None:
        """Wait for `transport` to come back; simulated time stands still. LinkClosed if it does not."""
        process, port = self._process, self.name if len(self._transports) == 1 else transport.name
        if process is not None and not (self._process_outlives_transports and process.running()):
            # The program may still be ending, and no program is on the far side of a new pseudo-terminal.
            raise LinkClosed(self.name, f"{error}; {process.describe_end()}", cause="crashed") from error
        if self._timeouts.reconnect_s <= 0.0:
            raise LinkClosed(self.name, str(error), cause="unplugged") from error
        gone_ns = time.monotonic_ns()
        self._on_event("unplugged", f"{transport.name} is gone: {error}")
        line = self._line if transport is self._transports[0] else None
        if line is not None:
            line.stop()
        transport.close()
        while True:
            try:
                transport.open()
                break
            except LinkError as still:
                if time.monotonic_ns() - gone_ns > self._timeouts.reconnect_s * NS_PER_S:
                    text = f"{error}; it did not come back within {self._timeouts.reconnect_s:g} s ({still})"
                    raise LinkClosed(port, text, cause="unplugged") from error
            time.sleep(_REOPEN_S)
        if line is not None:
            line.renew(transport)
        self.reconnects += 1
        self._received_ns = self._commanded_ns = time.monotonic_ns()
        self._on_event("replugged", f"{transport.name} is back after {(self._received_ns - gone_ns) / NS_PER_S:.1f} s")
