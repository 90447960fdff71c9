"""`hil video`: the film of a recorded run has pictures of its instants, in every view; wrong wishes are told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hil.apps.video.command import VideoOptions, film_run
from hil.cli.app import run_command_line
from hil.config.load import load_bench
from hil.config.saved import save_bench
from hil.run.recorder.recorder import Recorder
from hil.run.stepped.world import SteppedWorld
from signals.errors import ConfigError, RecordingError

CAMERA = "sensors.front={kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 10, channels: [rgb]}"
SMALL = VideoOptions(size="160x120", rate_hz=10.0)


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of a second, in which the vehicle climbs and flies forward."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    bench = load_bench("rigs/benches/gym_hover.yaml", settings=[CAMERA], flown=False)
    save_bench(bench, folder)
    world = SteppedWorld(bench.scene, bench.config.tick_ns)
    vehicle = world.add("vehicle", bench.vehicle)
    vehicle.place((0.0, 0.0, 3.0), v_WB_W=(3.0, 0.0, 2.0))
    recorder = Recorder(folder, mcap=True, tlog=False, tick_ns=bench.config.tick_ns)
    for _ in range(251):
        recorder.truth(vehicle.truth)
        world.step()
    recorder.close("PASS")
    return folder


def pictures(path: Path) -> list[np.ndarray]:
    film, found = cv2.VideoCapture(str(path)), []
    while (read := film.read())[0]:
        found.append(read[1])
    return found


def test_a_film_has_a_picture_for_every_instant(run_dir: Path, tmp_path: Path) -> None:
    times: list[float] = []
    path, count = film_run(run_dir, tmp_path / "a.mp4", SMALL, times.append)
    film = pictures(path)
    assert count == len(film) == 11
    assert times == pytest.approx([0.1 * k for k in range(11)])
    assert film[0].shape == (120, 160, 3)
    airframe = film[5][40:80, 60:100].max(axis=2)
    assert (airframe < 90).sum() > 20
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FPS) == 10.0
    fast = replace(SMALL, speed=2.0, start_s=0.2, end_s=0.8)
    assert film_run(run_dir, tmp_path / "b.mp4", fast)[1] == 4


@pytest.mark.parametrize("view", ["front", "split"])
def test_the_camera_on_board_is_filmed(run_dir: Path, tmp_path: Path, view: str) -> None:
    path, _ = film_run(run_dir, tmp_path / "a.mp4", replace(SMALL, view=view, end_s=0.2))
    film = pictures(path)
    assert len(film) == 3
    sky, ground = film[0][50, 120].astype(int), film[0][75, 120].astype(int)
    assert sky[0] > ground[0] + 20  # bluer


def test_wrong_wishes_are_told(run_dir: Path, tmp_path: Path) -> None:
    for options, message in (
        (replace(SMALL, view="rear"), "'rear' is not a camera of the bench.*chase, split, front"),
        (replace(SMALL, vehicle="b"), "'b' is not a vehicle"),
        (replace(SMALL, size="12"), "must be WIDTHxHEIGHT"),
    ):
        with pytest.raises(ConfigError, match=message):
            film_run(run_dir, None, options)
    with pytest.raises(RecordingError, match="no states from 7 s on"):
        film_run(run_dir, tmp_path / "a.mp4", replace(SMALL, start_s=7.0))
    with pytest.raises(ConfigError, match="does not exist"):
        film_run(tmp_path / "nothing", None, SMALL)
    with pytest.raises(RecordingError, match=r"it has no run\.mcap"):
        film_run(tmp_path, None, SMALL)
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot be written"):
        film_run(run_dir, tmp_path / "file" / "a.mp4", SMALL)


def test_the_command_writes_beside_the_run(run_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["video", str(run_dir), "--size", "160x120", "--end", "0.1", "--rate", "10"]) == 0
    assert (run_dir / "video.mp4").stat().st_size > 1000
    assert "2 pictures" in capsys.readouterr().out
    assert run_command_line(["video", str(run_dir), "--view", "rear"]) == 2
