"""Clients' streams in simulated time: repeated when the bench runs faster than real time, and only then."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.router.router import Endpoint, Router
from tests.worlds.router_clients import Clock, UdpClient, address_of, framed, heartbeat, raw, until

TICK_NS = 4_000_000
MS = 1_000_000
SETPOINT, ATTITUDE_TARGET = MSGID["SET_POSITION_TARGET_LOCAL_NED"], MSGID["SET_ATTITUDE_TARGET"]
HEARTBEAT = MSGID["HEARTBEAT"]


def setpoint(encoder: FrameEncoder, x: float = 1.0) -> bytes:
    return raw(encoder, "SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 0xDF8, x, *[0.0] * 10)


class Rig:
    """A router, one client, simulated time and a wall clock `speed` times slower."""

    def __init__(self, speed: float, hold: bool = True) -> None:
        self.clock = Clock()
        self.router = Router([Endpoint(None)], hold=hold, clock_ns=self.clock)
        self.router.open()
        self.router.forward([framed(raw(FrameEncoder(1, 1), "HEARTBEAT", 2, 12, 0, 0, 0, 3))])
        self.client = UdpClient()
        self.speed = speed
        self.t_ns = 0
        self.parser = FrameParser()
        self.came: list[tuple[int, int]] = []  # (message id, simulated time)

    def say(self, data: bytes) -> None:
        """Send as the client; the router receives it in this tick."""
        self.client.say(data, address_of(self.router))
        self._take(until(self.router, lambda got: data in got, self.t_ns))

    def run(self, wall_ms: float) -> None:
        """Run ticks for so long, with the client silent."""
        end_ns = self.clock.ns + round(wall_ms * MS)
        while self.clock.ns < end_ns:
            self.t_ns += TICK_NS
            self.clock.ns += round(TICK_NS / self.speed)
            self._take(self.router.collect(self.t_ns))

    def _take(self, data: bytes) -> None:
        self.came += [(frame.msgid, self.t_ns) for frame in self.parser.feed(data)]

    def times_ms(self, msgid: int) -> list[float]:
        return [t_ns / MS for found, t_ns in self.came if found == msgid]

    def close(self) -> None:
        self.client.close()
        self.router.close()


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    rig = Rig(*request.param)
    yield rig
    rig.close()


def gaps(times: list[float]) -> list[float]:
    return [b - a for a, b in pairwise(times)]


def stream(rig: Rig, count: int, wall_ms: float = 50.0) -> None:
    """Send set-points at 20 Hz and a heartbeat a second, by the wall clock."""
    for i in range(count):
        if i % round(1000 / wall_ms) == 0:
            rig.say(heartbeat(rig.client.encoder))
        rig.say(setpoint(rig.client.encoder, float(i)))
        rig.run(wall_ms)


@pytest.mark.parametrize("rig", [(20.0,)], indirect=True)
def test_streams_keep_their_rate_at_twenty_times_real_time(rig: Rig) -> None:
    stream(rig, 60)
    # From the second on, when the rate is known: 20 Hz of simulated time, and a heartbeat a second.
    setpoints = [t for t in rig.times_ms(SETPOINT) if t > 1100.0]
    assert max(gaps(setpoints)) <= 70.0
    assert 18.0 <= 1000.0 * len(setpoints) / (setpoints[-1] - setpoints[0]) <= 22.0
    beats = rig.times_ms(HEARTBEAT)
    assert max(gaps(beats)) <= 1254.0
    stats = rig.router.stats
    assert stats.repeated_heartbeats == len(beats) - 3
    assert stats.repeated_setpoints == len(rig.times_ms(SETPOINT)) - 60


@pytest.mark.parametrize("rig", [(1.0,), (0.2,), (20.0, False)], indirect=True)
def test_nothing_is_repeated_at_real_time_or_slower_or_unasked(rig: Rig) -> None:
    stream(rig, 30)
    assert rig.router.stats.repeated_setpoints == 0
    assert rig.router.stats.repeated_heartbeats == 0
    assert len(rig.times_ms(SETPOINT)) == 30


@pytest.mark.parametrize("rig", [(20.0,)], indirect=True)
def test_streams_of_a_dead_client_end(rig: Rig) -> None:
    stream(rig, 10)
    died_ms = rig.t_ns / MS
    rig.run(5000)
    assert died_ms < rig.times_ms(SETPOINT)[-1] <= died_ms + 20 * 1000 + 100
    assert died_ms + 20 * 1000 < rig.times_ms(HEARTBEAT)[-1] <= died_ms + 20 * 2000


@pytest.mark.parametrize("rig", [(20.0,)], indirect=True)
def test_a_stream_that_ends_is_not_continued_by_heartbeats(rig: Rig) -> None:
    stream(rig, 10)
    ended_ms = rig.t_ns / MS
    for _ in range(4):
        rig.run(1000)
        rig.say(heartbeat(rig.client.encoder))
    assert rig.times_ms(SETPOINT)[-1] <= ended_ms + 20 * 1000 + 100
    assert max(gaps(rig.times_ms(HEARTBEAT))) <= 1254.0


@pytest.mark.parametrize("rig", [(20.0,)], indirect=True)
def test_a_single_setpoint_is_not_repeated(rig: Rig) -> None:
    rig.say(heartbeat(rig.client.encoder))
    rig.say(setpoint(rig.client.encoder))
    rig.run(1500)
    assert len(rig.times_ms(SETPOINT)) == 1


@pytest.mark.parametrize("rig", [(20.0,)], indirect=True)
def test_only_the_newest_kind_of_setpoint_is_repeated(rig: Rig) -> None:
    stream(rig, 5)
    switched_ms = rig.t_ns / MS
    for _ in range(5):
        rig.say(raw(rig.client.encoder, "SET_ATTITUDE_TARGET", 0, 1, 1, 0, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.5))
        rig.run(50)
    assert max(rig.times_ms(SETPOINT)) <= switched_ms
    assert len(rig.times_ms(ATTITUDE_TARGET)) > 80


@pytest.mark.parametrize("rig", [(20.0,)], indirect=True)
def test_copies_go_to_the_autopilot_only(rig: Rig) -> None:
    other = UdpClient(246, 190)
    other.say(heartbeat(other.encoder), address_of(rig.router))
    until(rig.router, lambda data: data, rig.t_ns)
    stream(rig, 3)
    until(rig.router, lambda _: len(other.hear()) >= 1, rig.t_ns)
    assert [frame.msgid for frame in other.heard] == [HEARTBEAT]
    assert len(rig.times_ms(SETPOINT)) > 30
    other.close()
