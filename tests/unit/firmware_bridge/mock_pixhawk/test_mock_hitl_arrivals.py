"""Samples that arrive late, in bursts or not at all at a board in HITL. Simulated time."""

from __future__ import annotations

import random

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.mock_pixhawk.estimate.sensors import Arrivals
from firmware_bridge.mock_pixhawk.modes import Mode
from tests.worlds.mock_hitl_world import hitl_world, take_off
from tests.worlds.mock_pixhawk_world import messages, texts

BIAS = "High Accelerometer Bias"
HOVER_M = 0.23 + 2.5


def hovering(**settings):
    world = hitl_world(**settings)
    take_off(world)
    world.run(8.0)
    assert world.autopilot.vehicle.mode is Mode.LOITER
    return world


def bench_pauses(world, seconds):
    """Pause the bench with its physics; return the frames of the board meanwhile."""
    return FrameParser().feed(world.autopilot.wait(int(seconds * 1e9)))


@pytest.mark.parametrize(
    ("delay", "warns"),
    [
        (lambda rng: 300, False),
        (lambda rng: rng.randrange(4_000), False),
        (lambda rng: rng.randrange(12_000), False),  # whole bursts, but none late enough
        (lambda rng: 30_000 if rng.random() < 0.0005 else 300, False),
        (lambda rng: 30_000 if rng.random() < 0.026 else 300, True),  # what upset PX4
    ],
    ids=["steady", "jitter", "bursts", "rarely late", "often late"],
)
def test_it_hovers_through_jitter_and_warns_of_harmful_jitter(delay, warns):
    world = hovering()
    rng = random.Random(3)
    world.autopilot.delay_us = lambda tick: delay(rng)
    highest = [0.0, 9.0]

    def watch(world):
        z = world.truth.p_WB[2]
        highest[:] = max(highest[0], z), min(highest[1], z)

    world.each_tick = watch
    said = texts(world.run(10.0))
    assert (BIAS in said) is warns
    assert HOVER_M - 0.2 < highest[1] < highest[0] < HOVER_M + 0.2
    assert set(said) <= {BIAS}


def test_harmful_jitter_on_the_ground_prevents_arming():
    world = hitl_world()
    rng = random.Random(3)
    world.autopilot.delay_us = lambda tick: 40_000 if rng.random() < 0.05 else 300
    assert f"Preflight Fail: {BIAS}" in texts(world.run(8.0))
    world.command(400, 1)
    assert f"Preflight Fail: {BIAS}" in texts(world.run(0.1))
    assert not world.autopilot.vehicle.armed
    world.autopilot.delay_us = lambda tick: 300
    world.run(5.0)
    world.command(400, 1)
    world.run(0.1)
    assert world.autopilot.vehicle.armed


@pytest.mark.parametrize("physics_goes_on", [False, True])
@pytest.mark.parametrize("seconds", [0.3, 1.5])
def test_a_short_stall_is_survived(seconds, physics_goes_on):
    world = hovering()
    if physics_goes_on:
        world.autopilot.cut = True
        world.run(seconds)
        world.autopilot.cut = False
        frames = world.run(0.1)
    else:
        frames = bench_pauses(world, seconds)
        assert len(messages(frames, "HIL_ACTUATOR_CONTROLS")) == pytest.approx(seconds * 200, abs=1)
    assert ("ACCEL #0 failed: TIMEOUT!" in texts(frames)) is (seconds > 0.5 and not physics_goes_on)
    world.run(8.0)
    assert world.autopilot.vehicle.mode is Mode.LOITER
    assert world.truth.p_WB[2] == pytest.approx(HOVER_M, abs=0.2)


