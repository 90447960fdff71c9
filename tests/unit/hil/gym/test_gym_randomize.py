"""Random vehicles, delays and noise: within their limits, a function of the seed alone, and felt by the flight."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import hil.gym
from hil.gym.randomize import Randomize
from tests.worlds.gym_rollouts import flat, rollout

REST: dict[str, Any] = dict.fromkeys(("start_offset_m", "start_speed_mps", "start_rate_radps", "start_tilt_deg"), 0.0)


def one(seed: int, **randomize: Any) -> tuple[Any, dict[str, Any]]:
    env = hil.gym.FlightEnv("hover", action="motors", randomize=randomize, height_m=100.0, **REST)
    return env, env.reset(seed=seed)[1]["randomized"]


def test_draws_are_within_their_limits_and_do_not_change_each_other() -> None:
    both, mass = Randomize(mass=(0.8, 1.2), inertia=(0.5, 2.0), wind_mps=5.0), Randomize(mass=(0.8, 1.2))
    draws = [both.draw(seed) for seed in range(300)]
    assert [draw.mass for draw in draws] == [mass.draw(seed).mass for seed in range(300)]
    masses = np.array([draw.mass for draw in draws])
    assert 0.8 < masses.min() < 0.81
    assert 1.19 < masses.max() < 1.2
    assert abs(masses.mean() - 1.0) < 0.02
    speeds = np.hypot(*np.array([draw.wind_W_mps[:2] for draw in draws]).T)
    assert speeds.max() < 5.0
    assert abs(speeds.mean() - 2.5) < 0.3
    assert draws[0].motor_lag == draws[0].drag == 1.0


def test_the_acceleration_is_that_of_the_mass_that_was_drawn() -> None:
    env, drawn = one(3, mass=[0.6, 0.6])
    assert drawn["mass"] == pytest.approx(0.6)
    physics = env.batch.flights[0].physics
    env.batch.task.begin(0, env.batch.flights[0], np.random.default_rng(1))
    for _ in range(5):
        env.step(np.zeros(4))
    bench = env.bench.vehicle
    c, truth = bench.rotor_constants, env.truth
    static_n = sum(c.thrust_coefficient_n_per_radps2 * n * n for n in truth.rotor_speed_radps)
    thrust_n = physics.density_ratio * static_n
    assert physics.vehicle.mass_kg == pytest.approx(0.6 * bench.mass_kg)
    drag_n = 0.05 * thrust_n  # axial, of the climb
    assert truth.a_WB_W[2] == pytest.approx(thrust_n / (0.6 * bench.mass_kg) - 9.80665, abs=drag_n / bench.mass_kg)


def test_rotors_follow_with_the_lag_that_was_drawn() -> None:
    speeds = []
    for factor in (0.5, 2.0):
        env, _ = one(1, motor_lag=[factor, factor])
        start = env.truth.rotor_speed_radps[0]
        env.step(np.ones(4))
        speeds.append(env.truth.rotor_speed_radps[0] - start)
        tau_s = factor * env.bench.vehicle.rotor_constants.time_constant_up_s
        most = env.bench.vehicle.rotor_constants.max_speed_radps
        assert speeds[-1] == pytest.approx((most - start) * (1.0 - np.exp(-0.02 / tau_s)), rel=1e-9)
    assert speeds[0] > speeds[1]


def test_an_action_acts_after_its_delay() -> None:
    env, drawn = one(2, delay_s=0.2)
    ticks = round(drawn["delay_s"] / 0.004)
    assert ticks > 5
    start = env.truth.rotor_speed_radps
    for step in range(1 + ticks // 5):
        before = env.truth.rotor_speed_radps
        assert before == pytest.approx(start, rel=1e-6), step
        env.step(np.ones(4))
    env.step(np.ones(4))
    assert env.truth.rotor_speed_radps[0] > 1.05 * start[0]


def test_wind_pushes_and_state_noise_is_on_the_features_alone() -> None:
    env, drawn = one(5, wind_mps=12.0)
    wind = drawn["wind_W_mps"]
    for _ in range(50):
        env.step(np.full(4, -1.0))
    assert np.dot(env.truth.v_WB_W[:2], wind[:2]) > 0.0
    noisy, calm = (hil.gym.FlightEnv("hover", randomize=r) for r in ({"state_noise": 0.05}, None))
    a, b = noisy.reset(seed=1)[0], calm.reset(seed=1)[0]
    assert 0.001 < np.abs(a - b).max() < 0.3
    assert noisy.truth == calm.truth


def test_sensor_noise_is_scaled() -> None:
    spread = []
    for factor in (0.1, 10.0):
        env = hil.gym.FlightEnv("bench", ports=["imu"], randomize={"sensor_noise": [factor, factor]})
        env.reset(seed=1)
        gyro = [env.step(np.full(4, -1.0))[0]["imu"][3:6] for _ in range(30)]
        spread.append(float(np.std(gyro)))
    assert spread[1] > 20.0 * spread[0]


def test_the_same_seed_draws_the_same_after_any_other_episode_and_in_a_batch() -> None:
    env = gymnasium.make("hil/Hover-v0", randomize=True)
    first = rollout(env, 3)
    assert rollout(env, 4) != first
    assert rollout(env, 3) == first
    assert rollout(gymnasium.make("hil/Hover-v0"), 3) != first
    batch = gymnasium.make_vec("hil/Hover-v0", num_envs=3, vectorization_mode="vector_entry_point", randomize=True)
    observations, infos = batch.reset(seed=7)
    singles = [gymnasium.make("hil/Hover-v0", randomize=True) for _ in range(3)]
    for row, single in enumerate(singles):
        observation, info = single.reset(seed=7 + row)
        assert flat(observation) == flat(observations[row])
        assert infos["randomized"]["mass"][row] == info["randomized"]["mass"]
    for _ in range(30):
        observations, *_ = batch.step(np.full((3, 4), 0.1, np.float32))
        for row, single in enumerate(singles):
            assert flat(single.step(np.full(4, 0.1, np.float32))[0]) == flat(observations[row])
