"""Waypoints and Explore: success, collision, maps, ports of every kind."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest

import hil.gym
from hil.gym import batch
from hil.gym.batch import Batch
from hil.gym.task import Step
from hil.run.sensors.frame_stages import available_ports
from signals.errors import ConfigError, HilError
from sim.frame.source import SharedFrames
from sim.scene.solids import solid_tree
from sim.world_loader import load_world


def test_a_task_of_two_words_has_the_name_of_its_class(monkeypatch: pytest.MonkeyPatch) -> None:
    module, kind = ModuleType("hil.gym.tasks.figure_eight"), type("FigureEightTask", (), {})
    module.FigureEightTask = kind  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(batch, "TASKS", ["figure_eight"])
    assert batch.task_class("figure_eight") is kind
    assert batch.environment_id("figure_eight") == "hil/FigureEight-v0"


def fly(env: Any, action_of: Any) -> tuple[float, dict[str, Any], bool]:
    """Fly an episode; return the sum of rewards, the info at the end, and True if it was terminated."""
    observation, total = env.reset(seed=1)[0], 0.0
    while True:
        observation, reward, terminated, truncated, info = env.step(action_of(observation))
        total += reward
        if terminated or truncated:
            return total, info, terminated


def test_the_reward_of_hover_is_that_of_its_formula() -> None:
    """1 / (1 + 4 d^2) - 0.05 min(1, |w| / 10 rad/s), from distance and body rates as the observation has them."""
    options = {"range_m": 5.0, "start_offset_m": 2.0, "start_rate_radps": 8.0, "episode_s": 1.0}
    env = gymnasium.make("hil/Hover-v0", **options).unwrapped
    seen = []
    for seed in range(1, 5):
        env.reset(seed=seed)
        observation, reward, *_ = env.step(np.zeros(env.action_space.shape))
        d, w = 5.0 * float(np.linalg.norm(observation[:3])), 10.0 * float(np.linalg.norm(observation[6:9]))
        assert reward == pytest.approx(1.0 / (1.0 + 4.0 * d * d) - 0.05 * min(1.0, w / 10.0), abs=1e-5)
        seen.append((d, w))
    # Neither term is a constant in what was compared, nor at its limit.
    assert max(d for d, _ in seen) - min(d for d, _ in seen) > 0.3
    assert min(w for _, w in seen) < 8.0
    assert max(w for _, w in seen) > 2.0


def judged(task: Any, measures: list[list[float]], crashed: list[bool]) -> tuple[Any, Any]:
    """Return reward and termination of a step that ends with these measures (d [m], |v|, |w| [rad/s], cos tilt)."""
    task.measures[:] = measures
    count = len(measures)
    flies, crashes = np.ones(count, bool), np.array(crashed)
    return task.judge(Step(np.zeros((count, 4)), flies, np.zeros((count, task.features), np.float32), crashes))


@pytest.mark.parametrize("count", [1, 3])
def test_hover_is_judged_by_its_formula_alone_and_in_a_batch(count: int) -> None:
    task = Batch("hover", count, None, (), {"range_m": 5.0}).task
    for d, rate_radps, cos_tilt, crashed, ends in [
        (0.0, 0.0, 1.0, False, False),
        (1.5, 4.0, 0.3, False, False),
        (4.99, 30.0, 0.01, False, False),
        (5.01, 0.0, 1.0, False, True),
        (0.0, 0.0, -0.01, False, True),
        (0.0, 0.0, 1.0, True, True),
    ]:
        rewards, ended = judged(task, [[d, 9.0, rate_radps, cos_tilt]] * count, [crashed] * count)
        expected = 1.0 / (1.0 + 4.0 * d * d) - 0.05 * min(1.0, rate_radps / 10.0)
        assert rewards == pytest.approx([expected] * count, rel=1e-12)
        assert ended.tolist() == [ends] * count
    # Two seconds of steps near the target in succession are a success.
    judged(task, [[0.26, 0.0, 0.0, 1.0]] * count, [False] * count)
    steps = round(2.0 / task._o.step_s)
    for step in range(steps + 1):
        assert task.info_of(0)["is_success"] is (step >= steps)
        judged(task, [[0.24, 0.0, 0.0, 1.0]] * count, [False] * count)


def test_waypoints_are_judged_by_their_formula() -> None:
    task = Batch("waypoints", 1, None, (), {"course_m": [[3, 0, 5], [3, 4, 5]], "range_m": 15.0}).task
    task.begin(0, task.flights[0], np.random.default_rng(1))
    assert judged(task, [[2.25, 0.0, 0.0, 1.0]], [False])[0] == pytest.approx([3.0 - 2.25])
    assert judged(task, [[2.75, 0.0, 0.0, 1.0]], [False])[0] == pytest.approx([-0.5])
    assert judged(task, [[2.0, 0.0, 0.0, 0.01]], [False])[1].tolist() == [False]
    assert judged(task, [[2.0, 0.0, 0.0, -0.01]], [False])[1].tolist() == [True]
    assert judged(task, [[15.01, 0.0, 0.0, 1.0]], [False])[1].tolist() == [True]
    assert judged(task, [[2.0, 0.0, 0.0, 1.0]], [True])[1].tolist() == [True]
    rewards, ended = judged(task, [[0.49, 0.0, 0.0, 1.0]], [False])
    assert rewards == pytest.approx([2.0 - 0.49 + 1.0])
    assert (task.info_of(0)["reached"], ended.tolist()) == (1, [False])


def test_explore_is_judged_by_its_formula() -> None:
    task = Batch("explore", 1, None, (), {"reach_m": 1.0, "range_m": 50.0}).task
    task.begin(0, task.flights[0], np.random.default_rng(1))
    far_m = float(task._left_m[0])
    rewards, ended = judged(task, [[far_m - 0.75, 0.0, 0.0, 1.0]], [False])
    assert rewards == pytest.approx([0.75 - 0.02])
    assert not ended[0]
    rewards, ended = judged(task, [[far_m - 0.25, 0.0, 0.0, 1.0]], [True])
    assert rewards == pytest.approx([-0.5 - 0.02 - 10.0])
    assert ended[0]
    rewards, ended = judged(task, [[0.99, 0.0, 0.0, 1.0]], [False])
    assert rewards == pytest.approx([far_m - 0.25 - 0.99 - 0.02 + 10.0])
    assert ended[0]
    assert judged(task, [[50.01, 0.0, 0.0, 1.0]], [False])[1][0]
    assert judged(task, [[20.0, 0.0, 0.0, -0.01]], [False])[1][0]


def test_flying_to_each_waypoint_ends_with_success() -> None:
    env = gymnasium.make("hil/Waypoints-v0", action="velocity", course_m=[[2, 0, 5], [2, 2, 6], [-3, 2, 5]])
    range_m = 15.0

    def towards(observation: Any) -> Any:
        way = observation[:3] * range_m  # in the body frame
        return np.append(np.clip(way * [0.3, 0.3, 0.6], -1, 1), 0.0)

    total, info, terminated = fly(env, towards)
    assert terminated
    assert {key: info[key] for key in ("is_success", "reached", "waypoints")} == {
        "is_success": True,
        "reached": 3,
        "waypoints": 3,
    }
    assert total == pytest.approx(3.0 + 2.0 + 5**0.5 + 26**0.5, abs=1.6)  # the ends of each leg are within reach_m


def test_a_crash_at_the_goal_is_no_success() -> None:
    """An action of 4 s flies through the waypoint, 0.1 m over the ground, and into it."""
    options: dict[str, Any] = {"action": "velocity", "course_m": [[0, 0, 0.1]], "step_s": 4.0}
    env = gymnasium.make("hil/Waypoints-v0", **options)
    env.reset(seed=1)
    *_, info = env.step(np.array([0.0, 0.0, -1.0, 0.0]))
    assert [info[key] for key in ("reached", "waypoints", "crashed", "is_success")] == [1, 1, True, False]
    envs = gymnasium.make_vec("hil/Waypoints-v0", 2, **options)
    envs.reset(seed=1)
    *_, infos = envs.step(np.array([[0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 1.0, 0.0]]))
    assert infos["crashed"].tolist() == [True, False]
    assert not infos["is_success"].any()


def test_the_observation_holds_the_next_waypoints() -> None:
    course = [[1, 0, 5], [4, 0, 5], [9, 0, 5]]
    env = gymnasium.make("hil/Waypoints-v0", course_m=course, next_count=4, range_m=20.0).unwrapped
    observation, _ = env.reset(seed=1)
    ways = observation[:12].reshape(4, 3) * 20.0
    assert np.linalg.norm(ways, axis=1) == pytest.approx([1, 4, 9, 9], abs=1e-4)


@pytest.mark.parametrize("port", ["lidar", "front/depth"])
def test_a_collision_ends_explore(port: str) -> None:
    env = gymnasium.make("hil/Explore-v0", port=port, ceiling_m=500.0, range_m=500.0)
    total, info, terminated = fly(env, lambda _observation: np.array([0.0, 0.0, -1.0, 0.0]))  # into the ground
    assert terminated
    assert not info["is_success"]
    assert total < -9.0


def test_explore_reaches_a_goal_in_sight() -> None:
    env = gymnasium.make("hil/Explore-v0", area_m=10.0, goal_m=(5.0, 12.0))
    total, info, terminated = fly(env, lambda o: np.append(np.clip(o[:3] * 50.0 * [0.2, 0.2, 0.5], -1, 1), 0.0))
    assert terminated
    assert info["is_success"]
    assert total > 10.0


def test_sectors_show_the_nearest_obstacle_where_it_is() -> None:
    env = gymnasium.make("hil/Explore-v0").unwrapped
    observation, _ = env.reset(seed=4)
    truth, ranges = env.truth, observation[-36:]  # type: ignore[attr-defined]
    assert (ranges > 0).all()
    assert ranges.min() < 1.0
    solids = solid_tree(load_world(env.bench.scene))  # type: ignore[attr-defined]
    assert solids.distance(truth.p_WB) <= ranges.min() * 20.0 + 0.2


def test_another_map_seed_is_another_map_and_repeats() -> None:
    env = gymnasium.make("hil/Explore-v0")
    first, _ = env.reset(seed=1)
    other, _ = env.reset(seed=1, options={"map_seed": 9})
    again, _ = env.reset(seed=1)
    assert other.tobytes() != first.tobytes()
    assert again.tobytes() == other.tobytes()  # the map stays
    back, _ = env.reset(seed=1, options={"map_seed": 1})
    assert back.tobytes() == first.tobytes()


def test_a_reset_releases_the_renderers_of_the_episode_before(monkeypatch: pytest.MonkeyPatch) -> None:
    opened, closed = [], []
    native = SharedFrames.renderer

    def renderer(self: Any, *arguments: Any, **options: Any) -> Any:
        opened.append(self)
        self._to_close.append(lambda: closed.append(self))
        return native(self, *arguments, **options)

    monkeypatch.setattr(SharedFrames, "renderer", renderer)
    env = gymnasium.make("hil/Explore-v0", port="front/depth")
    for seed in range(3):
        env.reset(seed=seed)
    assert len(opened) == len(closed) + 1 > 3
    env.close()
    assert len(opened) == len(closed)


def test_explore_without_room_or_obstacles_says_so() -> None:
    env = gymnasium.make("hil/Explore-v0", area_m=1.0, goal_m=(15.0, 35.0))
    with pytest.raises(HilError, match=r"hil/Explore-v0: no start and goal with 2.5 m .* change area_m"):
        env.reset(seed=1)
    with pytest.raises(ConfigError, match="shows no obstacles"):
        gymnasium.make("hil/Explore-v0", port="gps")


def test_ports_of_every_sensor_lie_in_their_spaces(tmp_path: Any) -> None:
    bench = tmp_path / "all.yaml"
    bench.write_text(
        "rig: mock\nscene: blocks\nsensors:\n"
        "  imu: {preset: icm20689}\n  gps: {preset: here_plus, rate_hz: 10}\n  baro: {preset: ms5611, rate_hz: 50}\n"
        "  mag: {preset: ist8310, rate_hz: 50}\n  lidar: {preset: vlp16, rate_hz: 10}\n"
        "  radar: {preset: bgt60tr13c, frame: front, rate_hz: 10, outputs: [raw, range_doppler, points, tracks]}\n"
        "  front: {kind: camera, resolution: [48, 36], fov_deg: 90, rate_hz: 10, "
        "channels: [rgb, depth, range, segmentation, instance, geom, normal, radial_velocity, material]}\n"
    )
    env = gymnasium.make("hil/Bench-v0", bench=bench, step_s=0.1)
    observation, _ = env.reset(seed=1)
    assert set(observation) == set(available_ports(env.unwrapped.bench.config))  # type: ignore[attr-defined]
    for _ in range(4):
        assert env.observation_space.contains(observation), [
            name
            for name, space in env.observation_space.spaces.items()
            if not space.contains(observation[name])  # type: ignore[attr-defined]
        ]
        before = observation
        observation, *_ = env.step(np.array([0.0, 0.0, 0.1, 0.5], np.float32))
    constant = [name for name in observation if not observation[name].any()]
    assert set(constant) <= {"radar/points", "radar/tracks", "front/radial_velocity"}
    assert before is not observation
    assert all(not np.shares_memory(before[name], observation[name]) for name in observation)


def test_stable_baselines3_has_no_complaint() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    for name in hil.gym.IDS:
        checker.check_env(gymnasium.make(name), warn=True)


@pytest.mark.parametrize("action", ["motors", "rates"])
def test_leaving_the_range_of_the_model_ends_the_episode(action: str) -> None:
    env = gymnasium.make("hil/Bench-v0", ports=["truth"], action=action).unwrapped
    env.reset(seed=1)
    flight: Any = env.batch.flights[0]  # type: ignore[attr-defined]
    flight.vehicle.place((0.0, 0.0, 49_999.0), v_WB_W=(0.0, 0.0, 190.0))
    for _ in range(100):
        observation, _, terminated, _, _ = env.step(np.full(4, -1.0, np.float32))
        assert np.isfinite(observation["truth"]).all()
        if terminated:
            break
    assert terminated
    assert "distance_from_site_m" in flight.departure.message
    env.reset(seed=1)
    assert not env.step(np.zeros(4, np.float32))[2]


@pytest.mark.slow
def test_the_mock_of_the_rig_flies_velocities_with_the_same_bits_in_every_episode() -> None:
    env = gymnasium.make("hil/Bench-v0", controller="rig", action="velocity", ports=["truth"], step_s=0.1)
    ends = []
    for _ in range(2):
        observation, _ = env.reset(seed=1)
        for _ in range(60):
            observation, *_ = env.step(np.array([0.4, 0.0, 0.5, 0.0]))
        ends.append(observation["truth"])
    env.close()
    assert ends[0].tobytes() == ends[1].tobytes()
    assert ends[0][0] > 3.0  # ahead
    assert ends[0][2] > 1.5