def test_a_long_stall_ends_in_a_reported_termination():
    world = hovering()
    frames = bench_pauses(world, 4.0)
    said = texts(frames)
    for text in ("ACCEL #0 failed: TIMEOUT!", "GYRO #0 failed: TIMEOUT!", "Flight termination active"):
        assert said.count(text) == 1
    outputs = messages(frames, "HIL_ACTUATOR_CONTROLS")
    assert len(outputs) == pytest.approx(800, abs=1)  # it does not fall silent
    assert outputs[-1].controls == (0.0,) * 16
    assert outputs[-1].mode == 181
    assert messages(frames, "HEARTBEAT")[-1].system_status == 8
    frames = world.run(3.0)
    assert world.truth.p_WB[2] < 0.5
    world.command(400, 0, 21196)
    world.command(400, 1)
    assert "Arming denied: flight terminated, reboot needed" in texts(world.run(0.1))
    world.command(246, 1)
    world.run(8.0)
    world.command(400, 1)
    world.run(0.1)
    assert world.autopilot.vehicle.armed


@pytest.mark.parametrize(("seconds", "terminated"), [(1.95, False), (2.05, True)])
def test_an_imu_lost_for_two_seconds_terminates_the_flight(seconds, terminated):
    said = texts(bench_pauses(hovering(), seconds))
    assert ("Failsafe activated: IMU timeout" in said) is terminated


def test_commanded_termination_keeps_the_telemetry():
    world = hovering()
    world.command(185, 1)
    frames = world.run(2.0)
    assert "Flight termination active" in texts(frames)
    assert [m.system_status for m in messages(frames, "HEARTBEAT")] == [8, 8]
    assert world.controls == (0.0,) * 16


def test_offboard_without_setpoints_does_not_silence_it():
    world = hitl_world()
    world.run(5.1)
    world.command(176, 1, 6)
    frames = world.run(2.0)
    assert [m.custom_mode for m in messages(frames, "HEARTBEAT")] == [6 << 16, 6 << 16]


def test_lost_sensors_on_the_ground_are_reported_once_and_not_before_they_came():
    world = hitl_world()
    assert texts(bench_pauses(world, 3.0)) == []
    world.run(6.0)
    said = texts(bench_pauses(world, 2.5))
    assert said.count("Preflight Fail: ACCEL #0 failed: TIMEOUT") == 1


def test_arrivals_at_any_steady_pace_are_good():
    for period_us in (1_000, 4_000, 10_000):
        arrivals = Arrivals()
        for k in range(3_000):
            arrivals.note(k * period_us)
        assert not arrivals.bad
        assert arrivals.late_samples == 0


def test_a_pause_is_not_jitter_but_a_queue_is():
    paused, queued = Arrivals(), Arrivals()
    for k in range(3_000):
        t_us = k * 4_000
        paused.note(t_us + 100_000 * (k > 2_000))
        queued.note(max(t_us, 8_080_000 + k) if k > 2_000 else t_us)
        if k == 2_100:
            assert (paused.bad, queued.bad) == (False, True)
    assert not queued.bad


def test_a_late_sample_counts_for_500_samples_and_ten_of_them_are_bad_until_fewer_than_five_are_left() -> None:
    arrivals, t_us = Arrivals(), 0
    arrivals.note(t_us)

    def come(*intervals_us: int) -> None:
        nonlocal t_us
        for interval_us in intervals_us:
            t_us += interval_us
            arrivals.note(t_us)

    come(34_000)
    assert arrivals.late_samples == 1
    come(*[4000] * 499)
    assert arrivals.late_samples == 1
    come(4000)
    assert arrivals.late_samples == 0
    for _ in range(9):
        come(34_000, *[4000] * 19)
    assert (arrivals.late_samples, arrivals.bad) == (9, False)
    come(34_000, *[4000] * 19)
    assert (arrivals.late_samples, arrivals.bad) == (10, True)
    come(*[4000] * 400)  # the first five leave the window
    assert (arrivals.late_samples, arrivals.bad) == (5, True)
    come(*[4000] * 20)
    assert (arrivals.late_samples, arrivals.bad) == (4, False)
