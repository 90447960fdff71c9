"""hil/Cruise-v0: a plane holds a course, a height and an airspeed."""

from __future__ import annotations

import copy
import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import hil.gym  # noqa: F401 (registers the environments)
from signals.errors import ConfigError

V_MPS = 18.0


def policy(o: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return throttle and elevons of a proportional and damped controller."""
    dz, dV, along, left, *_ = o.tolist()
    up, w = o[8:11].tolist(), (5.0 * o[11:14]).tolist()
    climb = min(max(-9.0 * dz, -3.0), 3.0)
    elevator = -1.5 * (0.03 + climb / V_MPS - up[0]) - 0.3 * w[1]
    bank = min(max(1.5 * math.atan2(left, 2.0 * along), -0.6), 0.6)
    aileron = 0.8 * (bank - math.atan2(up[1], up[2])) - 0.15 * w[0]
    throttle = 0.68 - 0.15 * dV * V_MPS + 0.15 * climb
    action = [2.0 * throttle - 1.0, elevator + aileron, elevator - aileron]
    return np.clip(np.array(action, np.float32), -1.0, 1.0)


def make(**options: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make("hil/Cruise-v0", **options)


def episode(
    env: gymnasium.Env[Any, Any], seed: int, *, steps: int = 10_000
) -> tuple[list[bytes], float, dict[str, Any]]:
    """Fly an episode with the policy; return observations, sum of the rewards, the last info."""
    observation, info = env.reset(seed=seed)
    seen, total = [observation.tobytes()], 0.0
    for _ in range(steps):
        observation, reward, ends, late, info = env.step(policy(observation))
        seen.append(observation.tobytes())
        total += float(reward)
        if ends or late:
            break
    return seen, total, info


@pytest.mark.parametrize("settings", [[], ["wind.steady_W_mps=[4,-3,0]"]])
def test_a_simple_controller_holds_the_flight(settings: list[str]) -> None:
    env = make(episode_s=20.0, settings=settings)
    _, total, info = episode(env, 5)
    assert info["is_success"]
    assert info["t_s"] == 20.0
    assert total > 800.0  # of 1,000
    assert abs(info["height_error_m"]) < 2.0
    assert abs(info["airspeed_error_mps"]) < 0.6


def test_the_same_seed_has_the_same_bits_after_another_episode_and_in_a_copy() -> None:
    env = make(episode_s=4.0)
    first, _, _ = episode(env, 1)
    other, _, _ = episode(env, 2)
    assert first != other
    observation, _ = env.reset(seed=1)
    for _ in range(50):
        observation, *_ = env.step(policy(observation))
    twin = copy.deepcopy(env)
    for one in (env, twin):
        seen, now = [], observation
        while True:
            now, _, ends, late, _ = one.step(policy(now))
            seen.append(now.tobytes())
            if ends or late:
                break
        assert seen == first[51:]


def test_a_batch_has_the_bits_of_single_environments() -> None:
    envs = gymnasium.make_vec("hil/Cruise-v0", num_envs=2, vectorization_mode="vector_entry_point", episode_s=4.0)
    observations, _ = envs.reset(seed=[1, 2])  # type: ignore[arg-type]
    seen: list[list[bytes]] = [[row.tobytes()] for row in observations]
    for _ in range(100):
        observations, *_ = envs.step(np.array([policy(row) for row in observations]))
        for k in (0, 1):
            seen[k].append(observations[k].tobytes())
    for k, seed in enumerate((1, 2)):
        assert seen[k] == episode(make(episode_s=4.0), seed, steps=100)[0]


def test_random_actions_end_the_flight_before_its_time() -> None:
    env = make(episode_s=120.0)
    env.reset(seed=1)
    env.action_space.seed(3)
    for _ in range(6_000):
        _, _, ends, late, info = env.step(env.action_space.sample())
        if ends or late:
            break
    assert ends
    assert not late
    assert not info["is_success"]


def test_a_dive_ends_on_the_ground_or_out_of_range_and_pays_less() -> None:
    env = make(range_m=59.0, start_course_deg=0.0, start_bank_deg=0.0, start_offset_m=0.0, start_rate_radps=0.0)
    env.reset(seed=1)
    rewards = []
    for _ in range(1_000):
        _, reward, ends, _, info = env.step(np.array([-1.0, 0.25, 0.25], np.float32))
        rewards.append(float(reward))
        if ends:
            break
    assert ends
    assert rewards[0] > 0.95
    assert rewards[-1] < 0.05
    assert info["height_error_m"] < -50.0


def test_wrong_benches_and_options_are_told() -> None:
    with pytest.raises(ConfigError, match="'x500' is no plane"):
        make(settings=["vehicle=x500"])
    with pytest.raises(ConfigError, match="action"):
        make(action="rates")
    with pytest.raises(ConfigError, match="start_offset_m 40"):
        make(start_offset_m=40.0)
    for action in ("rates", "motors"):
        with pytest.raises(ConfigError, match="does not fly 'skywalker_x8'"):
            gymnasium.make("hil/Bench-v0", bench="rigs/plane.yaml", action=action)
    with pytest.raises(ConfigError, match="'rates' does not fly 'skywalker_x8'"):
        gymnasium.make("hil/Hover-v0", settings=["vehicle=skywalker_x8"])
