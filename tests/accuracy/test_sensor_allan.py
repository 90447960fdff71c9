"""Allan deviation of every inertial axis of every preset against its datasheet line, tau = 0.01 to 1000 s.

Four steps:
  1. closed form of the processes that run (white, walk, seven first-order ones, rounding) against the line;
  2. estimates from drawn noise, each axis, against the line;
  3. tests/unit/sim/sensors/test_sim_sensors_imu.py: that noise is, bit for bit, what `sample` adds.
  4. the one-sided spectrum of drawn noise against the figure that the datasheet prints.
The estimate has scatter. At the bench's rate 1000 s need hours of noise (marked slow); the fast test takes
0.01 to 1 s at 500 Hz and 1 to 1000 s from the same model at 1 Hz, for one preset unless the slow ones are asked for.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sim.scene.scene import load_scene
from sim.sensors.catalog import PRESETS, make_sensor
from sim.sensors.flicker import TIME_CONSTANTS_S, WEIGHTS, flicker_processes
from sim.sensors.sensor import Installation
from tests.worlds.allan_deviation import (
    line,
    markov_variance,
    octaves,
    overlapping_of_sum,
    running_sum,
    spread,
    walk_variance,
    white_variance,
)

TICK_NS = 4_000_000
SCENE = load_scene("airfield")
IMUS = sorted(name for name, preset in PRESETS.items() if preset.kind == "imu")
TOLERANCE = 0.10
LOW_S, HIGH_S = 0.01, 1000.0
AXES = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")


def imu(preset: str, rate_hz: float, seed: int = 1, **overrides: Any) -> Any:
    return make_sensor(
        Installation("imu", rate_hz=rate_hz, seed=seed, scene=SCENE, step_ns=TICK_NS),
        preset=preset,
        overrides=overrides,
    )


def figures(preset: str, axis: int) -> tuple[float, float, float]:
    """Return N, B, K of the axis."""
    p: Any = PRESETS[preset].parameters
    if axis < 3:
        return p.accel_noise_mps2_per_rthz, p.accel_bias_instability_mps2, p.accel_walk_mps3_per_rthz
    return p.gyro_noise_radps_per_rthz, p.gyro_bias_instability_radps, p.gyro_walk_radps2_per_rthz


def closed_form(preset: str, axis: int, rate_hz: float, tau_s: np.ndarray) -> np.ndarray:
    """Return the exact Allan deviation of the sampled sum, with the rounding error as white noise of its variance."""
    made = imu(preset, rate_hz)
    dt = made.period_ns * 1e-9
    m = np.maximum(1.0, np.round(tau_s / dt))
    _, b, k = figures(preset, axis)
    total = white_variance(math.hypot(made.white_sigma[axis], made.step[axis] / math.sqrt(12.0)), m)
    total = total + walk_variance(k * math.sqrt(dt), m)
    for process in flicker_processes(dt):
        total = total + markov_variance(b * process.start, process.phi, m)
    return np.sqrt(total)


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 250.0, 500.0, 1000.0])
@pytest.mark.parametrize("preset", IMUS)
def test_closed_form_of_the_running_processes_follows_the_line(preset: str, rate_hz: float) -> None:
    dt = 1.0 / rate_hz
    tau_s = np.unique(np.round(np.array(octaves(max(LOW_S, dt), HIGH_S, 20)) / dt)) * dt
    for axis in (0, 3):
        ratio = closed_form(preset, axis, rate_hz, tau_s) / line(*figures(preset, axis), tau_s)
        assert np.abs(ratio - 1.0).max() < 0.02, AXES[axis]


def test_flicker_is_flat_within_what_its_module_states() -> None:
    """The minimax fit: 0.7 % of the floor's deviation over the five decades."""
    tau = np.geomspace(LOW_S, HIGH_S, 2000)
    total = np.zeros_like(tau)
    for time_constant_s, weight in zip(TIME_CONSTANTS_S, WEIGHTS, strict=True):
        u = tau / time_constant_s
        total += weight * (2 * u - 3 + 4 * np.exp(-u) - np.exp(-2 * u)) / (u * u)
    deviation = np.sqrt(total / (2 * math.log(2) / math.pi))
    assert np.abs(deviation - 1.0).max() < 0.0072
    assert math.sqrt(sum(WEIGHTS)) == pytest.approx(2.2, abs=0.05)


