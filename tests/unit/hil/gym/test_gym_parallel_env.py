"""PettingZoo's interface: its checker, determinism, vehicles that see and touch each other, bad input."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from hil.gym import Transition
from hil.gym.parallel_env import FlightParallelEnv
from signals.errors import ConfigError
from tests.worlds.bench_files import FLIGHT_SENSORS

PAIR = f"""
rig: mock
scene: airfield
vehicles:
  a: {{start: {{p_W: [0, 0, 0]}}}}
  b: {{start: {{p_W: [0, 1.5, 0]}}}}
{FLIGHT_SENSORS}"""
BENCH = f"""{PAIR}  side:
    {{kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 10, channels: [depth], mount_rpy_deg: [0, 0, 90]}}
"""


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    path = tmp_path / "pair.yaml"
    path.write_text(BENCH)
    return path


def rollout(env: FlightParallelEnv, seed: int, steps: int = 40) -> str:
    digest, random = hashlib.sha256(), np.random.default_rng(seed)
    observations, _ = env.reset(seed=seed)
    for _ in range(steps):
        for name in observations:
            for port in sorted(observations[name]):
                digest.update(observations[name][port].tobytes())
        actions = {name: random.uniform(-0.4, 0.9, 4) for name in env.agents}
        observations, rewards, *_ = env.step(actions)
        digest.update(repr(rewards).encode())
    return digest.hexdigest()


def test_pettingzoo_has_no_complaint(bench: Path) -> None:
    parallel_api_test(FlightParallelEnv(bench, episode_s=1.0), num_cycles=120)


def test_the_same_seed_gives_the_same_bits_after_a_collision(bench: Path) -> None:
    options: dict[str, Any] = {"ports": ["truth", "imu", "side/depth"], "action": "velocity", "speed_mps": 8.0}
    env = FlightParallelEnv(bench, **options)
    first = rollout(env, 3)
    env.reset(seed=5)
    met = set()
    for step in range(150):  # up, then towards each other
        up = 1.0 if step < 50 else 0.0
        left = 0.0 if step < 50 else 1.0
        *_, infos = env.step({"a": [0.0, left, up, 0.0], "b": [0.0, -left, up, 0.0]})
        met.update((name, other) for name, info in infos.items() for other in info["met"])
    assert met == {("a", "b"), ("b", "a")}
    assert rollout(env, 3) == first
    assert rollout(FlightParallelEnv(bench, **options), 3) == first


def test_vehicles_see_each_other(bench: Path) -> None:
    env = FlightParallelEnv(bench, ports=["side/depth"])
    observations, _ = env.reset(seed=1)
    assert observations["a"]["side/depth"].min() < 1.5  # b stands to the left of a
    assert observations["b"]["side/depth"][:20].min() > 10.0


def test_agents_leave_when_their_own_episode_ends(bench: Path) -> None:
    def end(step: Transition) -> bool:
        assert set(step.others) == {"a", "b"} - {step.vehicle}
        return step.vehicle == "a" and step.t_s > 0.1

    env = FlightParallelEnv(
        bench, ports=["truth"], end=end, reward=lambda step: step.others["b" if step.vehicle == "a" else "a"].p_WB[1]
    )
    env.reset(seed=1)
    for _ in range(6):
        _, rewards, ends, _, _ = env.step(dict.fromkeys(env.agents, np.zeros(4)))
    assert rewards["a"] == pytest.approx(1.5, abs=0.1)
    assert ends == {"a": True, "b": False}
    assert env.agents == ["b"]
    with pytest.raises(ValueError, match=r"exactly the agents \(b\); see 'a'"):
        env.step({"a": np.zeros(4), "b": np.zeros(4)})
    env.step({"b": np.zeros(4)})


def test_wrong_actions_name_the_agent(bench: Path) -> None:
    env = FlightParallelEnv(bench, ports=["truth"])
    with pytest.raises(ValueError, match=r"none: call reset\(\)"):
        env.step({"a": np.zeros(4)})
    env.reset(seed=1)
    with pytest.raises(ValueError, match=r"parallel_env of b: action\[2\] is nan"):
        env.step({"a": np.zeros(4), "b": [0, 0, np.nan, 0]})
    with pytest.raises(ValueError, match="see 'b'"):
        env.step({"a": np.zeros(4)})
    with pytest.raises(ValueError, match="actions must be a dictionary by agent, not None"):
        env.step(None)  # type: ignore[arg-type]


def test_another_map_is_refused_and_not_ignored(bench: Path) -> None:
    env = FlightParallelEnv(bench, ports=["truth"])
    with pytest.raises(ValueError, match=r"the map stays; .* settings=\['map_seed=7'\]"):
        env.reset(options={"map_seed": 7})


def test_a_bench_with_one_vehicle_is_refused() -> None:
    with pytest.raises(ConfigError, match="no section `vehicles`"):
        FlightParallelEnv("rigs/benches/gym_hover.yaml")


def test_agents_report_a_bounce_within_one_action(bench: Path) -> None:
    env = FlightParallelEnv(bench, ports=["truth"], action="motors", step_s=0.6)
    env.reset(seed=1)
    vehicle = env.world.vehicles["a"]
    vehicle.place((0.0, 0.0, vehicle.vehicle.standing_height_m + 0.15), v_WB_W=(0.0, 0.0, -3.0))
    infos = env.step({"a": np.ones(4), "b": np.ones(4)})[4]
    assert not vehicle.truth.in_contact
    assert infos["a"]["touched"]


def test_random_vehicles_are_for_one_vehicle(bench: Path) -> None:
    with pytest.raises(ConfigError, match="randomize is for one vehicle"):
        FlightParallelEnv(bench, randomize=True)


def test_each_agent_has_a_recording(bench: Path, tmp_path: Path) -> None:
    env = FlightParallelEnv(bench, ports=["truth", "imu"], record_dir=str(tmp_path / "episodes"))
    env.reset(seed=1)
    env.step({name: np.zeros(4) for name in env.agents})
    env.close()
    assert sorted(path.name for path in (tmp_path / "episodes").iterdir()) == ["a-episode-0.mcap", "b-episode-0.mcap"]
