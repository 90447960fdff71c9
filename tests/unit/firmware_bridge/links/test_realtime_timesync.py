"""Clock alignment against a simulated autopilot whose clock and line are known exactly."""

from __future__ import annotations

import random

import pytest

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack, unpack
from firmware_bridge.links.timesync import TIMESYNC, TimeSync

Timesync = message_class("TIMESYNC")
MS = 1_000_000
S = 1_000_000_000
START = 777 * S


def on_the_wire(payload: bytes) -> Frame:
    (frame,) = FrameParser().feed(FrameEncoder(1, 1).frame(TIMESYNC, payload))
    return frame


class Autopilot:
    """A clock that shows `boot_ns` at our `START` and runs `drift_ppm` fast; with random delays each way."""

    def __init__(self, boot_ns: int, drift_ppm: float = 0.0, jitter_ns: int = 3 * MS) -> None:
        self.boot_ns, self.drift_ppm, self.jitter_ns = boot_ns, drift_ppm, jitter_ns
        self._random = random.Random(4)

    def clock(self, ours_ns: int) -> int:
        return self.boot_ns + round((ours_ns - START) * (1.0 + self.drift_ppm * 1e-6))

    def ask(self, payload: bytes, now_ns: int) -> tuple[Frame, int]:
        """Return its answer and the time of arrival."""
        there = now_ns + 300_000 + round(self._random.expovariate(1 / self.jitter_ns))
        back = there + 300_000 + round(self._random.expovariate(1 / self.jitter_ns))
        question = unpack(on_the_wire(payload))
        assert question.tc1 == 0
        return on_the_wire(pack(Timesync(self.clock(there), question.ts1))), back


def run(sync: TimeSync, autopilot: Autopilot, start_ns: int, seconds: float) -> int:
    now = start_ns
    while now < start_ns + seconds * S:
        payload = sync.request(now)
        if payload is not None:
            frame, heard = autopilot.ask(payload, now)
            assert sync.take(frame, heard) is not None
        now += 4 * MS
    return now


def test_requests_are_sent_at_the_rate_and_not_in_a_burst_after_a_pause() -> None:
    sync = TimeSync(rate_hz=10.0)
    asked = [k for k in range(1000) if sync.request(START + k * MS) is not None]
    assert asked == list(range(0, 1000, 100))
    after_pause = [k for k in range(50_000, 50_300) if sync.request(START + k * MS) is not None]
    assert after_pause == [50_000, 50_100, 50_200]


def test_offset_is_within_half_the_shortest_round_trip() -> None:
    sync, autopilot = TimeSync(), Autopilot(boot_ns=12 * S)
    assert sync.best() is None
    run(sync, autopilot, START, 30.0)
    best = sync.best()
    assert best is not None
    assert best.rtt_ns < 4 * MS, "the mean round trip is 6.6 ms"
    assert abs(best.offset_ns - (autopilot.clock(best.t_ns) - best.t_ns)) < best.rtt_ns / 2
    assert sync.resets == 0
    assert sync.rtt.count == 300


@pytest.mark.parametrize("drift_ppm", [-80.0, 0.0, 40.0])
def test_drift_is_found(drift_ppm: float) -> None:
    sync, autopilot = TimeSync(), Autopilot(5 * S, drift_ppm, jitter_ns=MS)
    assert sync.drift_ppm is None
    run(sync, autopilot, START, 100.0)
    assert sync.drift_ppm == pytest.approx(drift_ppm, abs=6.0)
    assert sync.resets == 0


def test_a_reboot_begins_anew() -> None:
    sync = TimeSync()
    now = run(sync, Autopilot(900 * S), START, 20.0)
    rebooted = Autopilot(-15 * S)  # its clock began 15 s after START
    run(sync, rebooted, now, 5.0)
    assert sync.resets == 1
    assert sync.drift_ppm is None, "what came before says nothing of the new clock"
    best = sync.best()
    assert best is not None
    assert abs(best.offset_ns - (rebooted.clock(best.t_ns) - best.t_ns)) < 5 * MS


@pytest.mark.parametrize("lost_ns", [67 * MS, -40 * MS])
def test_a_clock_that_stands_still_for_a_moment_has_not_rebooted(lost_ns: int) -> None:
    """A simulated autopilot without a processor loses time: eleven such stops were eleven resets and no drift."""
    sync, autopilot = TimeSync(), Autopilot(5 * S, 30.0, jitter_ns=MS)
    now = START
    for _ in range(11):
        now = run(sync, autopilot, now, 7.0)
        autopilot.boot_ns -= lost_ns
    run(sync, autopilot, now, 7.0)
    assert sync.resets == 0
    assert sync.slips == 11
    assert sync.slipped_ns == pytest.approx(-11 * lost_ns, abs=11 * 3 * MS)
    assert sync.drift_ppm == pytest.approx(30.0, abs=60.0)
    best = sync.best()
    assert best is not None
    assert abs(best.offset_ns - (autopilot.clock(best.t_ns) - best.t_ns)) < 4 * MS


@pytest.mark.parametrize(
    ("apart_ns", "rtts_ns", "allowed_ns"),
    [
        (200 * MS, (2 * MS, 10 * MS), 6 * MS + 100_000 + MS),  # half of both round trips, 500 ppm of drift, 1 ms
        (10 * S, (MS, MS), MS + 5 * MS + MS),
    ],
)
def test_a_jump_counts_beyond_its_uncertainty(apart_ns: int, rtts_ns: tuple[int, int], allowed_ns: int) -> None:
    for jump_ns, slips in ((allowed_ns - 50_000, 0), (allowed_ns + 50_000, 1), (-allowed_ns - 50_000, 1)):
        sync = TimeSync()
        for heard_ns, rtt_ns, ahead_ns in zip(
            (START, START + apart_ns), rtts_ns, (5 * S, 5 * S + jump_ns), strict=True
        ):
            asked_ns = heard_ns - rtt_ns
            assert sync.request(asked_ns) is not None
            answer = on_the_wire(pack(Timesync(asked_ns + rtt_ns // 2 + ahead_ns, asked_ns)))
            assert sync.take(answer, heard_ns) is not None
        assert (sync.slips, sync.slipped_ns) == (slips, jump_ns * slips)


def test_only_answers_to_our_own_requests_count_and_only_once() -> None:
    sync = TimeSync()
    payload = sync.request(START)
    assert payload is not None
    others = on_the_wire(pack(Timesync(5 * S, START - 1)))
    assert sync.take(others, START + MS) is None
    reply = on_the_wire(pack(Timesync(5 * S, START)))
    assert sync.take(reply, START + MS) == (START + MS, 5 * S - START - MS // 2, MS)
    assert sync.take(reply, START + 2 * MS) is None
    assert sync.rtt.count == 1
    assert sync.take(on_the_wire(pack(Timesync(0, 4242))), START) is None  # the autopilot's own question
