"""VIBRATION of the mock: PX4's metrics against closed forms, and in a world whose airframe vibrates."""

from __future__ import annotations

import math

import pytest

from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.mock_pixhawk.estimate.vibration import VibrationMetrics
from tests.worlds.mock_pixhawk_world import World, messages

G = 9.80665


def test_a_square_wave_has_its_step_as_metric() -> None:
    """|a_k - a_k-1| is 2 a for every sample, so the filter settles at 2 a."""
    metrics = VibrationMetrics()
    for k in range(3000):
        sign = 1.0 if k % 2 else -1.0
        metrics.note((1.5 * sign, 0.0, -G), (0.0, 0.2 * sign, 0.0))
    assert metrics.accel_mps2 == pytest.approx(3.0, rel=1e-9)
    assert metrics.gyro_radps == pytest.approx(0.4, rel=1e-9)
    assert metrics.coning_rad2ps2 == pytest.approx(0.0, abs=1e-12)
    assert metrics.clipped == 0


def test_it_settles_with_a_hundred_samples() -> None:
    metrics = VibrationMetrics()
    for k in range(101):
        metrics.note((0.0, 0.0, 1.0 if k % 2 else -1.0), (0.0, 0.0, 0.0))
    assert metrics.accel_mps2 == pytest.approx(2.0 * (1.0 - 0.99**100), rel=1e-9)


def test_a_rate_that_turns_by_a_right_angle_is_coning() -> None:
    metrics = VibrationMetrics()
    for k in range(3000):
        metrics.note((0.0, 0.0, -G), (math.cos(k * math.pi / 2), math.sin(k * math.pi / 2), 0.0))
    assert metrics.coning_rad2ps2 == pytest.approx(1.0, rel=1e-9)


def test_samples_at_full_scale_are_counted_by_axis() -> None:
    metrics = VibrationMetrics()
    metrics.note((16 * G, -16 * G, 15.9 * G), (0.0, 0.0, 0.0))
    metrics.note((0.0, 0.0, 15.99 * G), (0.0, 0.0, 0.0))
    assert metrics.clipped == 3


@pytest.mark.parametrize("shaken", [False, True])
def test_a_hovering_vehicle_that_vibrates_is_noticed(shaken: bool) -> None:
    """Asked for at 10 Hz in flight: below 0.5 m/s2 from noise alone, between that and 10 when it shakes."""
    world = World(shaken=shaken)
    world.run(6.0)
    world.command(511, MSGID["VIBRATION"], 100_000)
    world.command(400, 1)
    world.command(22, 0, 0, 0, math.nan, math.nan, math.nan, 492.0)
    frames = world.run(12.0)
    assert world.truth.p_WB[2] > 2.0
    last = messages(frames, "VIBRATION")[-1]
    assert last.clipping_0 == 0
    assert (0.5 < last.vibration_z < 10.0) if shaken else (last.vibration_z < 0.5)
    assert (last.vibration_y > 0.01) == shaken
