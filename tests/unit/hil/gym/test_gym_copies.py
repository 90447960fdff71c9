"""Copies of environments: pickled and deep-copied ones go on to the bit from where the original is."""

from __future__ import annotations

import copy
import hashlib
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import hil.gym
from hil.gym.parallel_env import FlightParallelEnv
from tests.unit.hil.gym.test_gym_parallel_env import PAIR
from tests.worlds.gym_rollouts import flat, go_on

ROOT = Path(__file__).resolve().parents[4]
NAMES = ("hil/Hover-v0", "hil/Bench-v0", "hil/Waypoints-v0", "hil/Explore-v0")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_where_the_original_is(name: str, copied: Any) -> None:
    env = gymnasium.make(name)
    env.reset(seed=3)
    go_on(env, 12)
    for _ in range(8):
        env.step(np.full(env.action_space.shape, 0.1, np.float32))  # type: ignore[arg-type]
    twin = copied(env)
    assert go_on(twin, 10) == go_on(env, 10)


def test_a_batch_is_copied_with_the_episodes_that_have_begun_meanwhile() -> None:
    env = gymnasium.make_vec(
        "hil/Hover-v0", num_envs=5, vectorization_mode="vector_entry_point", range_m=2.0, randomize=True
    )
    env.reset(seed=3)
    rng = np.random.default_rng(1)
    for _ in range(120):
        env.step(rng.uniform(-0.5, 0.5, (5, 4)).astype(np.float32))
    twin = pickle.loads(pickle.dumps(env))
    assert len({int(n) for n in env.unwrapped.batch.steps}) > 1  # type: ignore[attr-defined]
    assert go_on(twin, 60) == go_on(env, 60)


def test_a_pickled_environment_goes_on_in_another_process(tmp_path: Path) -> None:
    env = hil.gym.FlightEnv("hover", randomize=True)
    env.reset(seed=4)
    for _ in range(20):
        env.step(np.zeros(4))
    (tmp_path / "env").write_bytes(pickle.dumps(env))
    text = (
        "import hashlib, pickle, sys\n"
        "from tests.worlds.gym_rollouts import go_on\n"
        "env = pickle.load(open(sys.argv[1], 'rb')); print(hashlib.sha256(go_on(env, 30)).hexdigest())"
    )
    command = [sys.executable, "-c", text, str(tmp_path / "env")]
    out = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert out.strip() == hashlib.sha256(go_on(env, 30)).hexdigest()


def test_agents_are_copied_in_their_episode(tmp_path: Path) -> None:
    path = tmp_path / "pair.yaml"
    path.write_text(PAIR)
    env = FlightParallelEnv(path, ports=["truth", "imu"])
    env.reset(seed=2)
    actions = {name: np.array([0.1, 0.0, 0.0, 0.5]) for name in env.agents}
    for _ in range(10):
        env.step(actions)
    twins = (copy.deepcopy(env), pickle.loads(pickle.dumps(env)))
    expected = env.step(actions)[0]
    for twin in twins:
        observations = twin.step(actions)[0]
        assert all(flat(observations[name]) == flat(expected[name]) for name in expected)


def test_history_does_not_grow_over_episodes() -> None:
    env = gymnasium.make("hil/Hover-v0", episode_s=0.1)
    for _ in range(50):
        env.reset(seed=1)
        for _ in range(5):
            env.step(np.zeros(4, np.float32))
    assert len(env.unwrapped.batch._history._actions) == 5  # type: ignore[attr-defined]
