"""A companion stage flown by the tick with scripted clients."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from firmware_bridge.companion.frames import CompanionFrame
from hil.companion.answers import Answer, Client
from hil.companion.stage import CompanionStage, TimeMode, Waiting
from hil.companion.trace import TraceWriter
from hil.signals.desired import DesiredState
from hil.signals.samples import ImuSample, Sample, TruthState
from hil.signals.time import RateAccumulator

MS = 1_000_000
TICK_NS = 4 * MS
FRAME_HZ, TICK_HZ = 25, 250
FRAME_NS = 40 * MS
PILOT = Client("pilot", frozenset({"truth", "imu"}), True)
WATCHER = Client("watcher", frozenset({"imu"}), False)
WAITING = Waiting(0.01, 0.01, True)
Cut = Callable[[CompanionFrame], Answer | None]


def answer(frame: int, t2_ns: int = 0, *, finished: bool = False, desired: bool = True) -> Answer:
    return Answer(frame, DesiredState(p_W=(float(frame), 0.0, 2.0)) if desired else None, finished, t2_ns)


@dataclass
class Clients:
    """Answers by a function each; those in `silent` never answer, and those not in `there` are gone."""

    cuts: dict[str, Cut]
    there: list[Client] = field(default_factory=lambda: [PILOT])
    frames: dict[str, list[CompanionFrame]] = field(default_factory=dict)
    dropped: dict[str, list[int]] = field(default_factory=dict)
    lost: list[tuple[str, str]] = field(default_factory=list)
    returns: list[bool] = field(default_factory=list)  # whether a lost one comes back, in turn; then no more
    ready: list[tuple[str, Answer]] = field(default_factory=list)  # what `take` hands over
    takes_frames: bool = True
    waits: int = 0

    def clients(self, frame: int) -> Sequence[Client]:
        return sorted(self.there, key=lambda c: c.name)

    def gone(self, client: str) -> str | None:
        if any(c.name == client for c in self.there):
            return None
        return dict(self.lost).get(client, "its connection ended")

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:
        if not self.takes_frames or self.gone(client):
            return False
        self.frames.setdefault(client, []).append(frame)
        self.dropped.setdefault(client, []).append(dropped)
        return True

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:
        self.waits += 1
        assert self.frames[client][-1].frame == frame
        return None if self.gone(client) else self.cuts[client](self.frames[client][-1])

    def take(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:
        come, self.ready = self.ready, []
        return come

    def lose(self, client: str, why: str, back_within_s: float) -> bool:
        self.lost.append((client, why))
        gone = [c for c in self.there if c.name == client]
        self.there = [c for c in self.there if c.name != client]
        back = bool(self.returns) and self.returns.pop(0) and back_within_s > 0.0
        if back:
            self.there += [Client(c.name, c.topics, c.control, c.returned + 1) for c in gone or [PILOT]]
        return back


def truth(tick: int) -> TruthState:
    zero = (0.0, 0.0, 0.0)
    return TruthState(tick, tick * TICK_NS, zero, (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (0.0,) * 4, False)


def imu(tick: int) -> tuple[str, Sample]:
    return "imu", ImuSample(tick, tick * TICK_NS, tick * TICK_NS, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0), 25.0)


@dataclass
class Flight:
    """A stage, its clients, and what the vehicle was told."""

    clients: Any
    mode: TimeMode
    waiting: Waiting = WAITING
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
            mode=self.mode,
            topics=["imu", "truth"],
            rate=RateAccumulator(event_mhz=FRAME_HZ * 1000, tick_mhz=TICK_HZ * 1000),
            waiting=self.waiting,
            link_delay_ns=self.link_delay_ns,
            desire=self._desire,
            on_report=lambda client, report, t_ns: self.reports.append((client, report, t_ns)),
            on_detections=lambda client, detections, t_ns: self.seen.append((client, detections, t_ns)),
            detected_then=getattr(self.clients, "detected_then", lambda _t_ns: ()),
            on_event=lambda _t_ns, kind, text: self.events.append((kind, text)),
            trace=self.trace,
        )

    def _desire(self, desired: DesiredState, from_ns: int, frame_ns: int) -> None:
        # In every kind of time an answer speaks of its own frame's instant, and counts from then on at the earliest.
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
        """(frame, from when [ns]) of every set desired state."""
        return [(int(d.p_W[0]), from_ns) for d, from_ns in self.desired if d.p_W is not None]


def repeat(values: Sequence[int]) -> Iterator[int]:
    while True:
        yield from values
