"""Missions through solid things are told by `hil check`, `hil run` and `hil dataset`; presets can fly over them."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil.apps.dataset.plan import make_plan
from hil.cli.app import app
from hil.config import load_bench
from hil.config.checks.course_notes import course_notes
from signals.errors import ConfigError

SCENE = """\
name: yard
description: A wall across the way
site: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_m: 400.0}
ground_friction: 0.8
gravity_mps2: 9.80665
wind_W_mps: [0.0, 0.0, 0.0]
boxes:
"""
BENCH = """\
rig: mock
scene: {scene}
sensors:
  imu:  {{preset: icm20689}}
  gps:  {{preset: here_plus, rate_hz: 10}}
  baro: {{preset: ms5611, rate_hz: 50}}
  mag:  {{preset: ist8310, rate_hz: 50}}
  front: {{preset: camera_320x240, rate_hz: 2}}
"""


def bench_file(folder: Path, *walls_m: float, height_m: float = 9.0, more: str = "") -> Path:
    """Write a bench with walls that lie across the way east, `height_m` high, at these distances."""
    rows = [
        f"- {{name: wall_{i}, center_m: [{x}, 0, {0.5 * height_m}], size_m: [0.2, 60, {height_m}]}}\n"
        for i, x in enumerate(walls_m)
    ]
    (folder / "yard.yaml").write_text(SCENE + "".join(rows))
    path = folder / "bench.yaml"
    path.write_text(BENCH.format(scene=folder / "yard.yaml") + more)
    return path


def course_of(bench: Path, work: Path, **settings: object) -> list[str]:
    """Return the notes on the square of 20 m, 8 m up."""
    texts = tuple(f"dataset.trajectory.{key}={value}" for key, value in {"preset": "square", **settings}.items())
    plan = make_plan(bench, frames=4, quality="low", seed=None, settings=texts, work=lambda: work)
    trajectory = plan.config.dataset.trajectory
    assert trajectory is not None
    return [f"{trajectory.height_m:g}", *course_notes(plan.bench)]


def test_a_plan_without_obstacles_has_no_notes(tmp_path: Path) -> None:
    assert course_notes(load_bench()) == []
    assert course_of(bench_file(tmp_path, 30.0), tmp_path) == ["8"]


def test_each_thing_in_the_way_is_told_once(tmp_path: Path) -> None:
    height, first, second = course_of(bench_file(tmp_path, 5.0, 8.0, 14.0), tmp_path, side_m=16)
    assert height == "8"
    assert first.startswith("dataset.trajectory: item 4: the straight way there meets 'wall_0' after 4.")
    assert first.endswith(", 0.0, 8.0): fly higher, or around it")
    assert "item 6: the straight way there meets 'wall_2' after 1." in second  # on the way back


def test_the_things_that_are_not_told_singly_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.config.checks.course_notes._SHOWN", 1)
    (only,) = course_of(bench_file(tmp_path, 5.0, 8.0, 14.0), tmp_path, side_m=16)[1:]
    assert "'wall_0'" in only
    assert only.endswith("; 1 more in the way")


def test_check_and_run_tell_what_is_in_the_way(tmp_path: Path) -> None:
    path = bench_file(tmp_path, 5.0, height_m=20.0, more="mission: rigs/missions/rectangle.plan\nduration_s: 1\n")
    for command in (["check", str(path)], ["run", str(path), "--out", str(tmp_path / "run")]):
        told = CliRunner().invoke(app, command).output.replace("\n", "")
        assert "the straight way there meets 'wall_0'" in told


def test_a_clear_course_flies_over_what_stands_in_its_way(tmp_path: Path) -> None:
    assert course_of(bench_file(tmp_path, 5.0), tmp_path, clear="true") == ["10"]


def test_a_course_without_a_free_way_is_refused(tmp_path: Path) -> None:
    bench = bench_file(tmp_path, 5.0, height_m=80.0)
    with pytest.raises(ConfigError, match=r"dataset.trajectory.clear: finds no free way up to 48 m: .*'wall_0'"):
        course_of(bench, tmp_path, clear="true")
