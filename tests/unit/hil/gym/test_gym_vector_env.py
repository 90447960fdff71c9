"""The vector environment has the bits of as many single environments."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

import hil.gym
from signals.errors import ConfigError

COUNT = 4
FAULT = "faults.rotors=[{rotor: 1, kind: efficiency, factor: 0.5, at_s: 0.15}]"
STILL: dict[str, Any] = {"action": "position", "start_offset_m": 0.0, "start_speed_mps": 0.0, "episode_s": 1.98}


def make(name: str, **options: Any) -> Any:
    return gymnasium.make_vec(name, num_envs=COUNT, vectorization_mode="vector_entry_point", **options)


def same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[name], b[name]) for name in a)
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def compare(batch: Any, singles: Any, steps: int, actions: int = 4) -> int:
    """Fly the same random actions in both; return the number of episodes that ended."""
    assert batch.observation_space == singles.observation_space
    assert batch.action_space == singles.action_space
    random, ended = np.random.default_rng(1), 0
    assert same(batch.reset(seed=7)[0], singles.reset(seed=7)[0])
    for _ in range(steps):
        action = random.uniform(-0.7, 0.7, (COUNT, actions)).astype(np.float32)
        ours, theirs = batch.step(action), singles.step(action)
        for a, b in zip(ours[:4], theirs[:4], strict=True):
            assert same(a, b)
        over = ours[2] | ours[3]
        ended += int(over.sum())
        if over.any():
            assert ours[4].keys() == theirs[4].keys()
            for key in ours[4]:
                assert np.array_equal(ours[4][key], theirs[4][key]), key
    return ended


@pytest.mark.parametrize(
    ("name", "options", "steps"),
    [
        ("hil/Hover-v0", {"episode_s": 1.0}, 120),
        ("hil/Hover-v0", {"action": "motors"}, 150),
        (
            "hil/Hover-v0",
            {"tolerance_m": 1e-4, "step_s": 0.1, "height_m": 1.0, "action": "motors"},
            60,
        ),  # to the ground
        ("hil/Hover-v0", {"randomize": True, "tolerance_m": 1e-4, "episode_s": 0.5}, 60),
        ("hil/Hover-v0", {"settings": ["wind.turbulence.level=severe"], "episode_s": 0.5}, 60),
        ("hil/Hover-v0", {"settings": [FAULT], "action": "motors", "episode_s": 0.5}, 60),
        ("hil/Hover-v0", STILL, 320),  # a step short of a success, in each episode
        ("hil/Waypoints-v0", {"episode_s": 1.0, "reach_m": 2.0}, 120),
        ("hil/Explore-v0", {"episode_s": 1.0}, 25),
        ("hil/Explore-v0", {"episode_s": 1.0, "port": "front/depth"}, 25),
        ("hil/Bench-v0", {"episode_s": 0.2}, 30),
    ],
)
def test_same_bits_as_single_environments(name: str, options: dict[str, Any], steps: int) -> None:
    singles = SyncVectorEnv([lambda: gymnasium.make(name, **options)] * COUNT)
    assert compare(make(name, **options), singles, steps) > COUNT


@pytest.mark.slow
def test_same_bits_as_environments_in_processes() -> None:
    def one() -> Any:
        return gymnasium.make("hil/Hover-v0", episode_s=1.0)

    others = AsyncVectorEnv([one] * COUNT)
    try:
        assert compare(make("hil/Hover-v0", episode_s=1.0), others, 120) > COUNT
    finally:
        others.close()


def test_a_wrong_action_names_its_environment() -> None:
    envs = make("hil/Hover-v0")
    with pytest.raises(RuntimeError, match=r"call reset\(\)"):
        envs.step(np.zeros((COUNT, 4)))
    envs.reset(seed=1)
    actions = np.zeros((COUNT, 4))
    actions[2, 1] = np.nan
    with pytest.raises(ValueError, match=r"hil/Hover-v0 of environment 2: action\[1\] is nan"):
        envs.step(actions)
    with pytest.raises(ValueError, match="3 actions for 4 environments"):
        envs.step(np.zeros((3, 4)))
    with pytest.raises(ValueError, match="0 actions for 4 environments"):
        envs.step(None)
    with pytest.raises(ValueError, match="true or false for each of 4"):
        envs.reset(options={"reset_mask": [True, False]})
    with pytest.raises(ValueError, match="2 seeds for 4 environments"):
        envs.reset(seed=[1, 2])


def test_wrong_batches_are_refused() -> None:
    with pytest.raises(ConfigError, match="at least 1"):
        hil.gym.FlightVectorEnv("hover", 0)
    with pytest.raises(ConfigError, match="flies without autopilots"):
        hil.gym.FlightVectorEnv("bench", 2, action="velocity", controller="rig")


def test_only_masked_environments_are_reset() -> None:
    envs = make("hil/Hover-v0")
    envs.reset(seed=1)
    moved, *_ = envs.step(np.full((COUNT, 4), 0.3, np.float32))
    mask = np.array([True, False, False, True])
    observation, _ = envs.reset(seed=5, options={"reset_mask": mask})
    assert (observation[1] == moved[1]).all()
    assert (observation[0] != moved[0]).any()
