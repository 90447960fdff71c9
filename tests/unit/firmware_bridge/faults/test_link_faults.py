"""Declared link faults: each kind, direction and unit; the same seed gives the same hits; no hit changes no byte."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.faults.hit_log import LISTED_PER_FAULT
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.transports.loopback import LoopbackTransport
from signals.errors import LinkClosed, PortNotFound
from tests.worlds.faulty_transport import MS, PIECES, SECOND, Clock, Rig, Wire, frames, numbers

DIRECTIONS = pytest.mark.parametrize("direction", ["to_autopilot", "from_autopilot"])
UNITS = pytest.mark.parametrize("unit", ["message", "byte"])
OPTIONS = {"delay": {"delay_s": 0.05}}
RANDOM_KINDS = ("drop", "delay", "duplicate", "reorder", "corrupt")


# -- every kind, both ways, both units -------------------------------------------------------------------------------


@DIRECTIONS
@UNITS
@pytest.mark.parametrize("kind", RANDOM_KINDS)
def test_what_each_kind_does_and_how_often(kind: str, unit: str, direction: str) -> None:
    rate, sent = 0.1, frames(2000)
    rig = Rig(LinkFault(kind=kind, direction=direction, at_s=0, rate=rate, unit=unit, **OPTIONS.get(kind, {})))
    got = rig.through(sent, direction)
    hits = rig.line.hits()[0]
    whole, parts = b"".join(sent), len(sent) if unit == "message" else len(b"".join(sent))
    expected = rate * parts
    if kind == "reorder":
        expected = parts * rate / (1.0 + rate)  # the unit after a hit cannot be hit
    assert abs(hits - expected) < 5.0 * math.sqrt(parts * rate * (1.0 - rate))
    unit_length = len(whole) / parts
    if kind == "drop":
        assert len(got) == pytest.approx(len(whole) - hits * unit_length, abs=hits)
        assert got != whole
    elif kind == "duplicate":
        assert len(got) == pytest.approx(len(whole) + hits * unit_length, abs=hits)
    elif kind == "delay":
        assert got == whole
    elif kind == "reorder":
        assert sorted(got) == sorted(whole)
        assert got != whole
    else:
        assert len(got) == len(whole)
        assert sum(a != b for a, b in zip(got, whole, strict=True)) == hits
    if unit == "message":
        if kind in ("drop", "corrupt"):
            assert len(numbers(got)) == pytest.approx(len(sent) - hits, abs=2)  # a damaged length may take the next
        if kind == "drop":
            assert numbers(got) == sorted(set(numbers(got)))
        if kind == "duplicate":
            assert sorted(set(numbers(got))) == list(range(len(sent)))
            assert len(numbers(got)) == len(sent) + hits
        if kind == "reorder":
            order = numbers(got)
            assert sum(b < a for a, b in pairwise(order)) == hits
            assert max(abs(place - number) for place, number in enumerate(order)) == 1


@pytest.mark.parametrize("kind", ["drop", "duplicate", "corrupt"])
def test_the_other_direction_is_unchanged(kind: str) -> None:
    sent = frames(50)
    rig = Rig(LinkFault(kind=kind, direction="to_autopilot", at_s=0, rate=1.0))
    assert rig.through(sent, "from_autopilot") == b"".join(sent)
    assert rig.through(sent, "to_autopilot") != b"".join(sent)
    assert rig.line.hits() == {0: 50}


@pytest.mark.parametrize("kind", RANDOM_KINDS)
@UNITS
def test_both_directions_and_rate_one(kind: str, unit: str) -> None:
    rig = Rig(LinkFault(kind=kind, at_s=0, rate=1.0, unit=unit, **OPTIONS.get(kind, {})))
    sent = frames(10)
    one = rig.through(sent, "from_autopilot")
    other = rig.through(sent, "to_autopilot")
    size = 10 if unit == "message" else len(b"".join(sent))
    assert rig.line.hits() == {0: size if kind == "reorder" else 2 * size}  # reorder: each second unit
    if kind in ("drop", "duplicate", "delay", "reorder"):
        assert one == other
    else:
        assert one != other  # each direction has its own draws


@pytest.mark.parametrize("direction", ["to_autopilot", "from_autopilot"])
def test_a_burst_hits_neighbours(direction: str) -> None:
    rig = Rig(LinkFault(kind="drop", direction=direction, at_s=0, rate=0.01, burst=5))
    left = numbers(rig.through(frames(3000), direction))
    gaps = [b - a - 1 for a, b in pairwise(left) if b - a > 1]
    assert gaps
    assert all(gap >= 5 for gap in gaps)
    assert sum(gap == 5 for gap in gaps) > len(gaps) / 2


def test_a_reordered_unit_is_overtaken_by_as_many_as_its_burst_says() -> None:
    rig = Rig(LinkFault(kind="reorder", at_s=0, rate=1.0, burst=3))
    assert numbers(rig.through([b"".join(frames(8))], "from_autopilot")) == [1, 2, 3, 0, 5, 6, 7, 4]


def test_a_unit_that_nothing_overtakes_comes_after_a_while() -> None:
    rig = Rig(LinkFault(kind="reorder", direction="to_autopilot", at_s=0, rate=1.0, delay_s=0.5))
    (frame,) = frames(1)
    rig.line.write(frame)
    assert rig.wire.sent == b""
    assert rig.line.read(0.4) == b""
    assert rig.wire.sent == b""
    rig.line.read(0.2)
    assert rig.wire.sent == frame


def test_only_the_named_messages_are_hit() -> None:
    encoder = FrameEncoder(1, 1)
    ping = encoder.frame(MSGID["PING"], pack(message_class("PING")(1, 2, 3, 4)))
    rig = Rig(LinkFault(kind="drop", at_s=0, rate=1.0, messages=("PING",)))
    sent = frames(3)
    got = rig.through([sent[0], ping, b"noise", sent[1], ping + sent[2]], "from_autopilot")
    assert got == sent[0] + b"noise" + sent[1] + sent[2]
    assert rig.line.hits() == {0: 2}


def test_faults_act_in_the_declared_order() -> None:
    drop_then_double = Rig(LinkFault(kind="drop", at_s=0, rate=0.5), LinkFault(kind="duplicate", at_s=0, rate=1.0))
    order = numbers(drop_then_double.through(frames(200), "from_autopilot"))
    assert order[::2] == order[1::2]
    hits = drop_then_double.line.hits()
    assert hits[0] + hits[1] == 200


def test_a_delay_keeps_the_order_and_is_wall_clock() -> None:
    rig = Rig(LinkFault(kind="delay", at_s=0, rate=1.0, delay_s=0.1, messages=("PING",)))
    ping = FrameEncoder(1, 1).frame(MSGID["PING"], pack(message_class("PING")(1, 2, 3, 4)))
    frame = frames(1)[0]
    rig.wire.inbox = [frame + ping + frame, frame]
    assert rig.line.read(0.05) == frame
    before = rig.clock.wall_ns
    assert rig.line.read(0.05) == b""
    assert rig.line.read(5.0) == ping + frame + frame
    assert rig.clock.wall_ns - before == pytest.approx(0.1 * SECOND, rel=1e-6)
    assert rig.clock.sim_ns == 0


# -- when ------------------------------------------------------------------------------------------------------------


@DIRECTIONS
def test_a_fault_holds_in_its_window_of_simulated_time_only(direction: str) -> None:
    rig = Rig(LinkFault(kind="drop", direction=direction, at_s=1.0, for_s=0.5, rate=1.0))
    left = []
    for k, frame in enumerate(frames(500)):
        rig.clock.sim_ns = k * 4 * MS
        if direction == "to_autopilot":
            rig.line.write(frame)
        else:
            rig.wire.inbox.append(frame)
            left += numbers(rig.line.read(0.01))
    if direction == "to_autopilot":
        left = numbers(rig.wire.sent)
    assert [k for k in range(500) if k not in left] == list(range(250, 375))
    assert rig.line.hits() == {0: 125}
    assert rig.events[0][:2] == (1000 * MS, "fault")
    assert "link fault 0: dropped ATTITUDE" in rig.events[0][2]


@DIRECTIONS
def test_a_stall_holds_everything_and_then_releases_it(direction: str) -> None:
    rig = Rig(LinkFault(kind="stall", direction=direction, at_s=1.0, for_s=0.5))
    sent, got, arrival = frames(500), [], {}
    for k, frame in enumerate(sent):
        rig.clock.sim_ns = k * 4 * MS
        rig.clock.wall_ns += 1000  # a bench much faster than real time
        if direction == "to_autopilot":
            before = len(rig.wire.sent)
            rig.line.write(frame)
            got = numbers(rig.wire.sent[before:])
        else:
            rig.wire.inbox.append(frame)
            got = numbers(rig.line.read(0.0) + rig.line.read(0.0))
        arrival |= dict.fromkeys(got, k)
    assert list(arrival) == list(range(500))  # all, in order
    assert {k: at for k, at in arrival.items() if at != k} == dict.fromkeys(range(250, 375), 375)
    assert rig.line.hits() == {0: 125}


def test_a_stall_ends_by_wall_clock_where_simulated_time_stands_still() -> None:
    rig = Rig(LinkFault(kind="stall", at_s=0, for_s=0.5))
    sent = frames(2)
    rig.wire.inbox = [sent[0]]
    assert rig.line.read(0.3) == b""
    assert rig.line.read(0.3) == sent[0]
    rig.wire.inbox = [sent[1]]
    assert rig.line.read(0.3) == sent[1]  # over for good


def test_a_stall_without_an_end_never_ends() -> None:
    rig = Rig(LinkFault(kind="stall", at_s=0))
    rig.wire.inbox = frames(5)
    assert rig.line.read(3600.0) == b""
    rig.clock.sim_ns = 80_000 * SECOND
    assert rig.line.read(3600.0) == b""


# -- unplugged -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("clock", ["sim_ns", "wall_ns"])
def test_unplug_and_plug_in_again(clock: str) -> None:
    rig = Rig(LinkFault(kind="unplug", at_s=1.0, for_s=2.0))
    (frame,) = frames(1)
    rig.line.write(frame)
    rig.clock.sim_ns = SECOND
    with pytest.raises(LinkClosed, match="unplugged by the declared link fault 0"):
        rig.line.read(0.1)
    assert not rig.wire.is_open
    with pytest.raises(LinkClosed):
        rig.line.write(frame)
    rig.line.close()
    with pytest.raises(PortNotFound, match="unplugged"):
        rig.line.open()
    setattr(rig.clock, clock, getattr(rig.clock, clock) + 2 * SECOND)
    with pytest.raises(LinkClosed):  # plugged in again, but not opened
        rig.line.write(frame)
    rig.line.open()
    rig.line.write(frame)
    assert rig.wire.sent == 2 * frame
    assert rig.wire.opened == 2
    assert rig.line.hits() == {0: 1}
    assert [text for _, _, text in rig.events] == ["link fault 0: unplugged", "link fault 0: plugged in again"]


def test_unplugged_from_the_start_and_for_ever() -> None:
    clock = Clock()
    wire = Wire(clock)
    line = FaultyTransport(wire, [LinkFault(kind="unplug", at_s=0)], 1, lambda: 0, wall_ns=lambda: clock.wall_ns)
    for _ in range(3):
        with pytest.raises(PortNotFound):
            line.open()
        clock.pass_s(1e6)
    assert wire.opened == 0
    assert line.hits() == {0: 1}


def test_bytes_sent_before_a_hang_up_are_read_first() -> None:
    rig = Rig(LinkFault(kind="delay", at_s=0, rate=1.0, delay_s=0.1))
    sent = frames(2)
    rig.wire.inbox = [sent[0] + sent[1] + sent[0][:9]]
    rig.wire.hung_up = True
    got = b""
    while len(got) < 2 * len(sent[0]) + 9:
        got += rig.line.read(0.05)
    with pytest.raises(LinkClosed, match="hung up"):
        rig.line.read(0.05)
    assert got == sent[0] + sent[1] + sent[0][:9]


# -- the same again --------------------------------------------------------------------------------------------------


def passed(seed: int, cuts: Sequence[int], *faults: LinkFault) -> bytes:
    whole = b"".join(frames(400)) + b"noise" + b"".join(frames(100))
    edges = sorted({0, len(whole), *(cut % len(whole) for cut in cuts)})
    return Rig(*faults, seed=seed).through([whole[a:b] for a, b in pairwise(edges)], "from_autopilot")


@cache
def passed_whole(seed: int, fault: LinkFault) -> bytes:
    return passed(seed, [], fault)


@pytest.mark.parametrize("kind", ["drop", "duplicate", "corrupt", "reorder"])
@UNITS
@settings(max_examples=15)
@given(cuts=st.lists(st.integers(0, 1 << 30), max_size=200))
def test_the_same_seed_gives_the_same_bytes_however_they_are_cut(kind: str, unit: str, cuts: list[int]) -> None:
    fault = LinkFault(kind=kind, at_s=0, rate=0.05, unit=unit)
    assert passed(7, cuts, fault) == passed_whole(7, fault)


def test_seeds_faults_and_directions_have_draws_of_their_own() -> None:
    fault = LinkFault(kind="drop", at_s=0, rate=0.2)
    assert passed(1, [], fault) != passed(2, [], fault)
    other = LinkFault(kind="drop", at_s=9, rate=0.2)
    assert passed(1, [], fault) != passed(1, [], other, fault)
    rig = Rig(fault)
    assert numbers(rig.through(frames(300), "to_autopilot")) != numbers(rig.through(frames(300), "from_autopilot"))


def test_the_hits_are_the_same_on_every_machine() -> None:
    left = numbers(Rig(LinkFault(kind="drop", at_s=0, rate=0.1), seed=1).through(frames(60), "from_autopilot"))
    assert [k for k in range(60) if k not in left] == [5, 18, 24, 29, 33, 39, 58]


# -- without a hit, nothing happens ----------------------------------------------------------------------------------


@DIRECTIONS
@UNITS
@pytest.mark.parametrize("kind", [*RANDOM_KINDS, "stall"])
@settings(max_examples=40)
@given(pieces=PIECES)
def test_a_fault_that_never_hits_changes_no_byte(kind: str, unit: str, direction: str, pieces: list[bytes]) -> None:
    if kind == "stall":
        fault = LinkFault(kind="stall", at_s=100.0)
    else:
        fault = LinkFault(kind=kind, at_s=0, rate=0.0, unit=unit, **OPTIONS.get(kind, {}))
    rig = Rig(fault)
    pieces = [piece for piece in pieces if piece]
    assert rig.through(pieces, direction) == b"".join(pieces)
    assert rig.line.hits() == {0: 0}
    assert rig.events == []


# -- counts and events -----------------------------------------------------------------------------------------------


def test_counts_are_exact_and_events_are_bounded() -> None:
    rig = Rig(LinkFault(kind="drop", at_s=0, rate=1.0))
    many = LISTED_PER_FAULT + 234
    rig.through([b"".join(frames(200))] * 6 + frames(many - 1200), "from_autopilot")
    assert rig.line.hits() == {0: many}
    assert len(rig.events) == LISTED_PER_FAULT
    assert rig.events[-1][2].endswith("further hits are counted, not listed")
    rig.line.close()
    rig.line.close()
    assert [text for _, _, text in rig.events[LISTED_PER_FAULT:]] == [
        f"link fault 0: dropped 234 more units ({many} in all)"
    ]


def test_in_memory_reads_wait_only_for_held_back_units() -> None:
    class Echo:
        def boot(self) -> bytes:
            return b"hello"

        def feed(self, data: bytes) -> bytes:
            return data

    clock = Clock()
    line = FaultyTransport(
        LoopbackTransport(Echo()),
        [LinkFault(kind="delay", at_s=0, rate=1.0, delay_s=0.1)],
        1,
        lambda: 0,
        wall_ns=lambda: clock.wall_ns,
        sleep=clock.pass_s,
    )
    line.open()
    assert line.read(0.0) == b""
    assert line.fileno() is not None  # a unit is still held back
    assert line.read(1.0) == b"hello"
    assert line.fileno() is None
    assert line.read(1.0) == b""
    assert clock.wall_ns == pytest.approx(50.1 * SECOND, rel=1e-9)
    line.write(frames(1)[0])
    assert line.read(1.0) == frames(1)[0]
    assert clock.wall_ns == pytest.approx(50.3 * SECOND, rel=1e-9)
    line.close()


# -- put in later ----------------------------------------------------------------------------------------------------


def test_a_fault_added_later_acts_as_declared_from_then_on() -> None:
    fault = LinkFault(kind="drop", at_s=1.0, rate=0.5, direction="to_autopilot")
    declared, later = Rig(fault), Rig()
    for rig in (declared, later):
        assert rig.through(frames(20), "to_autopilot") == b"".join(frames(20))
        rig.clock.sim_ns = SECOND
        if rig is later:
            rig.line.inject(fault)
        rig.wire.sent = b""
    assert declared.through(frames(200), "to_autopilot") == later.through(frames(200), "to_autopilot")
    assert later.line.hits() == declared.line.hits()
    assert 60 < later.line.hits()[0] < 140
    assert later.line.faults == [fault]
