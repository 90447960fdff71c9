"""Inertial errors one by one against closed forms, and the noise-only path against `sample`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pydantic
import pytest

from signals.noise import NoiseStream
from signals.samples import TruthState
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.sensors.catalog import PRESETS
from tests.worlds.installed_sensor import installed

TICK_NS = 4_000_000
DT = TICK_NS * 1e-9
SCENE = load_scene("airfield")
G = SCENE.gravity_mps2
IMUS = sorted(name for name, preset in PRESETS.items() if preset.kind == "imu")
ZERO = (0.0, 0.0, 0.0)
STILL = TruthState(0, 0, ZERO, (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (0.0,) * 4, False)
IDEAL: dict[str, Any] = {
    "accel_noise_mps2_per_rthz": 0.0,
    "gyro_noise_radps_per_rthz": 0.0,
    "accel_walk_mps3_per_rthz": 0.0,
    "gyro_walk_radps2_per_rthz": 0.0,
    "accel_turn_on_bias_mps2": 0.0,
    "gyro_turn_on_bias_radps": 0.0,
    "accel_range_mps2": 1000.0,
    "gyro_range_radps": 100.0,
    "accel_bits": 32,
    "gyro_bits": 32,
    "temperature_degc": 45.0,
    "temperature_noise_degc": 0.0,
}
WORD = 1e-6  # more than a word of the above


def imu(rate_hz: float = 250.0, *, seed: int = 1, **changes: Any) -> Any:
    return installed("imu", SCENE, kind="imu", overrides=IDEAL | changes, rate_hz=rate_hz, seed=seed)


@pytest.mark.parametrize("preset", IMUS)
def test_the_noise_path_is_what_sample_adds(preset: str) -> None:
    """With gains of 1 and the noise known, every sample at rest is the noise rounded: no second model hides."""
    changes = {
        f"{what}_{error}": 0.0
        for what in ("accel", "gyro")
        for error in (
            "scale_error",
            "misalignment_rad",
            *(["turn_on_bias_mps2"] if what == "accel" else ["turn_on_bias_radps"]),
        )
    }
    made = [installed("i", SCENE, preset=preset, overrides=changes, rate_hz=250.0, seed=4) for _ in range(3)]
    noise = made[0].noise(0, 1000)  # type: ignore[attr-defined]
    warm = STILL._replace(t_ns=10**15)  # the temperature has settled
    force = np.array([0.0, 0.0, G, 0.0, 0.0, 0.0])
    for k in range(1000):
        sample = made[1].sample(warm, k)
        step = np.array(made[1].step)  # type: ignore[attr-defined]
        assert (
            (*sample.accel_mps2, *sample.gyro_radps)
            == tuple(  # type: ignore[union-attr]
                np.floor((force + noise[k, :6]) / step + 0.5) * step
            )
        )
    # In pieces, overlapping and backwards, it is the same noise.
    for first, count in ((700, 300), (0, 10), (10, 990), (5, 1)):
        assert np.array_equal(made[2].noise(first, count), noise[first : first + count])  # type: ignore[attr-defined]


def test_the_gyro_is_the_mean_rate_over_the_tick() -> None:
    """Against the mean (Simpson) of a flight in ticks 40 times shorter, jerked by motors of 12.5 ms."""
    vehicle, finer = load_vehicle("x500"), 40
    start = FlightStart(p_WB=(0.0, 0.0, 300.0))
    flight = VehiclePhysics(vehicle, SCENE, TICK_NS, start=start)
    fine = VehiclePhysics(vehicle, SCENE, TICK_NS // finer, start=start)
    roll, pitch = (np.array([sign * np.sign(r.position_m[i]) for r in vehicle.rotors]) for i, sign in ((1, 1), (0, -1)))
    weights = np.array([1.0, *[4.0, 2.0] * (finer // 2 - 1), 4.0, 1.0]) / (3.0 * finer)
    gyro, hover = imu(), multirotor.hover_control(vehicle)
    truth, rate = flight.advance(0, (hover,) * 4), fine.advance(0, (hover,) * 4).w_WB_B
    gyro.sample(truth, 0)
    errors, of_the_ends = [], []
    for tick in range(1, 400):
        wanted = 3.0 if tick // 10 % 4 in (0, 3) else -3.0  # followed by a proportional controller of the rate
        p, q, _ = truth.w_WB_B
        controls = tuple((hover + 0.06 * (roll * (wanted - p) + pitch * (0.5 * wanted - q))).clip(0.0, 1.0).tolist())
        truth = flight.advance(tick, controls)
        rates = [rate]
        for sub in range((tick - 1) * finer + 1, tick * finer + 1):
            rates.append(fine.advance(sub, controls).w_WB_B)
        rate = rates[-1]
        mean = weights @ np.array(rates)
        errors.append(np.array(gyro.sample(truth, tick).gyro_radps) - mean)
        of_the_ends.append(np.array(truth.w_WB_B) - 0.5 * DT * np.array(truth.alpha_WB_B) - mean)
    assert np.sqrt(np.mean(np.square(of_the_ends))) > 1e-3  # what the mean of the end rates would be off by
    assert np.abs(errors).max() < 1e-5


def test_the_gyro_after_a_gap_is_the_mean_of_the_end_rates() -> None:
    turning = STILL._replace(w_WB_B=(1.0, 0.0, 0.0), alpha_WB_B=(10.0, 0.0, 0.0))
    made = imu()
    for k, t_ns in enumerate((0, 2 * TICK_NS, 7 * TICK_NS)):
        assert made.sample(turning._replace(t_ns=t_ns), k).gyro_radps[0] == pytest.approx(1.0 - 5.0 * DT, abs=WORD)


def test_lever_arm_against_a_point_moved_by_hand() -> None:
    """Any w, alpha and r against numpy's cross products."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        w, alpha, r = rng.normal(size=3), rng.normal(size=3), rng.uniform(-1, 1, size=3)
        truth = STILL._replace(w_WB_B=tuple(w), alpha_WB_B=tuple(alpha))
        at_origin = np.array(imu().sample(truth, 0).accel_mps2)
        moved = np.array(imu(lever_arm_m=tuple(r)).sample(truth, 0).accel_mps2)
        mean_w = w - 0.5 * DT * alpha
        expected = np.cross(alpha, r) + np.cross(mean_w, np.cross(mean_w, r))
        assert moved - at_origin == pytest.approx(expected, abs=2 * WORD)


