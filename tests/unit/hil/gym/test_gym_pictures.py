"""Pictures of environments: rgb_array, a film by RecordVideo, the window, PettingZoo, and the chase camera."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from gymnasium.wrappers import RecordVideo

import hil.gym
from hil.gym.parallel_env import FlightParallelEnv
from hil.run.film.chase_camera import ChaseCamera
from signals.samples import TruthState, Vec3

SIZE = (160, 120)
CAMERA = "sensors.front={kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 10, channels: [depth]}"
OPTIONS: dict[str, Any] = {"render_mode": "rgb_array", "render_size": SIZE}


def state(t_s: float, p_W: Vec3, v_W: Vec3 = (0.0, 0.0, 0.0)) -> TruthState:
    still = (0.0, 0.0, 0.0)
    return TruthState(0, round(t_s * 1e9), p_W, (1.0, 0.0, 0.0, 0.0), v_W, still, still, still, (), False)


def test_a_picture_shows_the_vehicle_and_its_target() -> None:
    env = gymnasium.make("hil/Hover-v0", action="position", **OPTIONS)
    env.reset(seed=1)
    first = env.render()
    assert isinstance(first, np.ndarray)
    assert first.shape == (120, 160, 3)
    assert first.dtype == np.uint8
    for _ in range(100):
        env.step(np.zeros(4, np.float32))
    picture = env.render()
    assert isinstance(picture, np.ndarray)
    middle = picture[40:80, 60:100].reshape(-1, 3).astype(int)
    assert (middle.max(axis=1) < 60).sum() > 20  # the airframe is nearly black, and nothing else here
    orange = (middle[:, 0] > 200) & (middle[:, 2] < 120)
    assert orange.sum() > 10  # the ring around the target
    env.reset(seed=1)
    assert np.array_equal(env.render(), first)  # type: ignore[arg-type]


def test_record_video_takes_a_picture_of_every_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    films: list[tuple[int, float]] = []

    class Clip:
        def __init__(self, frames: list[Any], fps: float) -> None:
            films.append((len(frames), fps))

        def write_videofile(self, path: str, **_: Any) -> None:
            Path(path).write_bytes(b"")

    package, module = ModuleType("moviepy"), ModuleType("moviepy.video.io.ImageSequenceClip")
    module.ImageSequenceClip = Clip  # type: ignore[attr-defined]
    for name in ("moviepy.video", "moviepy.video.io"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, "moviepy", package)
    monkeypatch.setitem(sys.modules, "moviepy.video.io.ImageSequenceClip", module)
    made = gymnasium.make("hil/Hover-v0", episode_s=0.1, **OPTIONS)
    env = RecordVideo(made, str(tmp_path), episode_trigger=lambda _: True, disable_logger=True)
    env.reset(seed=1)
    for _ in range(5):
        env.step(np.zeros(4, np.float32))
    env.close()
    assert films == [(6, 50)]


def test_a_batch_has_a_picture_of_each() -> None:
    env = gymnasium.make_vec("hil/Hover-v0", num_envs=2, vectorization_mode="vector_entry_point", **OPTIONS)
    env.reset(seed=1)
    single = gymnasium.make("hil/Hover-v0", **OPTIONS)
    single.reset(seed=2)
    pictures = env.render()
    assert pictures is not None
    assert np.array_equal(pictures[1], single.render())  # type: ignore[arg-type]
    assert not np.array_equal(pictures[0], pictures[1])


def test_a_camera_on_board_and_both_side_by_side() -> None:
    for view in ("front", "split"):
        env = gymnasium.make(
            "hil/Bench-v0",
            ports=["truth"],
            render_view=view,
            settings=[
                "sensors.front={kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 10, channels: [depth]}"
            ],
            **OPTIONS,
        )
        env.reset(seed=1)
        picture = env.render()
        assert isinstance(picture, np.ndarray)
        assert picture.shape == (120, 160, 3)
        assert picture[:, 80:].max() > 50


def test_vehicles_of_pettingzoo_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "pair.yaml"
    path.write_text(
        "rig: mock\nscene: airfield\nsensors:\n"
        "  imu: {preset: icm20689}\n  gps: {preset: here_plus, rate_hz: 10}\n"
        "  baro: {preset: ms5611, rate_hz: 50}\n  mag: {preset: ist8310, rate_hz: 50}\n"
        "vehicles:\n  a: {start: {p_W: [0, 0, 0]}}\n  b: {start: {p_W: [3, 0, 0]}}\n"
    )
    env = FlightParallelEnv(path, ports=["truth"], **OPTIONS)
    with pytest.raises(RuntimeError, match=r"call reset\(\) before render"):
        env.render()
    env.reset(seed=1)
    before = env.render()
    assert before.shape == (120, 160, 3)
    for _ in range(20):
        env.step({"a": np.array([0, 0, 0, -1.0]), "b": np.array([0, 0, 0, 1.0])})
    after = env.render()
    assert not np.array_equal(after[:90], before[:90])  # only b flies, in the picture of a


def test_a_window_shows_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Any] = []
    monkeypatch.setattr("hil.gym.env.Window", lambda *_: type("W", (), {"show": lambda _, p: shown.append(p)})())
    env = hil.gym.FlightEnv("hover", render_mode="human", render_size=SIZE)
    env.reset(seed=1)
    env.step(np.zeros(4))
    assert len(shown) == 2
    assert env.render() is None


def test_without_pygame_the_window_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match="pip install pygame"):
        hil.gym.FlightEnv("hover", render_mode="human")


def test_the_chase_camera_is_behind_the_way_and_turns_slowly() -> None:
    camera = ChaseCamera(0.4, None)
    pose = camera.follow(state(0.0, (0.0, 0.0, 10.0), (5.0, 0.0, 0.0)))
    assert pose.p_WC[0] < -2.0
    assert pose.p_WC[1] == pytest.approx(0.0, abs=1e-9)
    assert pose.p_WC[2] > 10.5
    pose = camera.follow(state(0.1, (0.0, 0.0, 10.0), (0.0, 5.0, 0.0)))
    assert -1.0 < pose.p_WC[1] < -0.1  # has begun to turn
    for k in range(100):
        pose = camera.follow(state(0.2 + 0.1 * k, (0.0, 0.0, 10.0), (0.0, 5.0, 0.0)))
    assert pose.p_WC[1] < -2.0
    assert pose.p_WC[0] == pytest.approx(0.0, abs=1e-3)


def test_the_chase_camera_comes_nearer_before_a_wall() -> None:
    class Wall:
        def distance(self, p_W: Vec3) -> float:
            return max(0.0, p_W[0] + 1.5)  # fills x < -1.5

    pose = ChaseCamera(0.2, Wall()).follow(state(0.0, (0.0, 0.0, 10.0)))
    assert -1.5 < pose.p_WC[0] < -0.8
