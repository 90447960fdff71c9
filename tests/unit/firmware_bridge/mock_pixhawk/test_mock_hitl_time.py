"""The board's clock and its timestamps. Simulated time."""

from __future__ import annotations

import random

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.mock_pixhawk.hitl import BoardClock
from tests.worlds.mock_hitl_world import SimulatedTime, hitl_world, lone_board, take_off
from tests.worlds.mock_pixhawk_world import messages, texts


@pytest.mark.parametrize("drift_ppm", [0.0, 37.5, -200.0, 5000.0])
def test_the_clock_counts_from_power_on_with_offset_and_drift(drift_ppm):
    time = SimulatedTime()
    time.now_ns = 55_000
    clock = BoardClock(time, offset_us=7_000, drift_ppm=drift_ppm)
    assert clock.now_us() == 7_000
    time.now_ns += 100_000_000_000
    assert clock.now_us() == 7_000 + round(100e6 * (1.0 + drift_ppm * 1e-6))
    clock.restart()
    assert clock.now_us() == 7_000


@pytest.mark.parametrize("drift_ppm", [0.0, 37.5, -200.0, 5000.0, 123.456])
def test_source_ns_is_the_first_instant_at_which_the_board_reads_that_time(drift_ppm):
    time = SimulatedTime()
    time.now_ns = 123
    clock = BoardClock(time, offset_us=11, drift_ppm=drift_ppm)
    rng = random.Random(1)
    for _ in range(300):
        t_us = 11 + rng.randrange(10**10)
        time.now_ns = clock.source_ns(t_us)
        assert t_us <= clock.now_us() <= t_us + 1
        assert clock.until_s(t_us) == 0.0
        time.now_ns -= 2_000
        assert clock.now_us() < t_us


def timesync(board, frame_ns):
    ask = message_class("TIMESYNC")(0, frame_ns)
    data = FrameEncoder(255, 190).frame(ask.MSGID, pack(ask))
    (answer,) = [
        m for m in map(unpack, FrameParser().feed(board.feed(data))) if type(m).__name__ == "TIMESYNC" and m.tc1
    ]
    return answer


def test_timesync_answers_with_the_boards_clock():
    board, time = lone_board()
    board.clock.offset_us = 2_000_000
    time.now_ns = 3_000_000_000
    assert timesync(board, 987_654_321) == (5_000_000_000, 987_654_321)


def test_timesync_shows_the_drift():
    world = hitl_world(drift_ppm=100.0, offset_us=1_000_000)
    board_link = world.autopilot
    world.run(1.0)
    first, at_ns = timesync(board_link.board, 1).tc1, board_link.time.now_ns
    world.run(10.0)
    gained_ns = timesync(board_link.board, 2).tc1 - first - (board_link.time.now_ns - at_ns)
    assert gained_ns == pytest.approx(10e9 * 100e-6, abs=3_000)


def test_time_usec_and_id_of_the_bench_are_ignored():
    def outputs(mangle):
        world = hitl_world()
        feed = world.autopilot.feed
        encoder = FrameEncoder(255, 200)

        def mangled(data):
            frames = FrameParser().feed(data)
            return feed(b"".join(encoder.frame(f.msgid, mangle(f.msgid, f.payload)) for f in frames))

        world.autopilot.feed = mangled
        return b"".join(frame.raw for _ in range(2000) for frame in world.step()), world.autopilot.steps

    def nonsense(msgid, payload):
        if msgid in (MSGID["HIL_SENSOR"], MSGID["HIL_GPS"]):
            payload = b"\xff" * 8 + payload[8:]
        return payload[:-1] + b"\x07" if msgid == MSGID["HIL_SENSOR"] else payload

    plain, steps = outputs(lambda msgid, payload: payload)
    assert steps == 2000
    assert outputs(nonsense) == (plain, steps)


def test_a_second_imu_corrupts_the_first():
    world = hitl_world()
    world.run(8.0)
    feed = world.autopilot.feed
    encoder = FrameEncoder(255, 200)

    def doubled(data):
        frames = [f for f in FrameParser().feed(data) if f.msgid == MSGID["HIL_SENSOR"]]
        tilted = [unpack(f)._replace(id=1, xacc=4.0, zacc=-8.0) for f in frames]
        return feed(b"".join(encoder.frame(m.MSGID, pack(m)) for m in tilted) + data)

    world.autopilot.feed = doubled
    before = world.autopilot.firmware.estimate.euler[1]
    world.run(4.0)
    estimate = world.autopilot.firmware.estimate
    estimate.refresh(-2)  # a time not used so far, so that the state is copied again
    assert abs(estimate.euler[1] - before) > 0.02 or not estimate.attitude_ok


def test_hil_state_quaternion_spoils_the_estimate():
    world = hitl_world()
    take_off(world)
    world.run(5.0)
    assert world.autopilot.timing.state_quaternions == 0
    numbers = dict.fromkeys(message_class("HIL_STATE_QUATERNION")._fields, 0)
    world.send("HIL_STATE_QUATERNION", **numbers | {"attitude_quaternion": (1.0, 0.0, 0.0, 0.0), "zacc": -1000})
    frames = world.run(2.0)
    assert world.autopilot.timing.state_quaternions == 1
    assert messages(frames, "ESTIMATOR_STATUS")[-1].flags == 0
    assert "Failsafe activated: no valid position, descending" in texts(frames)


def test_the_same_arrivals_give_the_same_bytes():
    def flight():
        rng = random.Random(5)
        world = hitl_world(drift_ppm=20.0)
        world.autopilot.delay_us = lambda tick: rng.randrange(8_000)
        take_off(world)
        return b"".join(frame.raw for _ in range(1000) for frame in world.step())

    assert flight() == flight()