HARMONICS = [
    {"order": 1.0, "accel_mps2": (2.0, 3.0, 0.0), "gyro_radps": (0.0, 0.1, 0.0)},
    {"order": 2.0, "accel_mps2": (0.0, 0.0, 4.0), "gyro_radps": (0.0, 0.0, 0.0)},
]


def test_vibration_is_the_step_mean_of_the_harmonics() -> None:
    """One rotor at a steady speed: a tone at the speed's multiple, folded by the sampling, with the boxcar's sinc."""
    reference, speed = 800.0, 600.0
    made = imu(vibration=HARMONICS, vibration_reference_radps=reference)
    n = 2000
    rows = []
    for k in range(n):
        truth = STILL._replace(t_ns=k * TICK_NS, rotor_speed_radps=(speed, 0.0, 0.0, 0.0))
        sample = made.sample(truth, k)
        rows.append((*sample.accel_mps2, *sample.gyro_radps))
    values = np.array(rows)
    t = np.arange(n) * DT
    for axis, order, amplitude in ((0, 1, 2.0), (1, 1, 3.0), (2, 2, 4.0), (4, 1, 0.1)):
        x = order * speed * DT / 2.0
        expected = amplitude * (speed / reference) ** 2 * abs(math.sin(x) / x)
        basis = np.column_stack([np.cos(order * speed * t), np.sin(order * speed * t), np.ones(n)])
        fit, *_ = np.linalg.lstsq(basis, values[:, axis], rcond=None)
        assert math.hypot(fit[0], fit[1]) == pytest.approx(expected, rel=1e-6)
        assert np.abs(values[:, axis] - basis @ fit).max() < 1e-5 * amplitude


def test_vibration_stops_with_the_rotors_and_grows_with_the_square_of_speed() -> None:
    made = imu(vibration=HARMONICS)
    assert made.sample(STILL, 0).accel_mps2 == pytest.approx((0.0, 0.0, G), abs=WORD)
    assert made.sample(STILL._replace(rotor_speed_radps=()), 1).accel_mps2 == pytest.approx((0, 0, G), abs=WORD)


