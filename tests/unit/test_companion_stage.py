"""The companion's stage against an event simulation of 'the latest frame wins', with clients made of a few lines."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.companion.frames import CompanionFrame
from hil.companion.answers import Answer, Client
from hil.companion.stage import CompanionStage, TimeMode, Waiting
from hil.companion.trace import TracedAnswers, TraceWriter
from hil.signals.desired import DesiredState
from hil.signals.detections import Detections
from hil.signals.errors import LinkClosed, LockstepLost, RecordingError
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


def latest_frame_wins(t2_ns: Iterator[int], delay_ns: int, until_ns: int) -> list[tuple[int, int]]:
    """(frame taken, instant at which its answer holds) of one client that computes on a clock without ticks.

    Two kinds of events only: a frame appears at k * FRAME_NS; the client is done. At one instant frames come first.
    """
    done = []
    shelf: int | None = None
    free_ns = 0
    for frame in range(until_ns // FRAME_NS + 1):
        now_ns = frame * FRAME_NS
        while shelf is not None and free_ns < now_ns:  # done before this frame appeared: it takes the one on the shelf
            begun_ns, shelf_was, shelf = max(free_ns, shelf * FRAME_NS), shelf, None
            free_ns = begun_ns + next(t2_ns) + delay_ns
            done.append((shelf_was, free_ns))
        shelf = frame
        if free_ns <= now_ns:
            free_ns = now_ns + next(t2_ns) + delay_ns
            done.append((shelf, free_ns))
            shelf = None
    if shelf is not None and free_ns <= until_ns:
        done.append((shelf, free_ns + next(t2_ns) + delay_ns))
    return done


def latency_true(
    t2_ns: Sequence[int], delay_ns: int = 0, ticks: int = 300, *, measured: bool = False
) -> tuple[Flight, list[tuple[int, int]]]:
    """A flight with a client that takes these times in turn, and what should have come of it.

    The link's delay is a setting, or what was measured.
    """
    times = _repeat(t2_ns)
    measured_ns = delay_ns if measured else 987_654_321
    clients = Clients({"pilot": lambda f: replace(answer(f.frame, next(times)), link_ns=measured_ns)})
    flight = Flight(clients, "latency_true", link_delay_ns=None if measured else delay_ns)
    flight.fly(ticks)
    return flight, latest_frame_wins(_repeat(t2_ns), delay_ns, (ticks - 1) * TICK_NS)


def _repeat(values: Sequence[int]) -> Iterator[int]:
    while True:
        yield from values


@pytest.mark.parametrize("t2_ms", [0, 5, 39, 40, 41, 44, 50, 79, 80, 81, 200])
def test_latency_true_takes_the_frames_that_a_live_client_would(t2_ms: int) -> None:
    flight, expected = latency_true([t2_ms * MS])
    assert flight.applied() == expected
    sent = [frame.frame for frame in flight.clients.frames["pilot"]]
    assert sent == [frame for frame, _ in expected]
    if t2_ms == 200:
        assert sent[:3] == [0, 5, 10]
    if t2_ms == 50:
        # free at 50, 100, 150, 200 ms: the newest frames by then are 1 (40 ms), 2, 3, and 5, which appears at 200 ms
        assert flight.applied()[:5] == [(0, 50 * MS), (1, 100 * MS), (2, 150 * MS), (3, 200 * MS), (5, 250 * MS)]


@given(
    st.lists(st.integers(0, 210 * MS) | st.sampled_from([39, 40, 41, 44]).map(lambda x: x * MS), min_size=1),
    st.sampled_from([0, MS, 3 * MS + 1]),
    st.booleans(),
)
def test_latency_true_is_the_event_simulation(t2_ns: list[int], delay_ns: int, measured: bool) -> None:
    flight, expected = latency_true(t2_ns, delay_ns, ticks=120, measured=measured)
    assert flight.applied() == expected
    seat = flight.stage.seats["pilot"]
    assert seat.sent + seat.dropped + (seat.pending is not None) == flight.stage.frames
    dropped = flight.clients.dropped["pilot"]
    numbers = [frame.frame for frame in flight.clients.frames["pilot"]]
    assert [b - a - 1 for a, b in zip([-1, *numbers], numbers, strict=False)] == dropped


@given(st.lists(st.integers(0, 210 * MS), min_size=1), st.sampled_from(["lockstep", "realtime", "latency_true"]))
def test_no_imu_sample_is_lost_or_comes_twice(t2_ns: list[int], mode: TimeMode) -> None:
    times = _repeat(t2_ns)
    clients = Clients({"pilot": lambda frame: answer(frame.frame, next(times))})
    flight = Flight(clients, mode, Waiting(100.0, 100.0, True))
    busy_ns = 0

    def live(tick: int) -> None:
        nonlocal busy_ns
        if mode == "realtime" and flight.stage.seats["pilot"].under_way is not None and tick * TICK_NS >= busy_ns:
            clients.ready.append(("pilot", answer(clients.frames["pilot"][-1].frame)))
            busy_ns = tick * TICK_NS + next(times)

    flight.fly(151, live)
    frames = clients.frames["pilot"]
    rows = [row for frame in frames for s in frame.samples if s.topic == "imu" for row in s.values["seq"]]
    assert rows == list(range(frames[-1].tick + 1))
    for frame in frames:
        (state,) = [s for s in frame.samples if s.topic == "truth"]
        assert state.t_capture_ns == frame.t_ns == frame.tick * TICK_NS


def test_lockstep_gives_every_frame_and_applies_at_its_instant() -> None:
    flight = Flight(Clients({"pilot": lambda frame: answer(frame.frame, 200 * MS)}), "lockstep")
    flight.fly(51)
    assert flight.applied() == [(n, n * FRAME_NS) for n in range(6)]
    assert flight.stage.seats["pilot"].dropped == 0


def test_realtime_passes_frames_by_and_applies_in_the_tick_of_the_answer() -> None:
    clients = Clients({})
    flight = Flight(clients, "realtime", Waiting(100.0, 100.0, True))

    def live(tick: int) -> None:
        if tick in (13, 33):  # 52 and 132 ms
            clients.ready.append(("pilot", answer(clients.frames["pilot"][-1].frame)))
        if tick == 20:
            clients.ready += [("pilot", answer(0)), ("nobody", answer(1))]  # of the past, and of a stranger

    flight.fly(50, live)
    assert [frame.frame for frame in clients.frames["pilot"]] == [0, 1, 3]
    assert flight.applied() == [(0, 52 * MS), (1, 132 * MS)]
    assert clients.dropped["pilot"] == [0, 0, 1]
    assert clients.waits == 0


def test_observers_come_and_go_and_change_nothing() -> None:
    alone = Flight(Clients({"pilot": lambda f: answer(f.frame, 50 * MS)}), "latency_true")
    alone.fly(200)
    clients = Clients(
        {
            "pilot": lambda f: answer(f.frame, 50 * MS),
            "watcher": lambda f: answer(f.frame, 7 * MS) if f.frame < 12 else None,
        }
    )
    flight = Flight(clients, "latency_true")

    def come_and_go(tick: int) -> None:
        if tick in (30, 90):
            clients.there.append(WATCHER)
        if tick == 60:
            clients.there.remove(WATCHER)

    flight.fly(200, come_and_go)
    assert flight.desired == alone.desired
    watched = clients.frames["watcher"]
    assert [frame.frame for frame in watched] == [3, 4, 5, 9, 10, 11, 12]
    assert watched[3].samples[0].values["seq"] == list(range(81, 91))  # not what it missed while it was away
    assert clients.lost == [("watcher", "no answer to frame 12 within 0.01 s")]
    assert ("companion_lost", "watcher: no answer to frame 12 within 0.01 s") in flight.events
    assert flight.stage.all_seats["watcher"].sent == 7


@pytest.mark.parametrize("mode", ["lockstep", "latency_true"])
def test_loss_of_the_pilot_is_an_error_with_words(mode: TimeMode) -> None:
    clients = Clients({"pilot": lambda f: answer(f.frame) if f.frame < 3 else None})
    with pytest.raises(LinkClosed, match=r"companion pilot: no answer to frame 3 .*did not come back") as caught:
        Flight(clients, mode).fly(100)
    assert caught.value.cause == "companion"
    clients = Clients({"pilot": lambda f: answer(f.frame)})

    def leave(tick: int) -> None:
        if tick == 25:
            clients.there.clear()

    with pytest.raises(LinkClosed, match="its connection ended"):
        Flight(clients, mode).fly(100, leave)


def test_the_flight_may_go_on_without_its_pilot() -> None:
    clients = Clients({"pilot": lambda f: answer(f.frame) if f.frame < 3 else None})
    flight = Flight(clients, "lockstep", Waiting(0.01, 0.01, False))
    flight.fly(100)
    assert [frame for frame, _ in flight.applied()] == [0, 1, 2]
    assert not flight.stage.finished
    assert flight.stage.frames == 10


def test_a_pilot_that_comes_back_gets_the_frame_again() -> None:
    failures = [3]

    def cut(frame: CompanionFrame) -> Answer | None:
        if frame.frame in failures:
            failures.remove(frame.frame)
            return None
        return answer(frame.frame)

    clients = Clients({"pilot": cut}, returns=[True])
    flight = Flight(clients, "lockstep", Waiting(0.01, 10.0, True))
    flight.fly(61)
    assert [frame for frame, _ in flight.applied()] == list(range(7))
    assert [kind for kind, _ in flight.events] == ["companion_lost", "companion_back"]


def test_a_pilot_that_only_ever_comes_back_is_lost() -> None:
    clients = Clients({"pilot": lambda _f: None}, returns=[True] * 1_000_000)
    with pytest.raises(LinkClosed):
        Flight(clients, "lockstep", Waiting(0.0, 0.02, True)).fly(1)


def test_a_pilot_that_comes_back_as_an_observer_is_lost() -> None:
    for mode in ("lockstep", "latency_true", "realtime"):
        clients = Clients({"pilot": lambda f: answer(f.frame)})

        def demote(tick: int, clients: Clients = clients) -> None:
            if tick == 15:
                clients.there[:] = [Client("pilot", PILOT.topics, False, 1)]

        with pytest.raises(LinkClosed, match="control"):
            Flight(clients, mode, Waiting(1.0, 0.0, True)).fly(1000, demote)  # type: ignore[arg-type]


def test_a_frame_that_cannot_be_given_is_named() -> None:
    with pytest.raises(LinkClosed, match="frame 0 cannot be given"):
        Flight(Clients({}, takes_frames=False), "lockstep").fly(1)


def test_realtime_forgets_what_was_under_way_on_an_ended_connection() -> None:
    clients = Clients({})
    flight = Flight(clients, "realtime", Waiting(100.0, 100.0, True))

    def bounce(tick: int) -> None:
        if tick == 5:
            clients.there[:] = [Client("pilot", PILOT.topics, True, 1)]

    flight.fly(15, bounce)
    assert [frame.frame for frame in clients.frames["pilot"]] == [0, 1]
    assert [kind for kind, _ in flight.events] == ["companion_lost", "companion_back"]


@pytest.mark.parametrize("on_loss", [True, False])
def test_realtime_pilot_that_never_answers_again(on_loss: bool) -> None:
    clients = Clients({}, returns=[])
    flight = Flight(clients, "realtime", Waiting(0.0, 0.0, on_loss))
    if on_loss:
        with pytest.raises(LinkClosed, match=r"no answer to frame 0|its connection ended"):
            flight.fly(100)
    else:
        flight.fly(100)
        assert flight.stage.seats == {}


def test_finished_lands_once_from_the_answers_time_on() -> None:
    cut = {"pilot": lambda f: answer(f.frame, 50 * MS, finished=f.frame >= 2, desired=f.frame < 2)}
    flight = Flight(Clients(cut), "latency_true")
    flight.fly(100)
    lands = [(d, from_ns) for d, from_ns in flight.desired if d.land]
    assert lands == [(DesiredState(land=True), 150 * MS)]
    assert flight.stage.finished


def test_the_trace_repeats_the_flight(tmp_path: Path) -> None:
    path = tmp_path / "companion.jsonl"
    times = _repeat([5 * MS, 77 * MS, 123_456_789, 0])

    def cut(frame: CompanionFrame) -> Answer:
        given = answer(frame.frame, next(times), desired=frame.frame % 3 > 0, finished=frame.frame > 20)
        return replace(given, link_ns=1000 * frame.frame)

    clients = Clients({"pilot": cut})
    trace = TraceWriter(path, [PILOT], ["truth", "imu"])
    live = Flight(clients, "latency_true", link_delay_ns=None, trace=trace)
    live.fly(300)
    trace.close()
    traced = TracedAnswers(path)
    assert traced.topics == {"truth", "imu"}
    again = Flight(traced, "latency_true", link_delay_ns=None)
    again.fly(300)
    assert again.desired == live.desired
    assert len(live.desired) > 8
    with pytest.raises(LockstepLost, match="another run"):
        again.fly(400)


def traced(
    path: Path,
    clients: Clients,
    mode: TimeMode,
    ticks: int,
    *,
    waiting: Waiting = WAITING,
    each: Callable[[int], None] = lambda _tick: None,
) -> Flight:
    """A flight that was the same once more from its trace."""
    trace = TraceWriter(path, clients.clients(0), ["truth", "imu"])
    flight = Flight(clients, mode, waiting, trace=trace)
    flight.fly(ticks, each)
    trace.close()
    again = Flight(TracedAnswers(path), mode, waiting)
    again.fly(ticks)
    assert again.desired == flight.desired
    return flight


def test_a_loss_and_a_latecomer_are_in_the_trace(tmp_path: Path) -> None:
    clients = Clients({"pilot": lambda f: answer(f.frame) if f.frame != 3 else None})

    def come_back(tick: int) -> None:
        if tick == 75:
            clients.there.append(Client("pilot", PILOT.topics, True, 1))

    flight = traced(tmp_path / "t", clients, "lockstep", 120, waiting=Waiting(0.0, 0.0, False), each=come_back)
    assert [frame for frame, _ in flight.applied()] == [0, 1, 2, 8, 9, 10, 11]


def test_a_pilot_that_comes_before_the_first_frame_is_in_the_trace(tmp_path: Path) -> None:
    clients = Clients({"pilot": lambda frame: answer(frame.frame)}, there=[])

    def come(_tick: int) -> None:
        clients.there = [PILOT]

    assert len(traced(tmp_path / "t", clients, "lockstep", 50, each=come).applied()) == 5


def test_a_busy_pilot_that_comes_back_without_control_is_in_the_trace(tmp_path: Path) -> None:
    clients = Clients({"pilot": lambda frame: answer(frame.frame, 200 * MS)})

    def demote(tick: int) -> None:
        if tick == 25:
            clients.there = [replace(PILOT, control=False, returned=1)]

    flight = traced(tmp_path / "t", clients, "latency_true", 200, waiting=Waiting(0.01, 0.01, False), each=demote)
    assert flight.applied() != []


@pytest.mark.parametrize("leaves", [False, True])
@pytest.mark.parametrize("mode", ["lockstep", "latency_true"])
def test_a_pilot_that_has_finished_is_landed_once_though_it_flies_on_or_leaves(mode: TimeMode, leaves: bool) -> None:
    clients = Clients({"pilot": lambda f: answer(f.frame, 5 * MS, finished=f.frame >= 2)})
    flight = Flight(clients, mode)

    def leave(tick: int) -> None:
        if leaves and tick == 40:
            clients.there = []

    flight.fly(100, leave)
    assert [desired.land for desired, _ in flight.desired] == [False, False, False, True]


HEAD = {"format": 1, "clients": [{"name": "pilot", "topics": ["truth"], "control": True}], "topics": ["truth"]}
LINE = {"client": "pilot", "frame": 0, "t2_ns": 5, "link_ns": 3, "desired": {"p_W": [0, 0, 2]}, "finished": False}


def lines(*values: object) -> str:
    return "".join((v if isinstance(v, str) else json.dumps(v)) + "\n" for v in values)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("", "companion.jsonl:1: is no trace"),
        ('{"name": "package.json"}\n', ":1: is no trace of companions .without 'format'"),
        ("[1, 2]\n", ":1: is no trace"),
        ("[" * 100_000 + "\n", ":1: is no trace"),
        (lines(HEAD | {"format": 2}), "format 2, not 1"),
        (lines(HEAD | {"topics": "truth"}), ":1: .*topics are 'truth'"),
        (lines(HEAD | {"clients": [{"name": "x"}]}), ":1: .*without 'topics'"),
        (lines(HEAD, "rubbish", LINE), ":2: is no answer"),
        (lines(HEAD, "rubbish"), ":2: is no answer"),
        (lines(HEAD, LINE, [1]), ":3: is no answer"),
        (lines(HEAD, LINE, LINE), ":3: .*a second answer of pilot to frame 0"),
        (lines(HEAD, LINE | {"t2_ns": -1}), ":2: .*t2_ns is -1"),
        (lines(HEAD, LINE | {"t2_ns": 1.5}), ":2: .*t2_ns is 1.5"),
        (lines(HEAD, LINE | {"frame": True}), ":2: .*frame is True"),
        (lines(HEAD, json.dumps(LINE).replace("5", "1e999")), ":2: .*t2_ns is inf"),
        (lines(HEAD, LINE | {"finished": "no"}), ":2: .*finished"),
        (lines(HEAD, json.dumps(LINE | {"desired": {"p_W": [0, 0, float("nan")]}})), ":2: is no answer"),
        (lines(HEAD, LINE | {"desired": 7}), ":2: is no answer"),
        (lines(HEAD, {k: v for k, v in LINE.items() if k != "desired"}), ":2: .*without 'desired'"),
    ],
)
def test_damaged_and_foreign_traces_are_named_with_their_line(text: str, where: str, tmp_path: Path) -> None:
    path = tmp_path / "companion.jsonl"
    path.write_text(text)
    with pytest.raises(RecordingError, match=where):
        TracedAnswers(path)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="nowhere"):
        TracedAnswers(tmp_path / "nowhere")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordingError, match="binary"):
        TracedAnswers(tmp_path / "binary")
    with pytest.raises(RecordingError, match="cannot be written"):
        TraceWriter(tmp_path / "no" / "folder", [], [])


def test_a_trace_that_was_cut_off_serves_up_to_there(tmp_path: Path) -> None:
    path = tmp_path / "companion.jsonl"
    path.write_text((lines(HEAD, LINE, LINE | {"frame": 1}))[:-9])
    flight = Flight(TracedAnswers(path), "lockstep")
    flight.fly(10)
    with pytest.raises(LockstepLost, match="no answer of pilot to frame 1"):
        flight.fly(10)


def test_frames_go_to_the_pilot_last_and_it_is_heard_first() -> None:
    order: list[str] = []

    class Ordered(Clients):
        def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:
            order.append(f"to {client}")
            return super().send(client, frame, dropped)

        def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:
            order.append(f"from {client}")
            return super().wait(client, frame, limit_s)

    cuts: dict[str, Cut] = {name: lambda frame: answer(frame.frame) for name in ("pilot", "watcher")}
    Flight(Ordered(cuts, there=[PILOT, WATCHER]), "latency_true").fly(1)
    assert order == ["to watcher", "to pilot", "from pilot", "from watcher"]


def test_what_clients_say_of_themselves_is_kept_whoever_they_are() -> None:
    def says(name: str) -> Cut:
        return lambda f: replace(
            answer(f.frame, desired=False), report={"n": f.frame, name: True} if f.frame < 2 else None
        )

    clients = Clients({"pilot": says("pilot"), "watcher": says("watcher")}, there=[PILOT, WATCHER])
    flight = Flight(clients, "lockstep")
    flight.fly(31)
    assert flight.reports[0] == ("pilot", {"n": 0, "pilot": True}, 0)
    assert sorted(name for name, _, t_ns in flight.reports if t_ns == FRAME_NS) == ["pilot", "watcher"]
    assert len(flight.reports) == 4  # nothing new, nothing said
    assert flight.stage.all_seats["watcher"].report == {"n": 1, "watcher": True}


def test_a_replay_sees_what_the_run_saw_of_pilots_and_of_lookers_on(tmp_path: Path) -> None:
    """Both see the same in every second frame."""
    path, seen = tmp_path / "companion.jsonl", Detections("imu", 8_000_000, (320, 240))

    def sees(frame: CompanionFrame) -> Answer:
        even = frame.frame % 2 == 0
        report = {"n": frame.frame, "left_m": 0.25} if even else None
        return replace(answer(frame.frame), detections=seen if even else None, report=report)

    trace = TraceWriter(path, [PILOT], ["truth", "imu"])
    live = Flight(Clients({"pilot": sees, "watcher": sees}, there=[PILOT, WATCHER]), "lockstep", trace=trace)
    live.fly(31)
    trace.close()
    assert [client for client, *_ in live.seen] == ["pilot", "watcher"] * 2
    again = Flight(TracedAnswers(path), "lockstep")
    again.fly(31)
    assert again.seen == live.seen
    assert again.reports == [told for told in live.reports if told[0] == "pilot"] != []
    broken = path.read_text().splitlines()
    row = json.loads(broken[2])
    row["detections"]["size_px"] = [-1, 2]
    path.write_text("\n".join([*broken[:2], json.dumps(row), *broken[3:]]) + "\n")
    with pytest.raises(RecordingError, match=r"companion\.jsonl:3"):
        TracedAnswers(path)
