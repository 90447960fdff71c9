"""Frames to the clients and what they desire back, tick by tick, in one of three kinds of time.

lockstep      The bench waits for every answer; it holds from the instant of the frame on, so it moves the vehicle one
              tick later. Simulated time never passes while a client computes.

realtime      The bench waits for nobody. A client that is free gets the newest frame; those that came while it was
              busy are passed by, and counted. An answer holds from the tick in which it came.

latency_true  As realtime would have it, but in simulated time: the bench waits for the answer and then charges what it
              took. With t_free when a client had finished the frame before, and t_f the time of the newest one that
              there was by then, or else of the next:

                  t_take = max(t_f, t_free)      t_free' = t_take + t2 + link

              link: what the wire took there and back, as measured, or a fixed time.

              The answer holds from t_free' on, and until then the client gets nothing. So a slow computer flies as it
              would fly live, however fast or busy this one is, and the trace of answers repeats the run bit for bit.

`step` is called once a tick with everything released; `desire` takes what a controlling client wants, from when on, and
the time of the frame that it wants it in answer to.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from firmware_bridge.codecs.companion import ReportValue
from hil.companion.answers import Answer, Answers, Client
from hil.companion.bundle import Bundle, Collector
from hil.companion.link_faults import CompanionFaults
from hil.companion.timing import TimingLog
from hil.companion.trace import TraceWriter
from hil.signals.desired import DesiredState
from hil.signals.detections import Detections
from hil.signals.errors import LinkClosed
from hil.signals.samples import Sample, TruthState
from hil.signals.time import RateAccumulator

TimeMode = Literal["lockstep", "realtime", "latency_true"]


@dataclass(frozen=True)
class Waiting:
    """How long for what [s of wall clock]."""

    reply_s: float
    reconnect_s: float
    lost_is_error: bool  # of a controlling client


@dataclass
class Seat:
    """What the bench knows of one client."""

    client: Client
    pending: Bundle | None = None
    free_ns: int = 0  # simulated; latency_true
    under_way: int | None = None  # frame it has not answered yet; realtime
    under_way_t_ns: int = 0  # its simulated time
    sent_s: float = 0.0  # when, wall clock
    away: bool = False  # realtime
    missed_s: float | None = None  # since when it has been away without an answer, wall clock; realtime
    sent: int = 0
    dropped: int = 0
    finished: bool = False
    report: Mapping[str, ReportValue] = field(default_factory=dict)


class CompanionStage:
    """All clients of a run."""

    def __init__(
        self,
        answers: Answers,
        *,
        mode: TimeMode,
        topics: Sequence[str],
        rate: RateAccumulator,
        waiting: Waiting,
        link_delay_ns: int | None = None,
        desire: Callable[[DesiredState, int, int], None] | None = None,
        on_report: Callable[[str, Mapping[str, ReportValue], int], None] = lambda _client, _report, _t_ns: None,
        on_detections: Callable[[str, Detections, int], None] = lambda _client, _detections, _t_ns: None,
        on_event: Callable[[int, str, str], None] = lambda _t_ns, _kind, _text: None,
        detected_then: Callable[[int], Sequence[tuple[str, Detections]]] = lambda _t_ns: (),
        trace: TraceWriter | None = None,
        timing: TimingLog | None = None,
        faults: CompanionFaults | None = None,
    ) -> None:
        """`detected_then`: what lookers-on of a recorded run had detected up to that time, each once."""
        self._answers, self._mode, self._waiting = answers, mode, waiting
        self._collector = Collector(topics)
        self._due = rate.due
        self._link_delay_ns = link_delay_ns
        self._desire, self._on_report, self._on_event = desire, on_report, on_event
        self._on_detections, self._detected_then = on_detections, detected_then
        self._trace, self._timing, self._faults = trace, timing, faults
        self._t_ns = 0
        self.frames = 0
        self.seats: dict[str, Seat] = {}
        self.all_seats: dict[str, Seat] = {}  # those of clients that are gone too
        self._look_for_clients(beginning=True)

    @property
    def finished(self) -> bool:
        """Whether those that control have all said that they are done."""
        controlling = [seat for seat in self.seats.values() if seat.client.control]
        return bool(controlling) and all(seat.finished for seat in controlling)

    def step(self, truth: TruthState, released: Sequence[tuple[str, Sample]]) -> None:
        """One tick. LinkClosed where a controlling client is lost for good."""
        self._t_ns = truth.t_ns
        self._collector.add(released)
        if self._due():
            if self._faults is not None:
                self._faults.step(truth.t_ns)
            if self._mode != "realtime":
                # Who became free since the last tick did not wait for this frame, but took the one that was there.
                self._step_waiting(truth.t_ns - 1)
                self._answers.take()  # nobody waits for what has come unasked; but who came and went counts
            self._look_for_clients()
            bundle = self._collector.take(self.frames, truth)
            if self._timing is not None:
                self._timing.made(bundle.number)
            self.frames += 1
            for seat in self.seats.values():
                if seat.pending is not None:
                    seat.dropped += 1
                seat.pending = bundle.over(seat.pending)
        if self._mode == "realtime":
            self._step_realtime()
        else:
            self._step_waiting(truth.t_ns)
        for client, detections in self._detected_then(truth.t_ns):
            self._on_detections(client, detections, truth.t_ns)

    def serve(self, limit_s: float) -> None:
        """Between ticks, in realtime: take what comes within the limit, and give who is free the newest frame."""
        deadline_s = time.monotonic() + limit_s
        left_s = limit_s
        while left_s > 0.0:
            self._give_and_take(left_s)
            left_s = deadline_s - time.monotonic()

    @property
    def waits_for_nobody(self) -> bool:
        return self._mode == "realtime"

    def _look_for_clients(self, *, beginning: bool = False) -> None:
        """Those that came or went since."""
        there = {client.name: client for client in self._answers.clients(self.frames)}
        for name in [name for name in self.seats if name not in there]:
            if not self.seats[name].client.control:
                self._leave(name)
        for name, client in there.items():
            if name not in self.seats:
                self.seats[name] = self.all_seats.setdefault(name, Seat(client))
                self.seats[name].client = client
                if client.control and self._trace is not None and not beginning:
                    self._trace.joined(client, self.frames)
            elif self._mode != "realtime":  # there, what is under way is lost with a connection: see below
                self._come_back(self.seats[name], client)
        self.seats = dict(sorted(self.seats.items()))

    def _come_back(self, seat: Seat, client: Client) -> None:
        """It may want other topics than before."""
        if seat.client.control and not client.control:
            if self._trace is not None:
                self._trace.demoted(client.name, self.frames)
            self._part(seat, "it came back without control")
        else:
            seat.client = client

    def _leave(self, name: str) -> None:
        seat = self.seats.pop(name)
        seat.pending = seat.under_way = seat.missed_s = None  # what it missed while it was away is no drop

    def _give_and_take(self, limit_s: float) -> None:
        """Answers that come within the limit; who answered gets the frame that waits for it."""
        for name, answer in self._answers.take(limit_s):
            seat = self.seats.get(name)
            if seat is not None and seat.under_way is not None and answer.frame >= seat.under_way:
                seat.under_way = seat.missed_s = None
                self._take(seat, answer, self._t_ns, seat.under_way_t_ns)
                self._give(seat)

    def _give(self, seat: Seat) -> None:
        if seat.pending is None or seat.under_way is not None or self._lost_on_the_way(seat):
            return
        if self._send(seat):
            assert seat.pending is not None
            seat.under_way, seat.under_way_t_ns = seat.pending.number, seat.pending.t_ns
            seat.sent_s = time.monotonic()
            seat.pending = None

    def _lost_on_the_way(self, seat: Seat) -> bool:
        """Whether the frame that waits for it never arrives. What was in it is gone."""
        assert seat.pending is not None
        if self._faults is None or not self._faults.loses(seat.client.name, seat.pending.number):
            return False
        seat.dropped += 1
        seat.pending = None
        return True

    def _step_realtime(self) -> None:
        self._give_and_take(0.0)
        there = {client.name: client for client in self._answers.clients(self.frames)}
        now_s = time.monotonic()
        for name, seat in list(self.seats.items()):
            client = there.get(name)
            if client is None or (seat.client.control and not client.control):
                self._miss(seat, now_s, self._answers.gone(name) or "it has given up control")
                continue
            if client.returned != seat.client.returned:
                self._miss(seat, now_s, "its connection ended")
            elif seat.under_way is not None and now_s - seat.sent_s > self._waiting.reply_s:
                why = f"no answer to frame {seat.under_way} within {self._waiting.reply_s:g} s"
                self._answers.lose(name, why, 0.0)
                self._miss(seat, now_s, why)
                continue
            if name not in self.seats:
                continue
            seat.client = client
            if seat.away:
                seat.away = False
                self._on_event(self._t_ns, "companion_back", name)
            self._give(seat)

    def _miss(self, seat: Seat, now_s: float, why: str) -> None:
        """It is away, and the flight goes on without it, for a while. Coming back is not enough: it has to answer."""
        seat.under_way = None
        if not seat.away:
            seat.away = True
            self._on_event(self._t_ns, "companion_lost", f"{seat.client.name}: {why}")
        if seat.missed_s is None:
            seat.missed_s = now_s
        elif seat.client.control and now_s - seat.missed_s > self._waiting.reconnect_s:
            self._part(seat, why)

    def _step_waiting(self, until_ns: int) -> None:
        """Every client that has a frame to take, and is free by then."""
        asked: list[tuple[Seat, Bundle, bool]] = []
        # To those that control last, and from them first: what the others cost is not charged to them.
        for seat in sorted(self.seats.values(), key=lambda seat: seat.client.control):
            pending = seat.pending
            if pending is not None and seat.free_ns <= until_ns:
                if self._lost_on_the_way(seat):
                    continue
                asked.append((seat, pending, self._send(seat)))
                seat.pending = None
        for seat, bundle, sent in reversed(asked):
            answer = self._answer(seat, bundle, sent)
            if answer is None:
                continue
            if self._mode == "lockstep":
                self._take(seat, answer, self._t_ns, bundle.t_ns)
                continue
            taken_ns = max(bundle.t_ns, seat.free_ns)
            link_ns = answer.link_ns if self._link_delay_ns is None else self._link_delay_ns
            seat.free_ns = taken_ns + answer.t2_ns + link_ns
            self._take(seat, answer, seat.free_ns, bundle.t_ns)

    def _send(self, seat: Seat) -> bool:
        assert seat.pending is not None
        frame = seat.pending.frame(seat.client.topics)
        if not self._answers.send(seat.client.name, frame, seat.pending.dropped):
            return False
        seat.sent += 1
        return True

    def _answer(self, seat: Seat, bundle: Bundle, sent: bool) -> Answer | None:
        """The answer to a frame, asked again of a client that was lost and came back; None of one given up.

        However often it comes back without an answer, this takes no longer than reply_s twice and reconnect_s.
        """
        name, number = seat.client.name, bundle.number
        lost_s: float | None = None
        while True:
            answer = self._answers.wait(name, number, self._waiting.reply_s) if sent else None
            if answer is not None:
                return answer
            why = self._answers.gone(name) or f"no answer to frame {number} within {self._waiting.reply_s:g} s"
            if not sent and self._answers.gone(name) is None:
                why = (
                    f"frame {number} cannot be given to it: it gives no credit, or the frame is too large for the link"
                )
            now_s = time.monotonic()
            lost_s = now_s if lost_s is None else lost_s
            if not self._give_up(seat, number, why, self._waiting.reconnect_s - (now_s - lost_s)):
                return None
            seat.pending = bundle
            sent = self._send(seat)
            seat.pending = None

    def _give_up(self, seat: Seat, frame: int, why: str, back_s: float) -> bool:
        """Let a client go that is gone or silent; True if it came back in time. An observer is not waited for."""
        client = seat.client
        back_s = 0.0 if seat.finished else back_s  # it has done what it came for
        self._on_event(self._t_ns, "companion_lost", f"{client.name}: {why}")
        if self._answers.lose(client.name, why, max(back_s, 0.0) if client.control else 0.0) and back_s > 0.0:
            there = {c.name: c for c in self._answers.clients(self.frames)}
            back = there.get(client.name, client)
            if back.control or not client.control:
                seat.client = back
                self._on_event(self._t_ns, "companion_back", client.name)
                return True
            why = f"{why}; it came back without control"
        else:
            why = self._answers.gone(client.name) or why
        if client.control and self._trace is not None:
            self._trace.lost(client.name, frame)
        self._part(seat, why)
        return False

    def _part(self, seat: Seat, why: str) -> None:
        """For good. LinkClosed where that ends the run."""
        client = seat.client
        self._leave(client.name)
        if client.control and self._waiting.lost_is_error and not seat.finished:
            limit = f"{self._waiting.reconnect_s:g} s (companion.reply_timeout_s, companion.reconnect_s)"
            raise LinkClosed(
                f"companion {client.name}", f"{why}, and it did not come back within {limit}", cause="companion"
            )

    def _take(self, seat: Seat, answer: Answer, from_ns: int, frame_ns: int) -> None:
        """An answer that holds from `from_ns` on, to the frame of `frame_ns`."""
        if self._faults is not None:
            from_ns = self._faults.late(seat.client.name, from_ns)
        if answer.report is not None:
            seat.report = answer.report
            self._on_report(seat.client.name, answer.report, from_ns)
        if answer.detections is not None:
            self._on_detections(seat.client.name, answer.detections, self._t_ns)
        if not seat.client.control:
            if answer.detections is not None and self._trace is not None:
                self._trace.looked_on(seat.client.name, self._t_ns, answer)
            return
        if self._trace is not None:
            self._trace.answer(seat.client.name, answer)
        if self._desire is None:
            return
        if answer.desired is not None and not seat.finished:  # whoever has finished is landed, and flies on no more
            self._desire(answer.desired, from_ns, frame_ns)
            if self._timing is not None:
                self._timing.desired(seat.client.name, answer.frame, from_ns)
        if answer.finished and not seat.finished:
            seat.finished = True
            if self.finished:
                self._desire(DesiredState(land=True), from_ns, frame_ns)
