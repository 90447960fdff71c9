"""Environments: gymnasium's checker, determinism to the bit, and bad input."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import hil.gym
from hil.run.recorder.reading import Recording
from hil.run.stepped.world import SteppedWorld
from signals.errors import ConfigError
from tests.worlds.gym_rollouts import flat, rollout

ROOT = Path(__file__).resolve().parents[4]
LIDAR = [
    "sensors.lidar={kind: lidar, rate_hz: 10, pattern: {kind: spinning, elevation_deg: [0], columns: 8, firing_ns: 0, "
    "clockwise: false}, min_range_m: 0.1, max_range_m: 20, range_noise_m: 0.02, range_resolution_m: 0.002}"
]
FAR: dict[str, Any] = {"height_m": 300.0, "range_m": 900.0}
QUICK = ("hil/Hover-v0", "hil/Bench-v0", "hil/Waypoints-v0", "hil/Explore-v0")


@pytest.mark.parametrize("name", QUICK)
@pytest.mark.filterwarnings("error")
def test_gymnasium_has_no_complaint(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class NoWindow:  # the checker opens one, and pygame is not among what the tests need
        def __init__(self, title: str, rate_hz: float) -> None: ...

        def show(self, picture: Any) -> None: ...

        def close(self) -> None: ...

    monkeypatch.setattr("hil.gym.env.Window", NoWindow)
    env = gymnasium.make(name, render_size=(64, 64))
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("name", QUICK)
def test_the_same_seed_gives_the_same_bits_after_any_other_episode(name: str) -> None:
    env = gymnasium.make(name)
    first = rollout(env, 3)
    assert rollout(env, 4) != first
    assert rollout(env, 3) == first
    assert rollout(gymnasium.make(name), 3) == first


def test_the_same_seed_gives_the_same_bits_in_another_process() -> None:
    text = (
        "import gymnasium, hil.gym, sys\n"
        "from tests.worlds.gym_rollouts import rollout\n"
        "print(*(rollout(gymnasium.make(name), 5) for name in sys.argv[1:]))"
    )
    out = subprocess.run([sys.executable, "-c", text, *QUICK], cwd=ROOT, capture_output=True, text=True, check=True)
    assert out.stdout.split() == [rollout(gymnasium.make(name), 5) for name in QUICK]


@pytest.mark.parametrize("action", ["rates", "velocity"])
def test_action_zero_holds_the_vehicle(action: str) -> None:
    env = gymnasium.make("hil/Hover-v0", action=action, start_speed_mps=0.0, start_rate_radps=0.0, start_tilt_deg=0)
    env.reset(seed=1)
    start = env.unwrapped.truth.p_WB  # type: ignore[attr-defined]
    for _ in range(50):
        env.step(np.zeros(4, np.float32))
    assert np.linalg.norm(np.subtract(env.unwrapped.truth.p_WB, start)) < 0.3  # type: ignore[attr-defined]


def test_positions_reach_the_target_and_that_is_success() -> None:
    env = gymnasium.make("hil/Hover-v0", action="position")
    env.reset(seed=1)
    over, info, rewards = False, {}, []
    while not over:
        _, reward, terminated, over, info = env.step(np.zeros(4, np.float32))
        assert not terminated
        rewards.append(reward)
    assert len(rewards) == 500
    assert info["is_success"]
    assert rewards[-1] > 0.95 > np.mean(rewards[:20])


def test_motors_held_for_a_step_have_the_bits_of_a_pilot_at_every_tick() -> None:
    env = gymnasium.make("hil/Hover-v0", action="motors")
    env.reset(seed=2)
    batch = env.unwrapped.batch  # type: ignore[attr-defined]
    flight = batch.flights[0]
    bench, start = flight.bench, flight.truth
    world = SteppedWorld(bench.scene, bench.config.tick_ns, wind=bench.config.wind)
    twin = world.add("twin", bench.vehicle)
    twin.place(start.p_WB, start.q_WB, start.v_WB_W, start.w_WB_B, start.rotor_speed_radps)
    random, contacts = np.random.default_rng(1), 0
    for _ in range(150):
        action = random.uniform(-0.8, 0.1, 4)
        batch.step_alone(action.tolist())  # also after the end of the episode
        commands = tuple(0.5 * (value + 1.0) for value in action.tolist())
        twin.pilot = lambda _truth, commands=commands: commands
        for _ in range(5):
            world.step()
        assert flight.truth == twin.truth
        contacts += twin.truth.in_contact
    assert contacts > 5


def test_turbulence_and_a_rotor_fault_begin_again_with_every_episode() -> None:
    settings = [
        "wind.turbulence.level=moderate",
        "faults.rotors=[{rotor: 1, kind: efficiency, factor: 0.7, at_s: 0.3}]",
    ]
    env = gymnasium.make("hil/Hover-v0", settings=settings, action="motors")
    first = rollout(env, 3)
    rollout(env, 4)
    assert rollout(env, 3) == first
    calm = gymnasium.make("hil/Hover-v0", settings=settings[1:], action="motors")
    assert rollout(calm, 3) != first


def test_a_reset_takes_two_milliseconds_at_most() -> None:
    env = gymnasium.make("hil/Hover-v0").unwrapped
    env.reset(seed=1)
    times = []
    for seed in range(20):
        begin = time.process_time_ns()
        env.reset(seed=seed)
        times.append(time.process_time_ns() - begin)
    assert sorted(times)[10] <= 2_000_000


def test_only_observed_ports_are_computed() -> None:
    env = gymnasium.make("hil/Bench-v0", ports=["truth", "gps"])
    observation, _ = env.reset(seed=1)
    assert set(observation) == {"truth", "gps"}
    assert set(env.unwrapped.batch.flights[0].ports._sensors) == {"gps"}  # type: ignore[attr-defined]
    before = observation["gps"]
    for _ in range(60):  # here_plus has a latency
        observation, *_ = env.step(np.zeros(4, np.float32))
    assert observation["gps"][0] == pytest.approx(47.397742, abs=1e-3)
    assert before.dtype == np.float64


def distance(step: hil.gym.Transition) -> float:
    return -step.after.p_WB[2]


def test_reward_and_end_are_functions_or_names_of_functions() -> None:
    env = gymnasium.make("hil/Bench-v0", ports=["truth"], reward=distance, end=lambda step: step.t_s > 0.1)
    env.reset(seed=1)
    _, reward, terminated, _, _ = env.step(np.zeros(4, np.float32))
    assert reward == -env.unwrapped.truth.p_WB[2]  # type: ignore[attr-defined]
    assert not terminated
    for _ in range(5):
        _, _, terminated, _, _ = env.step(np.zeros(4, np.float32))
    assert terminated
    named = gymnasium.make("hil/Bench-v0", ports=["truth"], reward="builtins:repr")
    named.reset()
    with pytest.raises(ValueError, match="has to return a finite number"):
        named.step(np.zeros(4))


def bad_options() -> list[tuple[str, dict[str, Any], str]]:
    return [
        ("hil/Hover-v0", {"bench": "no/such.yaml"}, "no/such.yaml"),
        ("hil/Hover-v0", {"actoin": "rates"}, "did you mean 'action'"),
        ("hil/Hover-v0", {"action": "thrust"}, "must be"),
        ("hil/Hover-v0", {"range_m": float("nan")}, "finite"),
        ("hil/Hover-v0", {"controller": "rig"}, "velocity or position"),
        ("hil/Hover-v0", {"controller": "rig", "action": "velocity"}, "begins in the air"),
        ("hil/Hover-v0", {"step_s": 2.0, "episode_s": 1.0}, "episode_s 1 is shorter than step_s 2"),
        ("hil/Hover-v0", {"settings": ["tick_hzz=3"]}, "tick_hz"),
        ("hil/Hover-v0", {"settings": "tick_hz=500"}, "settings must be a list of texts, not 'tick_hz=500'"),
        ("hil/Hover-v0", {"bench": 3}, "bench must be a file or a loaded bench, not 3"),
        ("hil/Hover-v0", {"step_s": 0.009}, r"hil/Hover-v0: step_s 0.009 .*use 0.008"),
        ("hil/Hover-v0", {"range_m": 1.0}, r"begins up to 1.73 m away, beyond range_m 1"),
        ("hil/Waypoints-v0", {"course_m": [[0, 0, 5], [20, 0, 5]]}, "may be 20 m from .*, beyond range_m 15"),
        ("hil/Waypoints-v0", {"step_m": [50, 0, 0]}, "may be 50 m from .*, beyond range_m 15"),
        ("hil/Explore-v0", {"goal_m": [35, 15]}, r"goal_m\[0\], goal_m\[1\] and range_m"),
        ("hil/Explore-v0", {"height_m": 8.0}, "height_m 8 must be below ceiling_m 6"),
        (
            "hil/Explore-v0",
            {"bench": "rigs/benches/radar_away.yaml", "port": "radar/range_doppler"},
            "'radar/range_doppler' shows no obstacles",
        ),
        ("hil/Hover-v0", {"height_m": len}, "takes no function"),
        ("hil/Hover-v0", {"height_m": np.float32(3)}, "numbers"),
        ("hil/Hover-v0", {"render_view": "front"}, "render_view: 'front' is not a camera of the bench.*chase"),
        ("hil/Hover-v0", {"render_size": [63, 480]}, "render_size"),
        ("hil/Hover-v0", {"tolerance_m": 0.0}, "tolerance_m"),
        ("hil/Hover-v0", {"randomize": {"mass": [1.2, 0.8]}}, "the lower limit 1.2 is above the upper one 0.8"),
        ("hil/Hover-v0", {"randomize": {"weight": 0.1}}, "weight"),
        ("hil/Bench-v0", {"ports": ["imuu"]}, "did you mean 'imu'"),
        ("hil/Bench-v0", {"ports": []}, "at least 1"),
        ("hil/Bench-v0", {"reward": "no.such:thing"}, "cannot be imported"),
        ("hil/Bench-v0", {"reward": ".:thing"}, "cannot be imported"),
        (
            "hil/Bench-v0",
            {"bench": "rigs/formation.yaml", "settings": ["scene=airfield"]},
            "vehicles, and this environment flies one",
        ),
    ]


@pytest.mark.parametrize(("name", "options", "message"), bad_options())
def test_wrong_options_are_configuration_errors(name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        gymnasium.make(name, **options)


def test_pictures_change_no_bit_of_the_flight() -> None:
    env = hil.gym.FlightEnv("hover", render_mode="rgb_array", render_size=[64, 64])
    env.reset(seed=1)
    env.render()
    assert rollout(env, 3) == rollout(hil.gym.FlightEnv("hover"), 3)


def test_the_random_numbers_of_the_environment_are_those_of_gymnasium() -> None:
    env = hil.gym.FlightEnv("hover")
    first = env.reset(seed=7)[0]
    assert env.np_random_seed == 7
    env.np_random = np.random.Generator(np.random.PCG64(7))
    assert flat(env.reset()[0]) == flat(first)


@pytest.mark.parametrize("end", [lambda _: None, lambda _: np.array([True, False]), lambda _: float("nan")])
def test_an_end_that_is_no_truth_value_is_named(end: Any) -> None:
    env = hil.gym.FlightEnv("bench", ports=["truth"], end=end)
    env.reset(seed=1)
    with pytest.raises(ValueError, match=r"hil/Bench-v0: end returned .*; it has to return True or False"):
        env.step(np.zeros(4))


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0, float("nan"), 0.0, 0.0], r"hil/Hover-v0: action\[1\] is nan"),
        ([0.0, 0.0, 0.0, float("-inf")], r"action\[3\] is -inf"),
        ([0.0, 0.0, 0.0], r"shape \(3,\), and the space \(4,\)"),
        (0.5, r"shape \(\)"),
        (None, "is not an array of numbers|shape"),
        ("up", "is not an array of numbers"),
        ([10**400, 0, 0, 0], "is not an array of numbers"),
    ],
)
def test_wrong_actions_name_environment_and_index(action: Any, message: str) -> None:
    env = gymnasium.make("hil/Hover-v0").unwrapped
    env.reset(seed=1)
    before = env.truth  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=message):
        env.step(action)
    assert env.truth == before  # type: ignore[attr-defined]


def test_actions_beyond_the_space_are_clipped() -> None:
    a, b = gymnasium.make("hil/Hover-v0"), gymnasium.make("hil/Hover-v0")
    a.reset(seed=1)
    b.reset(seed=1)
    assert flat(a.step(np.array([2.0, 0, 0, -9.0]))[0]) == flat(b.step(np.array([1.0, 0, 0, -1.0]))[0])


def test_resets_refuse_unknown_options_and_maps_without_a_seed() -> None:
    env = gymnasium.make("hil/Hover-v0")
    with pytest.raises(ValueError, match="no option 'mapseed'; the only one is 'map_seed'"):
        env.reset(options={"mapseed": 3})
    with pytest.raises(ValueError, match="map_seed has no meaning: the map of scene 'airfield'"):
        env.reset(options={"map_seed": 3})
    with pytest.raises(ValueError, match="whole number"):
        env.reset(options={"map_seed": -1})
    with pytest.raises(ValueError, match="whole number"):
        env.reset(options={"map_seed": np.array([1, 2])})
    with pytest.raises(ValueError, match="must be a dictionary, not 'map_seed'"):
        env.reset(options="map_seed")  # type: ignore[arg-type]


@pytest.mark.parametrize("options", [{"episode_s": 0.04}, {"action": "motors"}])
def test_stepping_after_the_end_of_an_episode_says_so(options: dict[str, Any]) -> None:
    """It flew on, and an agent learned from what no episode has: one is truncated, in the other the rotors stop."""
    env: Any = gymnasium.make("hil/Hover-v0", **options)
    for seed in (1, 2):
        env.reset(seed=seed)
        while not any(env.step(np.full(4, -1.0))[2:4]):
            pass
        with pytest.raises(RuntimeError, match=r"the episode has ended \(terminated or truncated\): call reset\(\)"):
            env.step(np.full(4, -1.0))


def test_stepping_before_the_first_reset_says_so() -> None:
    with pytest.raises(RuntimeError, match=r"call reset\(\)"):
        gymnasium.make("hil/Hover-v0").unwrapped.step(np.zeros(4))


def test_without_gymnasium_one_message_names_the_extra() -> None:
    text = "import sys; sys.modules['gymnasium'] = None\ntry:\n import hil.gym\nexcept ImportError as e: print(e)"
    out = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert out.strip() == "hil.gym needs gymnasium, which is missing: pip install 'hil-bench[gym]'"


def bouncing(task: str, **options: Any) -> Any:
    """Return an environment whose vehicle falls at 3 m/s onto the ground 0.15 m below its feet."""
    env = hil.gym.FlightEnv(task, action="motors", **options)
    env.reset(seed=1)
    flight = env.batch.flights[0]
    x, y, z = flight.bench.config.start.flight_start().ground_W
    height_m = flight.bench.vehicle.standing_height_m + 0.15
    flight.vehicle.place((x, y, z + height_m), v_WB_W=(0.0, 0.0, -3.0))
    return env


def test_a_bounce_within_one_action_ends_the_episode() -> None:
    env = bouncing("hover", step_s=0.6, range_m=50.0)
    _, _, terminated, _, info = env.step(np.ones(4))
    assert not env.truth.in_contact  # it is in the air again
    assert terminated
    assert info["touched"]
    assert info["crashed"]
    free = bouncing("hover", step_s=0.02, range_m=50.0)
    assert not free.step(np.ones(4))[4]["touched"]


def test_reward_and_end_see_a_bounce_within_one_action() -> None:
    seen: list[hil.gym.Transition] = []

    def end(step: hil.gym.Transition) -> bool:
        seen.append(step)
        return step.touched

    env = bouncing("bench", ports=["truth"], end=end, step_s=0.6)
    assert env.step(np.ones(4))[2]
    assert seen[0].touched
    assert not seen[0].after.in_contact


@pytest.mark.parametrize("name", QUICK)
def test_every_step_has_the_same_keys_of_info(name: str) -> None:
    env = gymnasium.make(name)
    _, first = env.reset(seed=1)
    infos = [env.step(np.zeros(env.action_space.shape, np.float32))[4] for _ in range(3)]  # type: ignore[arg-type]
    assert {"t_s", "touched", "crashed"} <= first.keys()
    assert all(info.keys() == first.keys() for info in infos)
    assert infos[2]["t_s"] == pytest.approx(3 * infos[0]["t_s"])


def test_a_tolerance_gives_that_error_or_less() -> None:
    exact, coarse = (hil.gym.FlightEnv("hover", action="motors", **FAR, tolerance_m=t) for t in (1e-9, 1e-4))
    for env in (exact, coarse):
        env.reset(seed=1)
    random, error_m = np.random.default_rng(1), 0.0
    for _ in range(100):
        action = random.uniform(-0.3, 0.5, 4)
        exact.step(action)
        coarse.step(action)
        error_m = max(error_m, float(np.linalg.norm(np.subtract(exact.truth.p_WB, coarse.truth.p_WB))))
    assert 1e-9 < error_m < 1e-4


def test_an_episode_is_recorded_as_mcap(tmp_path: Path) -> None:
    env = hil.gym.FlightEnv("bench", ports=["truth", "imu", "lidar"], record_dir=str(tmp_path), settings=LIDAR)
    for episode in range(2):
        env.reset(seed=episode)
        for _ in range(7):
            env.step(np.array([0.1, 0.0, 0.0, 0.5]))
    end = env.truth
    env.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["episode-0.mcap", "episode-1.mcap"]
    recording = Recording(tmp_path / "episode-1.mcap").scan()
    assert recording.complete
    assert recording.metadata["hil_run"]["tick_ns"] == "4000000"
    by_topic: dict[str, list[Any]] = {}
    for message in recording.messages():
        by_topic.setdefault(message.topic, []).append(message.decode())
    assert len(by_topic["/truth/pose"]) == 8
    last = by_topic["/truth/pose"][-1]
    assert tuple(last[f"pose.position.{axis}"] for axis in "xyz") == end.p_WB
    assert [m["value"] for m in by_topic["/action/3"]] == [0.5] * 7
    assert len(by_topic["/reward"]) == 7
    assert len(by_topic["/imu"]) == 36  # 250 Hz, from the start on
    assert "/lidar" in by_topic
    again = hil.gym.FlightEnv("hover", record_dir=str(tmp_path))
    again.reset(seed=1)
    again.close()
    assert (tmp_path / "episode-2.mcap").is_file()  # nothing is written over
