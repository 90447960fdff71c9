"""Cameras in a run: drawn on demand only, shared, recorded, and without effect on the flight."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import hil.run.part
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.loop.stages import plan_stages
from hil.run.recorder.reading import read_messages
from hil.run.replay import compare, replay
from hil.run.sensors.frame_stages import stage_specs
from hil.run_files import MCAP_NAME
from tests.worlds.spheres_world import FormulaFrames

FLIGHT = ["duration_s=1", "autopilot.transport=loopback", "record.tlog=false", "record.report=false"]
FRONT = [
    "sensors.front.preset=camera_320x240",
    "sensors.front.rate_hz=10",
    "sensors.front.resolution=[32,24]",
    "sensors.front.channels=[rgb,depth]",
]
REAR = [text.replace("front", "rear") for text in FRONT[:3]] + ["sensors.rear.mount_rpy_deg=[0,0,180]"]
NOISY = ["sensors.front.noise.electrons_at_white=500", "sensors.front.latency_s=0.05"]


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> list[FormulaFrames]:
    """The frames made for each run of a test."""
    made: list[FormulaFrames] = []

    def make(_: Any) -> FormulaFrames:
        made.append(FormulaFrames())
        return made[-1]

    monkeypatch.setattr(hil.run.part, "make_frames", make)
    return made


def fly(out: Path, *settings: str) -> dict[str, Any]:
    run = run_bench(load_bench(settings=[*FLIGHT, *settings]), out, quiet=True).run
    assert run["error"] is None, run["error"]
    return run


def messages(out: Path, *prefixes: str) -> list[Any]:
    return [m for m in read_messages(out / MCAP_NAME) if m.topic.startswith(prefixes)]


def test_a_camera_does_not_affect_the_flight(tmp_path: Path, worlds: list[FormulaFrames]) -> None:
    plain = fly(tmp_path / "plain")
    seeing = fly(tmp_path / "seeing", *FRONT, *NOISY)
    wires = ("/truth/", "/imu", "/gps", "/mag", "/baro", "/mavlink/", "/actuators")
    assert messages(tmp_path / "plain", *wires) == messages(tmp_path / "seeing", *wires)
    assert plain["digest"] != seeing["digest"]  # the digest covers the pictures
    assert len(worlds) == 1  # a bench without cameras has no world
    assert seeing["sensors"]["front"]["samples"] == 10
    pictures = messages(tmp_path / "seeing", "/front/rgb")
    assert [m.publish_time_ns - 50_000_000 for m in pictures] == [k * 100_000_000 for k in range(10)]
    assert all(0 <= m.log_time_ns - m.publish_time_ns < 4_000_000 for m in pictures)  # released at the next tick


def test_the_same_run_gives_the_same_pictures(tmp_path: Path, worlds: list[FormulaFrames]) -> None:
    first = fly(tmp_path / "a", *FRONT, *NOISY)
    second = fly(tmp_path / "b", *FRONT, *NOISY)
    assert first["digest"] == second["digest"]
    assert compare(tmp_path / "a" / MCAP_NAME, tmp_path / "b" / MCAP_NAME) is None
    result = replay(tmp_path / "a", lambda config, out: run_bench(load_bench(config), out, quiet=True))
    assert result.identical
    other = fly(tmp_path / "c", *FRONT, "sensors.front.noise.electrons_at_white=501", "sensors.front.latency_s=0.05")
    assert other["digest"] != first["digest"]
    difference = compare(tmp_path / "a" / MCAP_NAME, tmp_path / "c" / MCAP_NAME)
    assert difference is not None
    assert difference.port == "/front/rgb"


def test_unwanted_cameras_are_not_drawn_and_are_reported(tmp_path: Path, worlds: list[FormulaFrames]) -> None:
    plain = fly(tmp_path / "plain")
    blind = fly(tmp_path / "blind", *FRONT, "record.images=false")
    assert worlds == []  # not even the world was made
    assert blind["digest"] == plain["digest"]
    told = {row["what"]: row for row in blind["skipped"]}
    assert told["front/rgb"]["why"] == "no consumer for front/rgb"
    assert told["front/depth"]["saved"] == "10 samples"
    assert blind["sensors"]["front"] == {"samples": 0, "skipped": 10, "ms": {"p50": 0.0, "p99": 0.0}}
    assert messages(tmp_path / "blind", "/front") == []
    assert messages(tmp_path / "blind", "/imu")


def test_cameras_at_one_moment_share_the_scene(tmp_path: Path, worlds: list[FormulaFrames]) -> None:
    run = fly(tmp_path / "run", *FRONT, *REAR)
    (frames,) = worlds
    assert frames.expected == [k * 100_000_000 for k in range(10) for _ in range(2)]
    assert frames.posed == 9
    assert [channels for channels, _ in frames.drawn[:2]] == [("rgb", "depth"), ("rgb",)]
    assert len(frames.drawn) == 20
    told = {row["what"]: row["saved"] for row in run["skipped"]}
    assert told["poses of people and vehicles"] == "7 of 16 poses"
    assert run["timing"]["phase_us"]["frames"]["max"] > 10.0


def test_only_colour_that_is_drawn_by_another_makes_a_run_not_deterministic(
    tmp_path: Path, worlds: list[FormulaFrames]
) -> None:
    egl = [*FRONT, "sensors.front.colour=egl"]
    assert not fly(tmp_path / "drawn", *egl)["deterministic"]
    assert fly(tmp_path / "native", *FRONT)["deterministic"]
    assert fly(tmp_path / "depth", *egl, "sensors.front.channels=[depth]")["deterministic"]
    assert fly(tmp_path / "nobody", *egl, "record.images=false")["deterministic"]


def test_a_stage_for_every_channel() -> None:
    config = load_bench(settings=[*FRONT, *REAR]).config
    plan = plan_stages(stage_specs(config))
    assert plan.order[-5:-2] == ("front/rgb", "front/depth", "rear/rgb")
    without = config.model_copy(update={"record": config.record.model_copy(update={"images": False})})
    dark = plan_stages(stage_specs(without))
    assert [s.stage for s in dark.skipped] == ["front/rgb", "front/depth", "rear/rgb"]


def test_the_run_leaves_calibration_and_pictures_for_the_report(tmp_path: Path, worlds: list[FormulaFrames]) -> None:
    run = run_bench(load_bench(settings=[*FLIGHT[:-1], *FRONT]), tmp_path, quiet=True).run
    assert run["error"] is None, run["error"]
    info = yaml.safe_load((tmp_path / "calibration" / "front.camera_info.yaml").read_text())
    assert np.allclose(info["camera_matrix"]["data"], [16, 0, 15.5, 0, 16, 11.5, 0, 0, 1])
    euroc = yaml.safe_load((tmp_path / "calibration" / "front.sensor.yaml").read_text())
    # Camera axes in the body: x to the right, y down, z forward.
    assert np.allclose(np.reshape(euroc["T_BS"]["data"], (4, 4))[:3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    assert (tmp_path / "frame_front.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "report.html").read_text()
    assert "Frame of front in mid-flight" in page


def test_a_wrong_picture_size_ends_the_run_before_it_begins(tmp_path: Path, worlds: list[FormulaFrames]) -> None:
    class Broken(FormulaFrames):
        def renderer(self, camera: Any, **options: Any) -> Any:
            raise ValueError("no picture of this size")

    hil.run.part.make_frames = lambda _: Broken()  # type: ignore[assignment,return-value]
    run = run_bench(load_bench(settings=[*FLIGHT, *FRONT]), tmp_path, quiet=True).run
    assert run["status"] == "ERROR"
    assert "no picture of this size" in run["error"]["message"]
