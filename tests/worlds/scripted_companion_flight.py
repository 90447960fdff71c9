"""A companion stage flown by the tick with scripted clients."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from firmware_bridge.companion.frames import CompanionFrame
from hil.run.companion.answers import Answer, Client
from hil.run.companion.pacing import FramePacing, TimeMode, Timeouts
from hil.run.companion.stage import AnswerCallbacks, CompanionLogs, CompanionStage
from hil.run.companion.trace import TraceWriter
from signals.desired import DesiredState
from signals.samples import ImuSample, Sample, TruthState
from signals.time import RateAccumulator

MS = 1_000_000
TICK_NS = 4 * MS
FRAME_HZ, TICK_HZ = 25, 250
FRAME_NS = 40 * MS
PILOT = Client("pilot", frozenset({"truth", "imu"}), True)
WATCHER = Client("watcher", frozenset({"imu"}), False)
TIMEOUTS = Timeouts(0.01, 0.01, True)
Cut = Callable[[CompanionFrame], Answer | None]


def answer(frame: int, t2_ns: int = 0, *, finished: bool = False, desired: bool = True) -> Answer:
    return Answer(frame, DesiredState(p_W=(float(frame), 0.0, 2.0)) if desired else None, finished, t2_ns)


@dataclass
class Clients:
    """Scripted clients: each answers by a function, and those not in `connected` are lost."""

    cuts: dict[str, Cut]
    connected: list[Client] = field(default_factory=lambda: [PILOT])
    frames: dict[str, list[CompanionFrame]] = field(default_factory=dict)
    dropped: dict[str, list[int]] = field(default_factory=dict)
    lost: list[tuple[str, str]] = field(default_factory=list)
    reconnects: list[bool] = field(default_factory=list)  # by loss, in order: True if the client reconnects
    ready: list[tuple[str, Answer]] = field(default_factory=list)  # returned by `receive`
    accepts_frames: bool = True
    waits: int = 0

    def clients(self, frame: int) -> Sequence[Client]:
        return sorted(self.connected, key=lambda c: c.name)

    def loss_reason(self, client: str) -> str | None:
        if any(c.name == client for c in self.connected):
            return None
        return dict(self.lost).get(client, "its connection ended")

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:
        if not self.accepts_frames or self.loss_reason(client):
            return False
        self.frames.setdefault(client, []).append(frame)
        self.dropped.setdefault(client, []).append(dropped)
        return True

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:
        self.waits += 1
        assert self.frames[client][-1].frame == frame
        return None if self.loss_reason(client) else self.cuts[client](self.frames[client][-1])

    def receive(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:
        received, self.ready = self.ready, []
        return received

    def observer_detections(self, t_ns: int) -> list[Any]:
        return []

    def disconnect(self, client: str, reason: str, reconnect_s: float) -> bool:
        self.lost.append((client, reason))
        gone = [c for c in self.connected if c.name == client]
        self.connected = [c for c in self.connected if c.name != client]
        back = bool(self.reconnects) and self.reconnects.pop(0) and reconnect_s > 0.0
        if back:
            self.connected += [Client(c.name, c.topics, c.control, c.reconnections + 1) for c in gone or [PILOT]]
        return back


def truth(tick: int) -> TruthState:
    zero = (0.0, 0.0, 0.0)
    return TruthState(tick, tick * TICK_NS, zero, (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (0.0,) * 4, False)


def imu(tick: int) -> tuple[str, Sample]:
    return "imu", ImuSample(tick, tick * TICK_NS, tick * TICK_NS, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0), 25.0)


@dataclass
class Flight:
    """A stage, its clients, and the desired states that it set."""

    clients: Any
    mode: TimeMode
    timeouts: Timeouts = TIMEOUTS
    link_delay_ns: int | None = 0
    trace: TraceWriter | None = None
    desired: list[tuple[DesiredState, int]] = field(default_factory=list)
    events: list[tuple[str, str]] = field(default_factory=list)
    reports: list[tuple[str, Any, int]] = field(default_factory=list)
    seen: list[tuple[str, Any, int]] = field(default_factory=list)
    tick: int = 0

    def __post_init__(self) -> None:
        self.stage = CompanionStage(
            self.clients,
            FramePacing(
                self.mode,
                RateAccumulator(event_millihz=FRAME_HZ * 1000, tick_millihz=TICK_HZ * 1000),
                self.timeouts,
                self.link_delay_ns,
            ),
            topics=["imu", "truth"],
            callbacks=AnswerCallbacks(
                self._desire,
                lambda client, report, t_ns: self.reports.append((client, report, t_ns)),
                lambda client, detections, t_ns: self.seen.append((client, detections, t_ns)),
            ),
            on_event=lambda _t_ns, kind, text: self.events.append((kind, text)),
            logs=CompanionLogs(self.trace),
        )

    def _desire(self, desired: DesiredState, from_ns: int, frame_ns: int) -> None:
        # In every kind of time an answer refers to the time of its frame and applies from then on at the earliest.
        assert frame_ns <= from_ns
        if desired.p_W is not None:
            assert frame_ns == int(desired.p_W[0]) * FRAME_NS
        self.desired.append((desired, from_ns))

    def fly(self, ticks: int, each: Callable[[int], None] = lambda _tick: None) -> None:
        for _ in range(ticks):
            each(self.tick)
            self.stage.step(truth(self.tick), [imu(self.tick)])
            self.tick += 1

    def applied(self) -> list[tuple[int, int]]:
        """Return (frame, applies from [ns]) of every desired state that was set."""
        return [(int(d.p_W[0]), from_ns) for d, from_ns in self.desired if d.p_W is not None]


def repeat(values: Sequence[int]) -> Iterator[int]:
    while True:
        yield from values
