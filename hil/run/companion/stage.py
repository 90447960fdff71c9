"""Sends frames to the clients and applies their answers, tick by tick, in one of three time modes.

lockstep      The bench waits for every answer. It applies from the time of the frame on, so it moves the vehicle one
              tick later. Simulated time never passes while a client computes.

realtime      The bench does not wait. A client that is idle gets the newest frame; frames made while it was busy are
              dropped and counted. An answer applies from the tick in which it arrived.

latency_true  Like realtime, but in simulated time: the bench waits for the answer and then charges the time it took.
              Let t_free be the time at which a client finished its previous frame, and t_f the time of the newest
              frame made until then, or else of the next one:

                  t_start = max(t_f, t_free)      t_free' = t_start + t2 + link

              link: the delay of the link, both ways, as measured or a fixed time.

              The answer applies from t_free' on, and until then the client gets no frame. So a slow computer flies as
              it would fly live, however fast or busy this one is, and the trace of answers repeats the run bit for bit.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from firmware_bridge.codecs.companion import ReportValue
from hil.run.companion.answers import Answer, Answers, Client
from hil.run.companion.bundle import Bundle, Collector
from hil.run.companion.link_faults import CompanionFaults
from hil.run.companion.pacing import FramePacing
from hil.run.companion.timing import TimingLog
from hil.run.companion.trace import TraceWriter
from signals.desired import DesiredState
from signals.detections import Detections
from signals.errors import LinkClosed
from signals.samples import Sample, TruthState


@dataclass(frozen=True)
class AnswerCallbacks:
    """Receivers of the parts of an answer. Times are simulated [ns]."""

    desired: Callable[[DesiredState, int, int], None] | None = None  # desired state, applies from, time of its frame
    reported: Callable[[str, Mapping[str, ReportValue], int], None] = lambda _client, _report, _t_ns: None
    detected: Callable[[str, Detections, int], None] = lambda _client, _detections, _t_ns: None


@dataclass(frozen=True)
class CompanionLogs:
    """Files that the stage writes while it runs; None: not written."""

    trace: TraceWriter | None = None
    timing: TimingLog | None = None


@dataclass
class ClientSession:
    """The state of one client, kept over its reconnections."""

    client: Client
    pending: Bundle | None = None
    free_ns: int = 0  # simulated time from which it is idle; latency_true
    awaited_frame: int | None = None  # sent and not answered yet; realtime
    awaited_t_ns: int = 0  # simulated time of that frame
    sent_s: float = 0.0  # wall clock at which it was sent
    disconnected: bool = False  # realtime
    unanswered_since_s: float | None = None  # wall clock of its loss, until it answers again; realtime
    sent: int = 0
    dropped: int = 0
    finished: bool = False
    report: Mapping[str, ReportValue] = field(default_factory=dict)


class CompanionStage:
    """Exchange of the scheduler that serves all clients of a run. `step` is called once per tick."""

    def __init__(
        self,
        answers: Answers,
        pacing: FramePacing,
        *,
        topics: Sequence[str],
        callbacks: AnswerCallbacks = AnswerCallbacks(),
        on_event: Callable[[int, str, str], None] = lambda _t_ns, _kind, _text: None,
        logs: CompanionLogs = CompanionLogs(),
        faults: CompanionFaults | None = None,
    ) -> None:
        self._answers, self._callbacks, self._on_event = answers, callbacks, on_event
        self._mode, self._timeouts, self._link_delay_ns = pacing.mode, pacing.timeouts, pacing.link_delay_ns
        self._due = pacing.rate.due
        self._collector = Collector(topics)
        self._trace, self._timing, self._faults = logs.trace, logs.timing, faults
        self._t_ns = 0
        self.frames = 0
        self.sessions: dict[str, ClientSession] = {}
        self.all_sessions: dict[str, ClientSession] = {}  # lost clients included
        self.losses: dict[str, tuple[int, str]] = {}  # unfinished clients without an answer since: simulated time, why
        self._update_clients(first=True)

    @property
    def finished(self) -> bool:
        """Return True if there are clients in control and all of them have finished."""
        controlling = [session for session in self.sessions.values() if session.client.control]
        return bool(controlling) and all(session.finished for session in controlling)

    def step(self, truth: TruthState, released: Sequence[tuple[str, Sample]]) -> None:
        """Run one tick with the samples it released. Raises LinkClosed if a client in control is lost for good."""
        self._t_ns = truth.t_ns
        self._collector.add(released)
        if self._due():
            if self._faults is not None:
                self._faults.step(truth.t_ns)
            if self._mode != "realtime":
                # A client that became idle since the last tick gets the frame made before, not the new one.
                self._step_blocking(truth.t_ns - 1)
                self._answers.receive()  # discards late answers, and updates which clients are connected
            self._update_clients()
            bundle = self._collector.take(self.frames, truth)
            if self._timing is not None:
                self._timing.made(bundle.number)
            self.frames += 1
            for session in self.sessions.values():
                if session.pending is not None:
                    session.dropped += 1
                session.pending = bundle.replacing(session.pending)
        if self._mode == "realtime":
            self._step_realtime()
        else:
            self._step_blocking(truth.t_ns)
        for client, detections in self._answers.observer_detections(truth.t_ns):
            self._callbacks.detected(client, detections, truth.t_ns)

    def serve(self, limit_s: float) -> None:
        """Exchange answers and frames between two ticks of a realtime run, for `limit_s` of wall clock."""
        deadline_s = time.monotonic() + limit_s
        left_s = limit_s
        while left_s > 0.0:
            self._exchange(left_s)
            left_s = deadline_s - time.monotonic()

    @property
    def free_running(self) -> bool:
        return self._mode == "realtime"

    def _update_clients(self, *, first: bool = False) -> None:
        """Add sessions of new clients, and remove those of observers that left."""
        connected = {client.name: client for client in self._answers.clients(self.frames)}
        for name in [name for name in self.sessions if name not in connected]:
            if not self.sessions[name].client.control:
                self._note_loss(self.sessions[name], self._answers.loss_reason(name) or "it is not connected")
                self._remove(name)
        for name, client in connected.items():
            if name not in self.sessions:
                self.sessions[name] = self.all_sessions.setdefault(name, ClientSession(client))
                self.sessions[name].client = client
                if client.control and self._trace is not None and not first:
                    self._trace.joined(client, self.frames)
            elif self._mode != "realtime":  # in realtime: _step_realtime, because the awaited frame is lost
                self._rejoin(self.sessions[name], client)
        self.sessions = dict(sorted(self.sessions.items()))

    def _rejoin(self, session: ClientSession, client: Client) -> None:
        """Update the session: a client may reconnect with other topics, or without control."""
        if session.client.control and not client.control:
            if self._trace is not None:
                self._trace.demoted(client.name, self.frames)
            self._lose(session, "it reconnected without control")
        else:
            session.client = client

    def _note_loss(self, session: ClientSession, reason: str) -> None:
        """Note that a client is gone, until it answers again. One that has finished is not missed."""
        if not session.finished:
            self.losses.setdefault(session.client.name, (self._t_ns, reason))

    def _remove(self, name: str) -> None:
        session = self.sessions.pop(name)
        session.pending = session.awaited_frame = session.unanswered_since_s = None  # not counted as dropped

    def _exchange(self, limit_s: float) -> None:
        """Apply the answers that arrive within the limit, and send each of their clients its pending frame."""
        for name, answer in self._answers.receive(limit_s):
            session = self.sessions.get(name)
            if session is not None and session.awaited_frame is not None and answer.frame >= session.awaited_frame:
                session.awaited_frame = session.unanswered_since_s = None
                self._apply(session, answer, self._t_ns, session.awaited_t_ns)
                self._send_if_idle(session)

    def _send_if_idle(self, session: ClientSession) -> None:
        pending = session.pending
        if pending is None or session.awaited_frame is not None or self._dropped_by_fault(session, pending):
            return
        if self._send(session, pending):
            session.awaited_frame, session.awaited_t_ns = pending.number, pending.t_ns
            session.sent_s = time.monotonic()
            session.pending = None

    def _dropped_by_fault(self, session: ClientSession, pending: Bundle) -> bool:
        """Return True if a fault drops the pending frame with all its samples."""
        if self._faults is None or not self._faults.lose(session.client.name, pending.number):
            return False
        session.dropped += 1
        session.pending = None
        return True

    def _step_realtime(self) -> None:
        self._exchange(0.0)
        connected = {client.name: client for client in self._answers.clients(self.frames)}
        now_s = time.monotonic()
        for name, session in list(self.sessions.items()):
            client = connected.get(name)
            if client is None or (session.client.control and not client.control):
                self._mark_lost(session, now_s, self._answers.loss_reason(name) or "it gave up control")
                continue
            if client.reconnections != session.client.reconnections:
                self._mark_lost(session, now_s, "its connection ended")
            elif session.awaited_frame is not None and now_s - session.sent_s > self._timeouts.reply_s:
                reason = f"no answer to frame {session.awaited_frame} within {self._timeouts.reply_s:g} s"
                self._answers.disconnect(name, reason, 0.0)
                self._mark_lost(session, now_s, reason)
                continue
            if name not in self.sessions:
                continue
            session.client = client
            if session.disconnected:
                session.disconnected = False
                self._on_event(self._t_ns, "companion_back", name)
            self._send_if_idle(session)

    def _mark_lost(self, session: ClientSession, now_s: float, reason: str) -> None:
        """Note that a client is lost. The flight goes on without it for `reconnect_s`.

        Only an answer stops that timeout; a new connection alone does not.
        """
        session.awaited_frame = None
        if not session.disconnected:
            session.disconnected = True
            self._note_loss(session, reason)
            self._on_event(self._t_ns, "companion_lost", f"{session.client.name}: {reason}")
        if session.unanswered_since_s is None:
            session.unanswered_since_s = now_s
        elif session.client.control and now_s - session.unanswered_since_s > self._timeouts.reconnect_s:
            self._lose(session, reason)

    def _step_blocking(self, until_ns: int) -> None:
        """Send the pending frames of all clients that are idle by `until_ns`, and wait for the answers."""
        requests: list[tuple[ClientSession, Bundle, bool]] = []
        # The bench sends to clients in control last and waits for them first: their time excludes that of the others.
        for session in sorted(self.sessions.values(), key=lambda session: session.client.control):
            pending = session.pending
            if pending is not None and session.free_ns <= until_ns:
                if self._dropped_by_fault(session, pending):
                    continue
                requests.append((session, pending, self._send(session, pending)))
                session.pending = None
        for session, bundle, sent in reversed(requests):
            answer = self._answer(session, bundle, sent)
            if answer is None:
                continue
            if self._mode == "lockstep":
                self._apply(session, answer, self._t_ns, bundle.t_ns)
                continue
            start_ns = max(bundle.t_ns, session.free_ns)
            link_ns = answer.link_ns if self._link_delay_ns is None else self._link_delay_ns
            session.free_ns = start_ns + answer.t2_ns + link_ns
            self._apply(session, answer, session.free_ns, bundle.t_ns)

    def _send(self, session: ClientSession, pending: Bundle) -> bool:
        frame = pending.frame(session.client.topics)
        if not self._answers.send(session.client.name, frame, pending.dropped):
            return False
        session.sent += 1
        return True

    def _answer(self, session: ClientSession, bundle: Bundle, sent: bool) -> Answer | None:
        """Wait for the answer to a frame, which is sent again after a reconnection. None: the client is lost for good.

        Takes at most twice `reply_s` plus `reconnect_s`, for any number of reconnections.
        """
        name, number = session.client.name, bundle.number
        lost_s: float | None = None
        while True:
            answer = self._answers.wait(name, number, self._timeouts.reply_s) if sent else None
            if answer is not None:
                return answer
            reason = self._answers.loss_reason(name)
            if reason is None and sent:
                reason = f"no answer to frame {number} within {self._timeouts.reply_s:g} s"
            elif reason is None:
                reason = f"frame {number} cannot be sent: the client grants no credit, or the frame exceeds the link"
            now_s = time.monotonic()
            lost_s = now_s if lost_s is None else lost_s
            if not self._reconnected(session, number, reason, self._timeouts.reconnect_s - (now_s - lost_s)):
                return None
            sent = self._send(session, bundle)

    def _reconnected(self, session: ClientSession, frame: int, reason: str, limit_s: float) -> bool:
        """Disconnect a client that did not answer `frame`. If it is in control, wait until it reconnects."""
        client = session.client
        limit_s = 0.0 if session.finished else limit_s  # a client that has finished is not needed any more
        self._on_event(self._t_ns, "companion_lost", f"{client.name}: {reason}")
        self._note_loss(session, reason)
        wait_s = max(limit_s, 0.0) if client.control else 0.0
        if self._answers.disconnect(client.name, reason, wait_s) and limit_s > 0.0:
            connected = {c.name: c for c in self._answers.clients(self.frames)}
            new = connected.get(client.name, client)
            if new.control or not client.control:
                session.client = new
                self._on_event(self._t_ns, "companion_back", client.name)
                return True
            reason = f"{reason}; it reconnected without control"
        else:
            reason = self._answers.loss_reason(client.name) or reason
        if client.control and self._trace is not None:
            self._trace.lost(client.name, frame)
        self._lose(session, reason)
        return False

    def _lose(self, session: ClientSession, reason: str) -> None:
        """Remove a client for good. Raises LinkClosed if that ends the run."""
        client = session.client
        self._remove(client.name)
        if client.control and self._timeouts.loss_is_error and not session.finished:
            limit = f"{self._timeouts.reconnect_s:g} s (companion.reply_timeout_s, companion.reconnect_s)"
            raise LinkClosed(
                f"companion {client.name}", f"{reason}, and it did not come back within {limit}", cause="companion"
            )

    def _apply(self, session: ClientSession, answer: Answer, from_ns: int, frame_ns: int) -> None:
        """Apply an answer to the frame made at `frame_ns`, from `from_ns` on."""
        name = session.client.name
        self.losses.pop(name, None)
        if self._faults is not None:
            from_ns = self._faults.delayed(name, from_ns)
        if answer.report is not None:
            session.report = answer.report
            self._callbacks.reported(name, answer.report, from_ns)
        if answer.detections is not None:
            self._callbacks.detected(name, answer.detections, self._t_ns)
        if not session.client.control:
            session.finished |= answer.finished
            if answer.detections is not None and self._trace is not None:
                self._trace.observer_detected(name, self._t_ns, answer)
            return
        if self._trace is not None:
            self._trace.answer(name, answer)
        set_desired = self._callbacks.desired
        if set_desired is None:
            return
        if answer.desired is not None and not session.finished:  # after `finished` the vehicle lands
            set_desired(answer.desired, from_ns, frame_ns)
            if self._timing is not None:
                self._timing.desired(name, answer.frame, from_ns)
        if answer.finished and not session.finished:
            session.finished = True
            if self.finished:
                set_desired(DesiredState(land=True), from_ns, frame_ns)
