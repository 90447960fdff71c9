"""VIBRATION of the mock: PX4's metrics against closed forms, and in a world whose airframe vibrates."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pytest

from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.mock_pixhawk.estimate.vibration import VibrationMetrics
from signals.samples import Vec3
from tests.worlds.mock_pixhawk_world import World, messages

G = 9.80665


def measured(samples: Iterable[tuple[Vec3, Vec3]]) -> VibrationMetrics:
    metrics = VibrationMetrics()
    for k, (accel, gyro) in enumerate(samples):
        metrics.note(4000 * k, accel, gyro)
    return metrics


@pytest.mark.parametrize("turn_rad", [0.3, 1.0, 2.0, 3.0])
def test_a_sine_has_its_mean_step_after_two_trapezoids(turn_rad: float) -> None:
    """|a_k - a_k-1| of a sine of amplitude A: 2 A sin(x/2) cos(x/2)^2 |sin|, whose mean is 2 / pi of it; x the turn."""
    n = 20_000
    wave = [math.sin(k * turn_rad) for k in range(n)]
    metrics = measured(((1.5 * s, 0.0, -G), (0.0, 0.2 * s, 0.0)) for s in wave)
    step = 2.0 * math.sin(turn_rad / 2) * math.cos(turn_rad / 2) ** 2 * 2.0 / math.pi
    assert metrics.accel_mps2 == pytest.approx(1.5 * step, rel=0.03)
    assert metrics.gyro_radps == pytest.approx(0.2 * step, rel=0.03)
    assert metrics.coning_rad2 == pytest.approx(0.0, abs=1e-15)
    assert metrics.clipped == 0


def test_a_line_at_half_of_the_sample_rate_vanishes() -> None:
    metrics = measured((((-1.0) ** k, 0.0, -G), (0.0, 0.0, 0.0)) for k in range(3000))
    assert metrics.accel_mps2 == pytest.approx(0.0, abs=1e-6)


def test_it_settles_with_a_hundred_samples() -> None:
    """A ramp has the same step at every sample: 1 - 0.99^n of it after n, but for the first two."""
    metrics = measured(((0.0, 0.0, 0.5 * k), (0.0, 0.0, 0.0)) for k in range(103))
    assert metrics.accel_mps2 == pytest.approx(0.5 * (1.0 - 0.99**101), rel=0.02)


def test_a_rate_that_turns_about_an_axis_is_coning() -> None:
    """|w_k-1 x w_k| = w^2 sin x, less by cos(x/2)^4 of the trapezoids."""
    x = 0.5
    metrics = measured(((0.0, 0.0, -G), (math.cos(k * x), math.sin(k * x), 0.0)) for k in range(3000))
    assert metrics.coning_rad2 == pytest.approx(math.sin(x) * math.cos(x / 2) ** 4 * 0.004**2 / 12, rel=1e-6)


def test_samples_at_full_scale_are_counted_by_axis() -> None:
    metrics = measured([((16 * G, -16 * G, 15.9 * G), (0.0, 0.0, 0.0)), ((0.0, 0.0, 15.9995 * G), (0.0, 0.0, 0.0))])
    assert metrics.clipped == 3


@pytest.mark.parametrize("shaken", [False, True])
def test_a_hovering_vehicle_that_vibrates_is_noticed(shaken: bool) -> None:
    """Asked for at 10 Hz in flight: below 0.05 m/s2 from noise alone, above it when it shakes (PX4 SITL: 0.2)."""
    world = World(shaken=shaken)
    world.run(6.0)
    world.command(511, MSGID["VIBRATION"], 100_000)
    world.command(400, 1)
    world.command(22, 0, 0, 0, math.nan, math.nan, math.nan, 492.0)
    frames = world.run(12.0)
    assert world.truth.p_WB[2] > 2.0
    last = messages(frames, "VIBRATION")[-1]
    assert last.clipping_0 == 0
    assert (0.05 < last.vibration_z < 1.0) if shaken else (last.vibration_z < 0.05)
    assert (last.vibration_y > 0.003) == shaken
