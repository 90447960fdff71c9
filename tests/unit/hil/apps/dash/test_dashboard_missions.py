"""Missions that a page uploads or draws: checked, kept and offered by the start form."""

from __future__ import annotations

from pathlib import Path

import pytest

import rigs
from hil.apps.dash.server.choices import choices, run_arguments
from hil.apps.dash.server.missions import keep_drawn, keep_file
from hil.config.missions import load_mission
from signals.geodesy import LocalFrame
from sim.scene.scene import load_scene

SQUARE = Path(rigs.__file__).parent / "missions" / "square.waypoints"
COURSE = {"points_m": [[10.0, 0.0], [10.0, 20.0], [-5.0, 7.5]], "height_m": 4.0, "speed_mps": 3.0}
START = (3.0, -2.0, 0.5)


def test_an_uploaded_mission_is_offered_and_flown(tmp_path: Path) -> None:
    folder = tmp_path / "missions"
    path = keep_file("my square.waypoints", SQUARE.read_bytes(), folder)
    lists = choices(None, folder)
    assert lists is not None
    assert lists["mission"][0] == str(path)
    assert f"--mission={path}" in run_arguments({"mission": str(path)}, None, folder)
    with pytest.raises(ValueError, match="not in the list"):
        run_arguments({"mission": str(path)}, None)
    assert [file.name for file in folder.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("name", "data", "told"),
    [
        ("../up.waypoints", SQUARE.read_bytes(), "not a mission"),
        ("script.yaml", b"steps: []", "not a mission"),
        ("a.waypoints", b"QGC WPL 110\n1 2 3\n", "a.waypoints:2"),
        ("a.plan", b"\xff\xfe", "a.plan"),
        ("a.plan", b"x" * (1 << 21), "MB"),
    ],
)
def test_a_file_that_would_not_fly_is_not_kept(tmp_path: Path, name: str, data: bytes, told: str) -> None:
    with pytest.raises(ValueError, match=told) as caught:
        keep_file(name, data, tmp_path / "missions")
    assert "tmp" not in str(caught.value)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_link_of_that_name_is_replaced_and_not_followed(tmp_path: Path) -> None:
    other = tmp_path / "other.txt"
    other.write_text("mine")
    folder = tmp_path / "missions"
    folder.mkdir()
    (folder / "a.waypoints").symlink_to(other)
    keep_file("a.waypoints", SQUARE.read_bytes(), folder)
    assert other.read_text() == "mine"
    assert not (folder / "a.waypoints").is_symlink()


@pytest.mark.parametrize("land_at_start", [False, True])
def test_a_drawn_course_is_a_mission_through_its_points(tmp_path: Path, land_at_start: bool) -> None:
    site = load_scene("city_park").site
    path = keep_drawn(COURSE | {"land_at_start": land_at_start}, site, START, tmp_path)
    mission = load_mission(path)
    frame = LocalFrame(site)
    flown = [
        frame.enu_from_geodetic(item.lat_degE7 * 1e-7, item.lon_degE7 * 1e-7, site.altitude_m)[:2]
        for item in mission.items
        if item.command in (16, 21)
    ]
    drawn = [(10.0, 0.0), (10.0, 20.0), (-5.0, 7.5)]
    wanted = [*drawn, START[:2], START[:2]] if land_at_start else [*drawn, drawn[-1]]
    assert len(flown) == len(wanted)
    for (east, north), (x, y) in zip(flown, wanted, strict=True):
        assert abs(east - x) < 0.02
        assert abs(north - y) < 0.02
    assert [item.command for item in mission.items][:2] == [22, 178]
    assert mission.items[0].alt_m == 4.0
    assert keep_drawn(COURSE, site, START, tmp_path) != path  # the second of the same second


@pytest.mark.parametrize(
    "change",
    [
        {"points_m": []},
        {"points_m": [[0.0, float("nan")]]},
        {"points_m": [["east", 0.0]]},
        {"height_m": 0.0},
        {"speed_mps": 1e9},
        {"more": 1},
    ],
)
def test_a_course_that_is_wrong_is_refused(tmp_path: Path, change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        keep_drawn(COURSE | change, load_scene("airfield").site, START, tmp_path)
    assert list(tmp_path.iterdir()) == []
