"""The trace of a companion's answers: it repeats the flight, and a damaged one is named with its line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from firmware_bridge.companion.frames import CompanionFrame
from hil.run.companion.answers import Answer, Client
from hil.run.companion.pacing import TimeMode, Timeouts
from hil.run.companion.trace import TracedAnswers, TraceWriter
from signals.detections import Detections
from signals.errors import LockstepLost, RecordingError
from tests.worlds.scripted_companion_flight import (
    MS,
    PILOT,
    TIMEOUTS,
    WATCHER,
    Clients,
    Flight,
    answer,
    repeat,
)


def test_the_trace_repeats_the_flight(tmp_path: Path) -> None:
    path = tmp_path / "companion.jsonl"
    times = repeat([5 * MS, 77 * MS, 123_456_789, 0])

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
    timeouts: Timeouts = TIMEOUTS,
    each: Callable[[int], None] = lambda _tick: None,
) -> Flight:
    """Fly, repeat the flight from its trace, compare both, and return the first."""
    trace = TraceWriter(path, clients.clients(0), ["truth", "imu"])
    flight = Flight(clients, mode, timeouts, trace=trace)
    flight.fly(ticks, each)
    trace.close()
    again = Flight(TracedAnswers(path), mode, timeouts)
    again.fly(ticks)
    assert again.desired == flight.desired
    return flight


def test_a_loss_and_a_late_client_are_in_the_trace(tmp_path: Path) -> None:
    clients = Clients({"pilot": lambda f: answer(f.frame) if f.frame != 3 else None})

    def come_back(tick: int) -> None:
        if tick == 75:
            clients.connected.append(Client("pilot", PILOT.topics, True, 1))

    flight = traced(tmp_path / "t", clients, "lockstep", 120, timeouts=Timeouts(0.0, 0.0, False), each=come_back)
    assert [frame for frame, _ in flight.applied()] == [0, 1, 2, 8, 9, 10, 11]


def test_a_pilot_that_comes_before_the_first_frame_is_in_the_trace(tmp_path: Path) -> None:
    clients = Clients({"pilot": lambda frame: answer(frame.frame)}, connected=[])

    def come(_tick: int) -> None:
        clients.connected = [PILOT]

    assert len(traced(tmp_path / "t", clients, "lockstep", 50, each=come).applied()) == 5


def test_a_busy_pilot_that_comes_back_without_control_is_in_the_trace(tmp_path: Path) -> None:
    clients = Clients({"pilot": lambda frame: answer(frame.frame, 200 * MS)})

    def demote(tick: int) -> None:
        if tick == 25:
            clients.connected = [replace(PILOT, control=False, reconnections=1)]

    flight = traced(tmp_path / "t", clients, "latency_true", 200, timeouts=Timeouts(0.01, 0.01, False), each=demote)
    assert flight.applied() != []


HEAD = {"format": 1, "clients": [{"name": "pilot", "topics": ["truth"], "control": True}], "topics": ["truth"]}
LINE = {"client": "pilot", "frame": 0, "t2_ns": 5, "link_ns": 3, "desired": {"p_W": [0, 0, 2]}, "finished": False}


def lines(*values: object) -> str:
    return "".join((v if isinstance(v, str) else json.dumps(v)) + "\n" for v in values)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("", "companion.jsonl:1: not a trace"),
        ('{"name": "package.json"}\n', ":1: not a trace of companions .'format' is missing"),
        ("[1, 2]\n", ":1: not a trace"),
        ("[" * 100_000 + "\n", ":1: not a trace"),
        (lines(HEAD | {"format": 2}), "format 2, not 1"),
        (lines(HEAD | {"topics": "truth"}), ":1: .*topics are 'truth'"),
        (lines(HEAD | {"clients": [{"name": "x"}]}), ":1: .*'topics' is missing"),
        (lines(HEAD, "rubbish", LINE), ":2: invalid line in the trace"),
        (lines(HEAD, "rubbish"), ":2: invalid line in the trace"),
        (lines(HEAD, LINE, [1]), ":3: invalid line in the trace"),
        (lines(HEAD, LINE, LINE), ":3: .*a second answer of pilot to frame 0"),
        (lines(HEAD, LINE | {"t2_ns": -1}), ":2: .*t2_ns is -1"),
        (lines(HEAD, LINE | {"t2_ns": 1.5}), ":2: .*t2_ns is 1.5"),
        (lines(HEAD, LINE | {"frame": True}), ":2: .*frame is True"),
        (lines(HEAD, json.dumps(LINE).replace("5", "1e999")), ":2: .*t2_ns is inf"),
        (lines(HEAD, LINE | {"finished": "no"}), ":2: .*finished"),
        (lines(HEAD, json.dumps(LINE | {"desired": {"p_W": [0, 0, float("nan")]}})), ":2: invalid line in the trace"),
        (lines(HEAD, LINE | {"desired": 7}), ":2: invalid line in the trace"),
        (lines(HEAD, {k: v for k, v in LINE.items() if k != "desired"}), ":2: .*'desired' is missing"),
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


def test_a_truncated_trace_is_usable_up_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "companion.jsonl"
    path.write_text((lines(HEAD, LINE, LINE | {"frame": 1}))[:-9])
    flight = Flight(TracedAnswers(path), "lockstep")
    flight.fly(10)
    with pytest.raises(LockstepLost, match="no answer of pilot to frame 1"):
        flight.fly(10)


def test_a_replay_repeats_the_detections_of_pilots_and_observers(tmp_path: Path) -> None:
    """Both clients detect the same in every second frame."""
    path, seen = tmp_path / "companion.jsonl", Detections("imu", 8_000_000, (320, 240))

    def sees(frame: CompanionFrame) -> Answer:
        even = frame.frame % 2 == 0
        report = {"n": frame.frame, "left_m": 0.25} if even else None
        return replace(answer(frame.frame), detections=seen if even else None, report=report)

    trace = TraceWriter(path, [PILOT], ["truth", "imu"])
    live = Flight(Clients({"pilot": sees, "watcher": sees}, connected=[PILOT, WATCHER]), "lockstep", trace=trace)
    live.fly(31)
    trace.close()
    assert [client for client, *_ in live.seen] == ["pilot", "watcher"] * 2
    again = Flight(TracedAnswers(path), "lockstep")
    again.fly(31)
    assert again.seen == live.seen
    assert again.reports == [report for report in live.reports if report[0] == "pilot"] != []
    broken = path.read_text().splitlines()
    row = json.loads(broken[2])
    row["detections"]["size_px"] = [-1, 2]
    path.write_text("\n".join([*broken[:2], json.dumps(row), *broken[3:]]) + "\n")
    with pytest.raises(RecordingError, match=r"companion\.jsonl:3"):
        TracedAnswers(path)