def worst_deviation(preset: str, noise: np.ndarray, dt: float, low_s: float, high_s: float) -> dict[str, float]:
    """Return the largest relative distance of the estimate to the line, per axis."""
    worst = {}
    for axis, name in enumerate(AXES):
        ratios = []
        total = running_sum(noise[:, axis])
        for tau_s in octaves(low_s, high_s):
            m = max(1, round(tau_s / dt))
            expected = line(*figures(preset, axis), np.array([m * dt]))[0]
            ratios.append(overlapping_of_sum(total, m) / expected - 1.0)
        worst[name] = max(ratios, key=abs)
    return worst


def output(made: Any, count: int) -> np.ndarray:
    """Return the noise as the sensor delivers it, rounded."""
    noise: np.ndarray = made.noise(0, count)[:, :6]
    step = np.array(made.step)
    return np.floor(noise / step + 0.5) * step


@pytest.mark.parametrize("preset", IMUS)
def test_the_one_sided_spectrum_is_the_figure_that_the_datasheet_prints(preset: str) -> None:
    """Above the flicker, up to half the sample rate: 500 Hz, 240 averages of a periodogram, 3 axes."""
    rate_hz, length = 500.0, 1024
    noise = output(imu(preset, rate_hz), 240 * length).reshape(240, length, 6)
    spectrum = 2.0 * np.mean(np.abs(np.fft.rfft(noise - noise.mean(axis=1, keepdims=True), axis=1)) ** 2, axis=0)
    high = slice(length // 20, length // 2)  # 25 Hz and above
    density = np.sqrt(spectrum[high].mean(axis=0) / (rate_hz * length))
    units = {"ug/rtHz": 1e-6 * 9.80665, "mdps/rtHz": math.radians(1e-3), "dps/rtHz": math.radians(1.0)}
    for axis, name in enumerate(AXES):
        key = "accel_noise_mps2_per_rthz" if axis < 3 else "gyro_noise_radps_per_rthz"
        number, unit = PRESETS[preset].figures[key].stated.split()
        assert density[axis] == pytest.approx(float(number) * units[unit], rel=0.02), name


@pytest.mark.parametrize("preset", IMUS)
def test_each_axis_follows_its_datasheet_line_up_to_a_second(preset: str) -> None:
    short = worst_deviation(preset, output(imu(preset, 500.0), 250_000), 0.002, LOW_S, 1.0)
    assert all(abs(short[name]) < TOLERANCE for name in AXES), short


@pytest.mark.parametrize("preset", [IMUS[0], *(pytest.param(name, marks=pytest.mark.slow) for name in IMUS[1:])])
def test_each_axis_follows_its_datasheet_line_from_a_second(preset: str) -> None:
    # Scatter of the estimate at the longest tau: 2.4 % (3.8 % at a second). The seed is fixed.
    long = worst_deviation(preset, output(imu(preset, 1.0), 1_200_000), 1.0, 1.0, HIGH_S)
    assert all(abs(long[name]) < TOLERANCE for name in AXES), long


@pytest.mark.slow
@pytest.mark.parametrize("preset", IMUS)
def test_each_axis_at_the_rate_of_the_bench(preset: str) -> None:
    """Averaged over seeds (in variance), all of tau from the same noise at 250 Hz: 12 x 4 h each axis."""
    rate_hz, hours, seeds = 250.0, 4.0, 12
    count = round(hours * 3600 * rate_hz)
    tau = octaves(LOW_S, HIGH_S, 3)
    ms = [max(1, round(t * rate_hz)) for t in tau]
    variance = np.zeros((6, len(ms)))
    for seed in range(seeds):
        noise = output(imu(preset, rate_hz, seed), count)
        for axis in range(6):
            total = running_sum(noise[:, axis])
            variance[axis] += [overlapping_of_sum(total, m) ** 2 for m in ms]
    measured = np.sqrt(variance / seeds)
    for axis, name in enumerate(AXES):
        expected = line(*figures(preset, axis), np.array(ms) / rate_hz)
        worst = np.abs(measured[axis] / expected - 1.0).max()
        assert worst < TOLERANCE + 2 * spread(seeds * count, ms[-1]), name