def test_temperature_warms_up_and_takes_the_bias_along() -> None:
    changes = {
        "warm_up_degc": 20.0,
        "warm_up_time_constant_s": 50.0,
        "accel_temperature_drift_mps2_per_degc": 0.01,
        "gyro_temperature_drift_radps_per_degc": 0.001,
    }
    made = imu(**changes)
    gains = NoiseStream(1, "imu.temperature", lanes=6).normal(0)
    for seconds in (0, 50, 100, 5000):
        sample = made.sample(STILL._replace(t_ns=seconds * 10**9), 0)
        away = -20.0 * math.exp(-seconds / 50.0)
        assert sample.temperature_degc == pytest.approx(45.0 + away, abs=1e-9)
        assert sample.accel_mps2[0] == pytest.approx(0.01 * gains[0] * away, abs=WORD)
        assert sample.gyro_radps[2] == pytest.approx(0.001 * gains[5] * away, abs=WORD)
    cold = imu(**changes, reference_temperature_degc=25.0).sample(STILL, 0)
    assert cold.accel_mps2 == pytest.approx((0.0, 0.0, G), abs=WORD)  # calibrated cold: no bias at the cold start


def test_scale_and_misalignment_have_the_stated_spread() -> None:
    truth = STILL._replace(w_WB_B=(2.0, 0.0, 0.0))
    scale, cross = [], []
    for seed in range(400):
        x, y, z = imu(seed=seed, gyro_scale_error=0.01, gyro_misalignment_rad=0.002).sample(truth, 0).gyro_radps
        scale.append(x / 2.0 - 1.0)
        cross += [y / 2.0, z / 2.0]
    assert np.std(scale) == pytest.approx(0.01, rel=0.12)
    assert np.std(cross) == pytest.approx(0.002, rel=0.1)
    assert abs(np.mean(scale)) < 0.002


def test_turn_on_bias_has_the_stated_spread_and_stays() -> None:
    values = [imu(seed=s, accel_turn_on_bias_mps2=0.1).sample(STILL, 0).accel_mps2[0] for s in range(400)]
    assert np.std(values) == pytest.approx(0.1, rel=0.12)
    made = imu(accel_turn_on_bias_mps2=0.1)
    assert made.sample(STILL, 0).accel_mps2 == made.sample(STILL, 500).accel_mps2


def test_the_mean_of_readings_comes_in_fractions_of_a_word() -> None:
    coarse = {"gyro_bits": 12, "gyro_range_radps": 40.0}
    word = 80.0 / 4096
    truth = STILL._replace(w_WB_B=(0.123456, -0.654321, 0.0))
    for rate_hz, readings in ((0.0, 1), (250.0, 1), (2000.0, 8), (8000.0, 32)):
        for value in imu(**coarse, gyro_output_rate_hz=rate_hz).sample(truth, 0).gyro_radps:
            steps = value / (word / readings)
            assert steps == pytest.approx(round(steps), abs=1e-6)
    fast = truth._replace(w_WB_B=(99.0, -99.0, 0.0))
    assert imu(**coarse, gyro_output_rate_hz=8000.0).sample(fast, 0).gyro_radps[:2] == (40.0 - word, -40.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"accel_noise_mps2_per_rthz": -1e-3},
        {"gyro_bias_instability_radps": -1.0},
        {"accel_walk_mps3_per_rthz": math.nan},
        {"accel_bits": 4},
        {"accel_bits": 16.5},
        {"accel_range_mps2": 0.0},
        {"warm_up_time_constant_s": 0.0},
        {"vibration": [{"order": 0.0}]},
        {"vibration": [{"order": 1.0, "accel_mps2": (1.0, -1.0, 0.0)}]},
        {"vibration_reference_radps": 0.0},
        {"lever_arm_m": (1.0, 2.0)},
        {"gyro_bandwidth_hz": 40.0},
    ],
)
def test_parameters_out_of_range_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(pydantic.ValidationError, match=next(iter(changes))):
        imu(**changes)


def test_a_rate_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="above 0 Hz"):
        imu(0.0)
