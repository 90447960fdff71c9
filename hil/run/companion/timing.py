"""Timings of every frame in the file `companion_timing.csv`, one row per answered frame.

    t1   sensor data from the engine through the bench (SUT) to the client (CUT): the sum of
             render_ns   from the beginning of the tick that made the frame to passing the frame to the link
             link_ns     from there to the arrival of the frame at the client
    t2   run time of the client's function
    t3   from the client's answer to passing the command to the autopilot: the sum of
             reply_ns    from sending the answer to its arrival at the bench
             command_ns  from there to the first set-point made from the answer

t3 and command_ns are empty if no set-point was made from the answer: it had no desired state, or a newer answer came
first. All are wall clock. `clock_offset_ns`, the client's clock minus the bench's, converts times of the client.
"""

from __future__ import annotations

import csv
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.companion.frames import CompanionFrame, Reply
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from hil.run.companion.files import COLUMNS
from hil.run_files import TIMING_NAME
from signals.errors import file_errors
from signals.latency import LatencyHistogram

_MAX_UNANSWERED = 1024  # frames; a frame answered after this many others has no timings
_MAX_PENDING = 256  # answers without a set-point


class _Sent(NamedTuple):
    frame: int
    tick: int
    t_ns: int
    render_ns: int
    sent_ns: int  # bench's clock


@dataclass
class ClientTiming:
    """Timings of one client over the run."""

    render: LatencyHistogram = field(default_factory=LatencyHistogram)
    link: LatencyHistogram = field(default_factory=LatencyHistogram)
    t1: LatencyHistogram = field(default_factory=LatencyHistogram)
    t2: LatencyHistogram = field(default_factory=LatencyHistogram)
    reply: LatencyHistogram = field(default_factory=LatencyHistogram)
    t3: LatencyHistogram = field(default_factory=LatencyHistogram)
    sent: OrderedDict[int, _Sent] = field(default_factory=OrderedDict)
    pending: OrderedDict[int, _PendingAnswer] = field(default_factory=OrderedDict)


@dataclass
class _PendingAnswer:
    """An answer with a desired state, before the set-point made from it."""

    sent: _Sent
    reply: Reply
    from_ns: int | None = None  # simulated time from which it applies; None: not known yet


class TimingLog:
    """Receives the timestamps of every frame and writes the file. Raises RecordingError if it cannot be written."""

    def __init__(self, out: Path, *, begun_ns: Callable[[], int]) -> None:
        """`begun_ns` returns the time at which the present tick began, by `time.perf_counter_ns`."""
        self._path = out / TIMING_NAME
        self._begun_ns = begun_ns
        self._tick_begins: OrderedDict[int, int] = OrderedDict()  # by frame
        self.clients: dict[str, ClientTiming] = {}
        with file_errors(self._path):
            self._file: TextIO = self._path.open("w", encoding="utf-8", newline="")
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._row(COLUMNS)

    def made(self, frame: int) -> None:
        """Note that a frame was made in the present tick."""
        self._tick_begins[frame] = self._begun_ns()
        while len(self._tick_begins) > _MAX_UNANSWERED:
            self._tick_begins.popitem(last=False)

    def sending(self, client: str, frame: CompanionFrame) -> None:
        """Note that a frame is about to be passed to the link."""
        begun_ns = self._tick_begins.get(frame.frame)
        if begun_ns is not None:
            sent = self.clients.setdefault(client, ClientTiming()).sent
            render_ns = time.perf_counter_ns() - begun_ns
            sent[frame.frame] = _Sent(frame.frame, frame.tick, frame.t_ns, render_ns, time.monotonic_ns())
            while len(sent) > _MAX_UNANSWERED:
                sent.popitem(last=False)

    def replied(self, reply: Reply) -> None:
        """Note that an answer has arrived."""
        timing = self.clients.get(reply.client)
        sent = None if timing is None else timing.sent.pop(reply.frame, None)
        if timing is None or sent is None:
            return
        timing.pending[reply.frame] = _PendingAnswer(sent, reply)
        if reply.desired is None:
            self._finish(timing, reply.frame, None)
        while len(timing.pending) > _MAX_PENDING:
            self._finish(timing, next(iter(timing.pending)), None)

    def desired(self, client: str, frame: int, from_ns: int) -> None:
        """Note the simulated time from which the desired state of an answer applies."""
        timing = self.clients.get(client)
        if timing is not None and frame in timing.pending:
            timing.pending[frame].from_ns = from_ns

    def commanded(self, t_ns: int) -> None:
        """Note that a set-point was passed to the autopilot at this simulated time.

        The set-point comes from the newest answer that applies at this time; older answers are never flown.
        """
        now_ns = time.monotonic_ns()
        for timing in self.clients.values():
            applying = [n for n, a in timing.pending.items() if a.from_ns is not None and a.from_ns <= t_ns]
            for number in applying:
                self._finish(timing, number, now_ns if number == applying[-1] else None)

    def close(self) -> None:
        """Write the pending rows and close the file. Idempotent."""
        if self._file.closed:
            return
        for timing in self.clients.values():
            for number in list(timing.pending):
                self._finish(timing, number, None)
        with file_errors(self._path):
            self._file.close()

    def _finish(self, timing: ClientTiming, frame: int, commanded_ns: int | None) -> None:
        """Write the row of an answer."""
        answer = timing.pending.pop(frame)
        sent, reply = answer.sent, answer.reply
        offset_ns = reply.clock_offset_ns
        # The offset is exact only to half a round trip, so a difference may come out negative: it counts as zero.
        link_ns = max(0, reply.t_received_ns - offset_ns - sent.sent_ns)
        reply_ns = max(0, reply.t_arrived_ns - (reply.t_sent_ns - offset_ns))
        t1_ns = sent.render_ns + link_ns
        timing.render.add(sent.render_ns)
        timing.link.add(link_ns)
        timing.t1.add(t1_ns)
        timing.t2.add(reply.t2_ns)
        timing.reply.add(reply_ns)
        command_ns: int | None = None
        t3_ns: int | None = None
        if commanded_ns is not None:
            command_ns = commanded_ns - reply.t_arrived_ns
            t3_ns = reply_ns + command_ns
            timing.t3.add(t3_ns)
        row = (reply.client, sent.frame, sent.tick, sent.t_ns, sent.render_ns, link_ns, t1_ns)
        self._row((*row, reply.t2_ns, reply_ns, command_ns, t3_ns, offset_ns))

    def _row(self, values: Sequence[Any]) -> None:
        with file_errors(self._path):
            self._rows.writerow(values)


class TimedPilot:
    """Wraps the pilot as a command source and reports every set-point to the timing log."""

    def __init__(self, pilot: OffboardPilot, timing: TimingLog) -> None:
        self._pilot, self._timing = pilot, timing

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        before = self._pilot.set_points
        commands = self._pilot.step(t_ns, frames)
        if self._pilot.set_points != before:
            self._timing.commanded(t_ns)
        return commands
