"""The companion's stage against an event simulation of 'the latest frame wins', with scripted clients."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.companion.frames import CompanionFrame
from hil.run.companion.answers import Answer, Client
from hil.run.companion.pacing import TimeMode, Timeouts
from signals.desired import DesiredState
from signals.errors import LinkClosed
from tests.worlds.scripted_companion_flight import (
    FRAME_NS,
    MS,
    PILOT,
    TICK_NS,
    WATCHER,
    Clients,
    Cut,
    Flight,
    answer,
    repeat,
)


def latest_frame_wins(t2_ns: Iterator[int], delay_ns: int, until_ns: int) -> list[tuple[int, int]]:
    """Return (frame, time from which its answer applies) of one client in an event simulation without ticks.

    There are two kinds of events: a frame appears at k * FRAME_NS, and the client is done. At equal times the frame is
    first.
    """
    done = []
    newest: int | None = None
    free_ns = 0
    for frame in range(until_ns // FRAME_NS + 1):
        now_ns = frame * FRAME_NS
        while newest is not None and free_ns < now_ns:  # done before this frame appeared: it takes the one before
            begun_ns, taken, newest = max(free_ns, newest * FRAME_NS), newest, None
            free_ns = begun_ns + next(t2_ns) + delay_ns
            done.append((taken, free_ns))
        newest = frame
        if free_ns <= now_ns:
            free_ns = now_ns + next(t2_ns) + delay_ns
            done.append((newest, free_ns))
            newest = None
    if newest is not None and free_ns <= until_ns:
        done.append((newest, free_ns + next(t2_ns) + delay_ns))
    return done


def latency_true(
    t2_ns: Sequence[int], delay_ns: int = 0, ticks: int = 300, *, measured: bool = False
) -> tuple[Flight, list[tuple[int, int]]]:
    """Return a flight with a client that takes these times in turn, and the expected answers.

    The delay of the link is configured, or measured.
    """
    times = repeat(t2_ns)
    measured_ns = delay_ns if measured else 987_654_321
    clients = Clients({"pilot": lambda f: replace(answer(f.frame, next(times)), link_ns=measured_ns)})
    flight = Flight(clients, "latency_true", link_delay_ns=None if measured else delay_ns)
    flight.fly(ticks)
    return flight, latest_frame_wins(repeat(t2_ns), delay_ns, (ticks - 1) * TICK_NS)


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
    session = flight.stage.sessions["pilot"]
    assert session.sent + session.dropped + (session.pending is not None) == flight.stage.frames
    dropped = flight.clients.dropped["pilot"]
    numbers = [frame.frame for frame in flight.clients.frames["pilot"]]
    assert [b - a - 1 for a, b in zip([-1, *numbers], numbers, strict=False)] == dropped


@given(st.lists(st.integers(0, 210 * MS), min_size=1), st.sampled_from(["lockstep", "realtime", "latency_true"]))
def test_no_imu_sample_is_lost_or_comes_twice(t2_ns: list[int], mode: TimeMode) -> None:
    times = repeat(t2_ns)
    clients = Clients({"pilot": lambda frame: answer(frame.frame, next(times))})
    flight = Flight(clients, mode, Timeouts(100.0, 100.0, True))
    busy_ns = 0

    def live(tick: int) -> None:
        nonlocal busy_ns
        if (
            mode == "realtime"
            and flight.stage.sessions["pilot"].awaited_frame is not None
            and tick * TICK_NS >= busy_ns
        ):
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
    assert flight.stage.sessions["pilot"].dropped == 0


def test_realtime_drops_frames_and_applies_in_the_tick_of_the_answer() -> None:
    clients = Clients({})
    flight = Flight(clients, "realtime", Timeouts(100.0, 100.0, True))

    def live(tick: int) -> None:
        if tick in (13, 33):  # 52 and 132 ms
            clients.ready.append(("pilot", answer(clients.frames["pilot"][-1].frame)))
        if tick == 20:
            clients.ready += [("pilot", answer(0)), ("unknown", answer(1))]  # to an old frame, and of an unknown client

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
            clients.connected.append(WATCHER)
        if tick == 60:
            clients.connected.remove(WATCHER)

    flight.fly(200, come_and_go)
    assert flight.desired == alone.desired
    watched = clients.frames["watcher"]
    assert [frame.frame for frame in watched] == [3, 4, 5, 9, 10, 11, 12]
    assert watched[3].samples[0].values["seq"] == list(range(81, 91))  # none from its absence
    assert clients.lost == [("watcher", "no answer to frame 12 within 0.01 s")]
    assert ("companion_lost", "watcher: no answer to frame 12 within 0.01 s") in flight.events
    assert flight.stage.all_sessions["watcher"].sent == 7
    assert flight.stage.losses == {"watcher": (480 * MS, "no answer to frame 12 within 0.01 s")}


@pytest.mark.parametrize("mode", ["lockstep", "latency_true", "realtime"])
def test_a_lost_client_is_missed_until_it_answers_again(mode: TimeMode) -> None:
    clients = Clients({"watcher": lambda f: answer(f.frame)})
    clients.connected[:] = [WATCHER]
    flight = Flight(clients, mode)

    def come_and_go(tick: int) -> None:
        if mode == "realtime" and clients.frames.get("watcher") and clients.connected:
            clients.ready.append(("watcher", answer(clients.frames["watcher"][-1].frame)))
        if tick == 30:
            clients.connected.clear()
        if tick == 60:
            assert flight.stage.losses == {"watcher": (120 * MS, "its connection ended")}
            clients.connected.append(WATCHER)

    flight.fly(100, come_and_go)
    assert flight.stage.losses == {}


@pytest.mark.parametrize("mode", ["lockstep", "latency_true"])
def test_loss_of_the_pilot_is_an_error_with_its_reason(mode: TimeMode) -> None:
    clients = Clients({"pilot": lambda f: answer(f.frame) if f.frame < 3 else None})
    with pytest.raises(LinkClosed, match=r"companion pilot: no answer to frame 3 .*did not come back") as caught:
        Flight(clients, mode).fly(100)
    assert caught.value.cause == "companion"
    clients = Clients({"pilot": lambda f: answer(f.frame)})

    def leave(tick: int) -> None:
        if tick == 25:
            clients.connected.clear()

    with pytest.raises(LinkClosed, match="its connection ended"):
        Flight(clients, mode).fly(100, leave)


def test_the_flight_may_go_on_without_its_pilot() -> None:
    clients = Clients({"pilot": lambda f: answer(f.frame) if f.frame < 3 else None})
    flight = Flight(clients, "lockstep", Timeouts(0.01, 0.01, False))
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

    clients = Clients({"pilot": cut}, reconnects=[True])
    flight = Flight(clients, "lockstep", Timeouts(0.01, 10.0, True))
    flight.fly(61)
    assert [frame for frame, _ in flight.applied()] == list(range(7))
    assert [kind for kind, _ in flight.events] == ["companion_lost", "companion_back"]


def test_a_pilot_that_reconnects_but_never_answers_is_lost() -> None:
    clients = Clients({"pilot": lambda _f: None}, reconnects=[True] * 1_000_000)
    with pytest.raises(LinkClosed):
        Flight(clients, "lockstep", Timeouts(0.0, 0.02, True)).fly(1)


def test_a_pilot_that_comes_back_as_an_observer_is_lost() -> None:
    for mode in ("lockstep", "latency_true", "realtime"):
        clients = Clients({"pilot": lambda f: answer(f.frame)})

        def demote(tick: int, clients: Clients = clients) -> None:
            if tick == 15:
                clients.connected[:] = [Client("pilot", PILOT.topics, False, 1)]

        with pytest.raises(LinkClosed, match="control"):
            Flight(clients, mode, Timeouts(1.0, 0.0, True)).fly(1000, demote)  # type: ignore[arg-type]


def test_a_frame_that_cannot_be_sent_is_named() -> None:
    with pytest.raises(LinkClosed, match="frame 0 cannot be sent"):
        Flight(Clients({}, accepts_frames=False), "lockstep").fly(1)


def test_realtime_forgets_the_awaited_frame_of_an_ended_connection() -> None:
    clients = Clients({})
    flight = Flight(clients, "realtime", Timeouts(100.0, 100.0, True))

    def bounce(tick: int) -> None:
        if tick == 5:
            clients.connected[:] = [Client("pilot", PILOT.topics, True, 1)]

    flight.fly(15, bounce)
    assert [frame.frame for frame in clients.frames["pilot"]] == [0, 1]
    assert [kind for kind, _ in flight.events] == ["companion_lost", "companion_back"]


@pytest.mark.parametrize("on_loss", [True, False])
def test_realtime_pilot_that_never_answers_again(on_loss: bool) -> None:
    clients = Clients({}, reconnects=[])
    flight = Flight(clients, "realtime", Timeouts(0.0, 0.0, on_loss))
    if on_loss:
        with pytest.raises(LinkClosed, match=r"no answer to frame 0|its connection ended"):
            flight.fly(100)
    else:
        flight.fly(100)
        assert flight.stage.sessions == {}


def test_finished_lands_once_from_the_answers_time_on() -> None:
    cut = {"pilot": lambda f: answer(f.frame, 50 * MS, finished=f.frame >= 2, desired=f.frame < 2)}
    flight = Flight(Clients(cut), "latency_true")
    flight.fly(100)
    lands = [(d, from_ns) for d, from_ns in flight.desired if d.land]
    assert lands == [(DesiredState(land=True), 150 * MS)]
    assert flight.stage.finished


@pytest.mark.parametrize("leaves", [False, True])
@pytest.mark.parametrize("mode", ["lockstep", "latency_true"])
def test_a_pilot_that_has_finished_is_landed_once_though_it_flies_on_or_leaves(mode: TimeMode, leaves: bool) -> None:
    clients = Clients({"pilot": lambda f: answer(f.frame, 5 * MS, finished=f.frame >= 2)})
    flight = Flight(clients, mode)

    def leave(tick: int) -> None:
        if leaves and tick == 40:
            clients.connected = []

    flight.fly(100, leave)
    assert [desired.land for desired, _ in flight.desired] == [False, False, False, True]


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
    Flight(Ordered(cuts, connected=[PILOT, WATCHER]), "latency_true").fly(1)
    assert order == ["to watcher", "to pilot", "from pilot", "from watcher"]


def test_reports_of_all_clients_are_kept() -> None:
    def reports(name: str) -> Cut:
        return lambda f: replace(
            answer(f.frame, desired=False), report={"n": f.frame, name: True} if f.frame < 2 else None
        )

    clients = Clients({"pilot": reports("pilot"), "watcher": reports("watcher")}, connected=[PILOT, WATCHER])
    flight = Flight(clients, "lockstep")
    flight.fly(31)
    assert flight.reports[0] == ("pilot", {"n": 0, "pilot": True}, 0)
    assert sorted(name for name, _, t_ns in flight.reports if t_ns == FRAME_NS) == ["pilot", "watcher"]
    assert len(flight.reports) == 4  # an unchanged report is not sent
    assert flight.stage.all_sessions["watcher"].report == {"n": 1, "watcher": True}
