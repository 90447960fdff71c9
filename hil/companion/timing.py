"""How long every frame took on its way, as a file: `companion_timing.csv`, one row per answered frame.

    t1   sensor data from the engine through the bench (SUT) to the client (CUT): the sum of
             render_ns   from the begin of the tick that made the frame to the frame handed to the link
             link_ns     from there to the client having it
    t2   what the client's function took
    t3   from the client's answer to the command handed to the autopilot: the sum of
             reply_ns    from the client's answer to the bench having it
             command_ns  from there to the first set-point that carries it

t3 and command_ns are empty where no set-point carried the answer: it wanted nothing, or a newer one was there first.
All are wall clock. Times of the client's clock are brought to the bench's by `clock_offset_ns`, which is the client's
clock minus the bench's.
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
from hil.companion.timing_file import COLUMNS, TIMING_NAME
from hil.signals.errors import RecordingError
from hil.signals.latency import LatencyHistogram

_BEGINS_KEPT = 1024  # frames; one that is answered later than so many has no times
_WAITING = 256  # answers that no set-point has carried yet


class _Sent(NamedTuple):
    frame: int
    tick: int
    t_ns: int
    render_ns: int
    handed_ns: int  # bench's clock


@dataclass
class ClientTiming:
    """Of one client, over the run."""

    render: LatencyHistogram = field(default_factory=LatencyHistogram)
    link: LatencyHistogram = field(default_factory=LatencyHistogram)
    t1: LatencyHistogram = field(default_factory=LatencyHistogram)
    t2: LatencyHistogram = field(default_factory=LatencyHistogram)
    reply: LatencyHistogram = field(default_factory=LatencyHistogram)
    t3: LatencyHistogram = field(default_factory=LatencyHistogram)
    sent: OrderedDict[int, _Sent] = field(default_factory=OrderedDict)
    waiting: OrderedDict[int, _Waiting] = field(default_factory=OrderedDict)


@dataclass
class _Waiting:
    """An answer with a desired state that no set-point has carried yet."""

    sent: _Sent
    reply: Reply
    from_ns: int | None = None  # simulated, from when it counts; None: not known yet


class TimingLog:
    """Hears of every step of every frame. RecordingError where the file cannot be written."""

    def __init__(self, out: Path, *, begun_ns: Callable[[], int]) -> None:
        """`begun_ns`: when the present tick began, by `time.perf_counter_ns`."""
        self._path = out / TIMING_NAME
        self._begun_ns = begun_ns
        self._begins: OrderedDict[int, int] = OrderedDict()  # by frame
        self.clients: dict[str, ClientTiming] = {}
        try:
            self._file: TextIO = self._path.open("w", encoding="utf-8", newline="")
        except OSError as error:
            raise self._unwritable(error) from error
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._row(COLUMNS)

    def made(self, frame: int) -> None:
        """A frame of the present tick."""
        self._begins[frame] = self._begun_ns()
        while len(self._begins) > _BEGINS_KEPT:
            self._begins.popitem(last=False)

    def handing(self, client: str, frame: CompanionFrame) -> None:
        """Just before the frame goes to the link."""
        begun_ns = self._begins.get(frame.frame)
        if begun_ns is not None:
            sent = self.clients.setdefault(client, ClientTiming()).sent
            render_ns = time.perf_counter_ns() - begun_ns
            sent[frame.frame] = _Sent(frame.frame, frame.tick, frame.t_ns, render_ns, time.monotonic_ns())
            while len(sent) > _BEGINS_KEPT:
                sent.popitem(last=False)

    def replied(self, reply: Reply) -> None:
        """An answer has come."""
        timing = self.clients.get(reply.client)
        sent = None if timing is None else timing.sent.pop(reply.frame, None)
        if timing is None or sent is None:
            return
        timing.waiting[reply.frame] = _Waiting(sent, reply)
        if reply.desired is None:
            self._finish(timing, reply.frame, None)
        while len(timing.waiting) > _WAITING:
            self._finish(timing, next(iter(timing.waiting)), None)

    def desired(self, client: str, frame: int, from_ns: int) -> None:
        """What an answer wants counts from this simulated time on."""
        timing = self.clients.get(client)
        if timing is not None and frame in timing.waiting:
            timing.waiting[frame].from_ns = from_ns

    def commanded(self, t_ns: int) -> None:
        """A set-point was handed to the autopilot in the tick of this simulated time: that of the newest answer that
        counts by then. Those before it are never flown."""
        now_ns = time.monotonic_ns()
        for timing in self.clients.values():
            counting = [n for n, w in timing.waiting.items() if w.from_ns is not None and w.from_ns <= t_ns]
            for number in counting:
                self._finish(timing, number, now_ns if number == counting[-1] else None)

    def close(self) -> None:
        """Write what is left. May be called twice."""
        if self._file.closed:
            return
        for timing in self.clients.values():
            for number in list(timing.waiting):
                self._finish(timing, number, None)
        try:
            self._file.close()
        except OSError as error:
            raise self._unwritable(error) from error

    def _finish(self, timing: ClientTiming, frame: int, commanded_ns: int | None) -> None:
        """Write the row of an answer."""
        sent, reply = (waiting := timing.waiting.pop(frame)).sent, waiting.reply
        offset_ns = reply.clock_offset_ns
        # An offset is exact to half a round trip only: what comes out below nothing is nothing.
        link_ns = max(0, reply.t_received_ns - offset_ns - sent.handed_ns)
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
        here = (reply.client, sent.frame, sent.tick, sent.t_ns, sent.render_ns, link_ns, t1_ns)
        self._row((*here, reply.t2_ns, reply_ns, command_ns, t3_ns, offset_ns))

    def _row(self, values: Sequence[Any]) -> None:
        try:
            self._rows.writerow(values)
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> RecordingError:
        return RecordingError(f"{self._path}: cannot be written ({error.strerror or error})")


class TimedPilot:
    """The pilot as a source of commands, with a note of every set-point."""

    def __init__(self, pilot: OffboardPilot, timing: TimingLog) -> None:
        self._pilot, self._timing = pilot, timing

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        before = self._pilot.set_points
        said = self._pilot.step(t_ns, frames)
        if self._pilot.set_points != before:
            self._timing.commanded(t_ns)
        return said
