"""Missions through solid things are told by `hil check`, `hil run` and `hil dataset`; presets can fly over them."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest
from typer.testing import CliRunner

from hil.apps.dataset.plan import make_plan
from hil.apps.fly.check import check_bench
from hil.apps.fly.choice import BenchChoice
from hil.cli.app import app
from hil.config import load_bench
from hil.config.checks.course_notes import course_notes
from hil.config.checks.heading_notes import heading_notes
from hil.config.checks.radius_notes import radius_notes
from hil.config.missions import path
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


def test_a_clear_course_is_searched_to_its_end(tmp_path: Path) -> None:
    bench = bench_file(tmp_path, 5.0, height_m=700.0)
    with pytest.raises(ConfigError, match=r"finds no free way up to 500 m"):
        course_of(bench, tmp_path, clear="true", height_m=499)


def test_a_long_mission_is_searched_in_part_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.config.checks.course_notes._MAX_M", 20.0)
    *_, last = course_of(bench_file(tmp_path, 300.0), tmp_path)
    assert "only 27 m of 87 m were searched for things in the way" in last


def notes_of(folder: Path, *rows: str) -> list[str]:
    """Return the notes on a mission of these rows, from a start 5 m before a box of 2 m height and 8 m length."""
    (folder / "m.waypoints").write_text("\n".join(["QGC WPL 110", "0\t1\t0\t16\t0\t0\t0\t0\t47\t8\t400\t1", *rows, ""]))
    path = bench_file(folder, 9.0, height_m=2.0, more=f"mission: {folder / 'm.waypoints'}\n")
    text = (folder / "yard.yaml").read_text().replace("size_m: [0.2,", "size_m: [8,")
    (folder / "yard.yaml").write_text(text)
    return course_notes(load_bench(path))


UP = "1\t0\t3\t22\t0\t0\t0\t0\t{lat}\t{lon}\t{up}\t1"
OVER = (47.0, 8.0 + 9.0 / 76_060.0)  # 9 m east: over the box


def test_a_landing_on_a_box_is_told_as_such(tmp_path: Path) -> None:
    lat, lon = OVER
    rows = [UP.format(lat=0, lon=0, up=8), f"2\t0\t3\t21\t0\t0\t0\t0\t{lat}\t{lon:.8f}\t0\t1"]
    (note,) = notes_of(tmp_path, *rows)
    assert "item 2: the landing there comes down on 'wall_0', at (9.0, 0.0, 2." in note


def test_a_climb_leads_straight_up_and_a_return_is_left_out(tmp_path: Path) -> None:
    lat, lon = OVER
    rows = [UP.format(lat=lat, lon=f"{lon:.8f}", up=3), "2\t0\t2\t20\t0\t0\t0\t0\t0\t0\t0\t1"]
    assert notes_of(tmp_path, *rows) == []


def test_waypoints_that_may_be_passed_by_are_told(tmp_path: Path) -> None:
    rows = [line.split("\t") for line in Path("rigs/missions/square.waypoints").read_text().splitlines()]
    for row in rows[5:8]:
        row[5] = "1e9"
    path = tmp_path / "wide.waypoints"
    path.write_text("\n".join("\t".join(row) for row in rows) + "\n")
    told = (
        f"{path}:6: item 4 has an acceptance radius of 1e+09 m, more than half of the 20.0 m to it (it counts within "
        "10 m): an autopilot may pass it by; 2 more such"
    )
    for command in (["check", "--mission", str(path)], ["run", "--mission", str(path), "--set", "duration_s=1"]):
        out = [] if command[0] == "check" else ["--out", str(tmp_path / "run")]
        assert told in " ".join(CliRunner().invoke(app, [*command, *out]).output.split())


def test_waypoints_within_their_own_radius_of_the_place_before_are_told(tmp_path: Path) -> None:
    path = tmp_path / "tiny.waypoints"
    text = Path("rigs/missions/square.waypoints").read_text()
    path.write_text(text.replace("8.54585890", "8.54560700"))  # 1 m east
    (note,) = radius_notes(load_bench(mission=str(path)))
    assert note == (
        f"{path}:6: item 4 lies 0.98 m from the place before, within its acceptance radius of 2 m: "
        "an autopilot may pass it by; 1 more such"
    )
    assert radius_notes(load_bench(mission="rigs/missions/square.waypoints")) == []


def edited(mission: str, path: Path, radii_m: dict[int, float], longitudes_deg: dict[int, str] | None = None) -> str:
    """Write a shipped mission with other acceptance radii and longitudes, by item, and return its name."""
    rows = [line.split("\t") for line in Path(mission).read_text().splitlines()]
    for seq, radius_m in radii_m.items():
        rows[seq + 1][5] = f"{radius_m:g}"
    for seq, longitude_deg in (longitudes_deg or {}).items():
        rows[seq + 1][9] = longitude_deg
    path.write_text("\n".join("\t".join(row) for row in rows) + "\n")
    return str(path)


def test_the_named_radius_is_told_whichever_counts(tmp_path: Path) -> None:
    """The second of two waypoints 1 m apart with 5 m was said to have 2 m."""
    path = edited("rigs/missions/square.waypoints", tmp_path / "m.waypoints", {4: 5.0}, {4: "8.54560700"})
    (note,) = radius_notes(load_bench(mission=path))
    assert "item 4 lies 0.98 m from the place before, within its acceptance radius of 5 m: " in note


def test_wings_pass_waypoints_by_within_the_usual_reach(tmp_path: Path) -> None:
    """A waypoint of the X8 counts within 67 m, so that 50 m, half of the 100 m to it, is no bound."""
    near = {2: "8.54957144"}
    for radius_m, told in ((60.0, 0), (1e9, 3)):
        radii = dict.fromkeys((2, 3, 4, 5), radius_m)
        path = edited("rigs/missions/circuit.waypoints", tmp_path / "m.waypoints", radii, near)
        notes = radius_notes(load_bench(Path("rigs/plane.yaml"), mission=path))
        assert len(notes) == (told > 0)
        if told:
            assert "item 3 has an acceptance radius of 1e+09 m, more than half of the 412.4 m to it (it c" in notes[0]
            assert notes[0].endswith(f"; {told - 1} more such")


def test_a_vtol_is_told_of_waypoints_in_hover_as_a_multirotor(tmp_path: Path) -> None:
    path = tmp_path / "m.waypoints"
    edited("rigs/missions/vtol_circuit.waypoints", path, {2: 1e9}, {2: "8.54678820"})  # 90 m
    assert radius_notes(load_bench(Path("rigs/vtol.yaml"), mission=str(path))) == []
    path.write_text(path.read_text().replace("\t84\t", "\t22\t"))
    (tmp_path / "hover.params").write_text("NAV_FORCE_VT 0\n")
    for hover in ("params.NAV_FORCE_VT=0", f"params_file={tmp_path}/hover.params"):
        (note,) = radius_notes(load_bench(Path("rigs/vtol.yaml"), mission=str(path), settings=[f"autopilot.{hover}"]))
        assert "(it counts within 45.1 m)" in note


def test_headings_that_take_longer_than_the_way_are_told_where_the_autopilot_waits_for_them() -> None:
    ring, px4 = "rigs/missions/people_ring.plan", ["autopilot.start=false"]
    bench = load_bench(rig="px4_sitl", mission=ring, settings=px4)
    waits = "turns the nose by 100 degrees on 2.0 m: PX4 waits for the heading, moving on, and leaves its path"
    assert heading_notes(bench) == [f"{ring}:145: item 8 {waits}; 22 more such (set its MIS_YAW_TMT to 5)"]
    bench.config.autopilot.params["MIS_YAW_TMT"] = 5.0
    assert heading_notes(bench) == []
    assert heading_notes(load_bench(rig="mock", mission=ring)) == []
    assert heading_notes(load_bench(rig="px4_sitl", settings=px4)) == []


@pytest.mark.parametrize("bench", ["hil.yaml", "rigs/plane.yaml", "rigs/vtol.yaml"])
def test_a_check_plans_the_path_of_a_mission_once(bench: str, monkeypatch: pytest.MonkeyPatch) -> None:
    order = Mock(wraps=path._flown_order)
    monkeypatch.setattr(path, "_flown_order", order)
    assert check_bench(BenchChoice(Path(bench))).startswith("ok")
    assert order.call_count == 1
