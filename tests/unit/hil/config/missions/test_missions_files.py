"""Mission files: the missions read from them, and every mistake with its line."""

from __future__ import annotations

import contextlib
import copy
import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.config.missions import Geopoint, Mission, load_mission
from hil.config.missions.waypoints_file import parse_waypoints
from hil.run.parts.pilots.mission import MissionPart
from signals.errors import ConfigError

MISSIONS = Path(__file__).resolve().parents[5] / "rigs" / "missions"
SITE = Geopoint(47.397742, 8.545594, 488.0)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def item(command: int = 16, *, frame: Any = 3, params: list[Any] | None = None, jump_id: int = 1) -> dict[str, Any]:
    standard = [0, 0, 0, None, 47.3978, 8.5456, 10]
    return {
        "type": "SimpleItem", "autoContinue": True, "command": command, "doJumpId": jump_id, "frame": frame,
        "params": standard if params is None else params,
    }  # fmt: skip


def at(latitude: Any = 47.3978, longitude: Any = 8.5456, altitude: Any = 10, command: int = 16) -> dict[str, Any]:
    return item(command, params=[0, 0, 0, None, latitude, longitude, altitude])


def numbers(command: int, *, p1: float = 0, p2: float = 0, p3: float = 0, frame: int = 3) -> dict[str, Any]:
    place = [47.3978, 8.5456, 10] if frame == 3 else [0, 0, 0]
    return item(command, frame=frame, params=[p1, p2, p3, None, *place])


def plan(*items: Any, **mission: Any) -> str:
    """A plan with every item on a line of its own: item n (from 1) is line n + 2."""
    head = '{"fileType": "Plan", "version": 1, "groundStation": "QGroundControl",\n'
    keys = "".join(f'"{key}": {json.dumps(value)}, ' for key, value in mission.items())
    return head + f'"mission": {{{keys}"items": [\n' + ",\n".join(json.dumps(i) for i in items) + "]}}\n"


def load(text: str, name: str = "m.plan") -> Mission:
    Path(name).write_text(text, encoding="utf-8")
    return load_mission(Path(name), site=SITE)


def refused(text: str, name: str = "m.plan") -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(text, name)
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize(
    ("name", "items", "waypoints"),
    [("rectangle.plan", 9, 6), ("survey.plan", 23, 20), ("square.waypoints", 8, 5)],
)
def test_the_missions_that_come_with_the_bench(name: str, items: int, waypoints: int) -> None:
    mission = load_mission(MISSIONS / name, site=SITE)
    assert (len(mission.items), len(mission.waypoints)) == (items, waypoints)
    assert [i.seq for i in mission.items] == list(range(items))
    assert [i.current for i in mission.items] == [1] + [0] * (items - 1)
    assert mission.planned_home == SITE


def test_an_item_is_scaled_to_mission_item_int() -> None:
    mission = load(plan(item(params=[5, 0.5, 0, None, 47.39776543, 8.54321012, 12.5])))
    (only,) = mission.items
    assert only[:8] == (0, 3, 16, 1, 1, 5.0, 0.5, 0.0)
    assert math.isnan(only.param4)
    assert only[9:] == (473977654, 85432101, 12.5)
    no_place = load(plan(at(), item(112, frame=2, params=[1, 0, 0, 0, 3, 4, 5]))).items[1]
    assert no_place[9:] == (3, 4, 5.0)


def test_surveys_are_flown_as_the_planner_computed_them_and_jumps_find_their_items() -> None:
    inner = [item(jump_id=2), item(206, frame=2, params=[25, 0, 1, 0, 0, 0, 0], jump_id=3), item(jump_id=4)]
    survey = {
        "type": "ComplexItem", "complexItemType": "survey", "TransectStyleComplexItem": {"Items": inner, "version": 2}
    }  # fmt: skip
    mission = load(plan(item(22, jump_id=1), survey, item(177, frame=2, params=[4, 2, 0, 0, 0, 0, 0], jump_id=9)))
    assert [i.command for i in mission.items] == [22, 16, 206, 16, 177]
    assert mission.items[4].param1 == 3.0


def test_a_fence_and_rally_points_that_nobody_gets_are_told() -> None:
    fence = {"polygons": [{"polygon": [[47.39, 8.54]]}], "circles": [{"circle": {}}], "version": 2}
    text = plan(at()).rstrip().removesuffix("}") + f',\n"geoFence": {json.dumps(fence)},\n'
    mission = load(text + '"rallyPoints": {"points": [[47.39, 8.54, 20]]}}')
    assert mission.notes == (
        "m.plan:4: 2 geofences of the plan not uploaded: nothing keeps to them here",
        "m.plan:5: 1 rally point of the plan not uploaded: nothing keeps to them here",
    )
    said: list[tuple[str, str]] = []
    run = SimpleNamespace(say=lambda kind, text: said.append((kind, text)))
    MissionPart(None, flies=True, notes=mission.notes).begin(run)  # type: ignore[arg-type]
    assert said == [("warning", note) for note in mission.notes]
    assert load(text + '"rallyPoints": {"points": []}}').notes == mission.notes[:1]
    assert load_mission(MISSIONS / "rectangle.plan", site=SITE).notes == ()


@pytest.mark.parametrize("speed", [-2, -1, 0, 5, None])
def test_speeds_that_are_words_or_open_are_taken(speed: float | None) -> None:
    change = item(178, frame=2, params=[1, speed, -1, 0, 0, 0, 0])
    assert len(load(plan(at(), change, numbers(18, p1=1, p3=-80))).items) == 3


def test_unknown_commands_are_left_to_the_autopilot() -> None:
    assert load(plan(at(), item(31010, frame=2, params=[0] * 7))).items[1].command == 31010


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (plan(), "m.plan: has no waypoints: its list of items is empty (a mission needs at least one place to fly to)"),
        (plan(item(178, frame=2, params=[1, 3, -1, 0, 0, 0, 0])),
         "m.plan: has no waypoints (a mission needs at least one place to fly to)"),
        (plan(at(), at(math.nan)), "m.plan:4: item 2: param 5 is not finite: nan (null leaves a value open)"),
        (plan(at(), at(), at(altitude=math.inf)),
         "m.plan:5: item 3: param 7 is not finite: inf (null leaves a value open)"),
        (plan(at(altitude=1e39)), "m.plan:3: item 1: param 7 is not finite: 1e+39 (null leaves a value open)"),
        (plan(at(None)), "m.plan:3: item 1 (waypoint) has no latitude"),
        (plan(at(91)), "m.plan:3: item 1 (waypoint) has the latitude 91 deg, outside -90 to 90 deg"),
        (plan(at(47, -181)), "m.plan:3: item 1 (waypoint) has the longitude -181 deg, outside -180 to 180 deg"),
        (plan(at(altitude=5001)),
         "m.plan:3: item 1 (waypoint) cannot be reached: 5001 m above home, more than 5000 m"),
        (plan(at(altitude=-1)), "m.plan:3: item 1 (waypoint) is below the ground: 1 m below home"),
        (plan(at(altitude=None)), "m.plan:3: item 1 (waypoint) has no altitude"),
        (plan(item(frame=0, params=[0, 0, 0, 0, 47.3978, 8.5456, 480])),
         "m.plan:3: item 1 (waypoint) is below the ground: 8 m below the site"),
        (plan(at(altitude=0, command=22)), "m.plan:3: item 1 (take-off) goes to 0 m above home: it must climb"),
        (plan(at(48.5)),
         "m.plan:3: item 1 (waypoint) is 123 km from the scene's site at 47.39774, 8.54559; at most 100 km are accepted"
         " (name the mission of this place with --mission, a scene with the site of this mission with "
         "--scene, or fly none: --set mission=null)"),
        (plan(at(), at(48.5), at(48.6), at(48.7)),
         "m.plan:4: item 2 (waypoint) is 123 km from the scene's site at 47.39774, 8.54559; at most 100 km are accepted"
         ", and so are 2 items more (name the mission of this place with --mission, a scene with the site of this "
         "mission with --scene, or fly none: --set mission=null)"),
        (plan(at(), numbers(16, p1=-5)), "m.plan:4: item 2 waits -5 s (give 0 s or more)"),
        (plan(at(), numbers(16, p2=-5)),
         "m.plan:4: item 2 has the acceptance radius -5 m (give more than 0 m, or 0 for the autopilot's own)"),
        (plan(at(), numbers(18, p1=-1)),
         "m.plan:4: item 2 makes -1 turns (give 0 or more; a negative radius turns counter-clockwise)"),
        (plan(at(), numbers(18, p1=1, p3=-1e9)),
         "m.plan:4: item 2 has the loiter radius -1e+09 m (give at most 10000 m)"),
        (plan(at(), numbers(31, p2=1e9)), "m.plan:4: item 2 has the loiter radius 1e+09 m (give at most 10000 m)"),
        (plan(at(), numbers(178, p2=-5, frame=2)),
         "m.plan:4: item 2 changes the speed to -5 m/s (give 0 to 340 m/s, or -1 to leave it as it is)"),
        (plan(at(), numbers(178, p2=1e6, frame=2)),
         "m.plan:4: item 2 changes the speed to 1e+06 m/s (give 0 to 340 m/s, or -1 to leave it as it is)"),
        (plan(at(), item(frame=1)),
         "m.plan:4: item 2 has the coordinate frame 1, which missions do not use"
         " (known: 0 above sea level, 3 above home, 10 above terrain, 2 no position)"),
        (plan(item(frame=2)),
         "m.plan:3: item 1 (waypoint) has the frame 2, which carries no position (use 3: altitude above home)"),
        (plan(at(), item(177, frame=2, params=[7, 1, 0, 0, 0, 0, 0], jump_id=2)),
         "m.plan:4: item 2 jumps to the item with doJumpId 7, which does not exist"),
        (plan(at(), item(params=[0, 0])), "m.plan:4: item 2: params must be a list of 7 numbers, found 2"),
        (plan(at("47")), "m.plan:3: item 1: param 5 must be a number or null, not '47'"),
        (plan(item(frame="3")), "m.plan:3: item 1: frame must be a whole number from 0 to 65535, not '3'"),
        (plan(item(command=99999)), "m.plan:3: item 1: command must be a whole number from 0 to 65535, not 99999"),
        (plan({"type": "SimplItem"}),
         "m.plan:3: item 1 is not a SimpleItem or ComplexItem (did you mean 'SimpleItem'?)"),
        (plan(at(), {"type": "ComplexItem", "complexItemType": "StructureScan"}),
         "m.plan:4: item 2 is a complex item of type 'StructureScan', which cannot be expanded"
         " (surveys and corridor scans can)"),
        (plan(at(), {"type": "ComplexItem", "complexItemType": "survey", "TransectStyleComplexItem": {"Items": []}}),
         "m.plan:4: item 2 (survey) holds no computed items (save it again in QGroundControl)"),
        (plan(at(), plannedHomePosition=[1, 2]),
         "m.plan:2: plannedHomePosition must be latitude, longitude and altitude"),
        ('{"fileType": "GeoFence"}', "m.plan:1: is not a QGroundControl plan but a 'GeoFence' file"),
        ("[1]", 'm.plan:1: is not a QGroundControl plan: it has no "fileType": "Plan"'),
        ('{"fileType": "Plan"}', 'm.plan:1: has no "mission"'),
        ("", "m.plan: is empty"),
        ('{"a": 1,\n', "m.plan:2: is not valid JSON: Expecting property name enclosed in double quotes"),
    ],
)  # fmt: skip
def test_every_mistake_in_a_plan_is_named_with_its_line(text: str, problem: str) -> None:
    assert refused(text) == [problem]


def test_all_problems_at_once() -> None:
    assert [p.split(":")[1] for p in refused(plan(at(91), at(), at(altitude=-3), at(None, None)))] == [
        "3",
        "5",
        "6",
        "6",
    ]


def test_a_line_of_its_own_for_every_param() -> None:
    pretty = json.dumps(json.loads(plan(at(), at(95))), indent=1)
    line = next(n for n, text in enumerate(pretty.splitlines(), start=1) if "95" in text and "8.5" not in text)
    assert refused(pretty)[0].startswith(f"m.plan:{line}: item 2 (waypoint) has the latitude 95")


def test_ten_thousand_items_get_one_clear_message() -> None:
    message = "has 10000 items, more than the 2000 that are accepted (split the mission)"
    assert refused(plan(*[at(95)] * 10_000)) == [f"m.plan: {message}"]
    assert refused(rows(*[ROW] * 10_000), "m.waypoints") == [f"m.waypoints: {message}"]


def test_missing_unknown_and_binary_files() -> None:
    with pytest.raises(ConfigError, match=r"gone.plan: no such file"):
        load_mission(Path("gone.plan"))
    with pytest.raises(ConfigError, match=r"known: \.plan, \.waypoints"):
        load("x", "m.kml")
    Path("b.plan").write_bytes(bytes(range(256)))
    with pytest.raises(ConfigError, match=r"b.plan:\d+: is (not text|a binary)"):
        load_mission(Path("b.plan"))


ROW = (0, 3, 16, 0.0, 0.0, 0.0, 0.0, 47.3978, 8.5456, 10.0, 1)  # without the index


def rows(*given: tuple[Any, ...]) -> str:
    return "QGC WPL 110\n" + "".join(f"{i}\t" + "\t".join(str(v) for v in row) + "\n" for i, row in enumerate(given))


def changed(column: int, value: Any) -> tuple[Any, ...]:
    row = list(ROW)
    row[column] = value
    return tuple(row)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "m.waypoints: is empty"),
        ("QGC WPL 100\n", "m.waypoints:1: must begin with \"QGC WPL 110\", not 'QGC WPL 100'"),
        ("QGC WPL 110\n", "m.waypoints: has no waypoints: its list of items is empty"
         " (a mission needs at least one place to fly to)"),
        (rows(ROW, changed(7, "nan")), "m.waypoints:3: latitude is not finite: nan"),
        (rows(ROW, changed(9, "inf")), "m.waypoints:3: altitude is not finite: inf"),
        (rows(ROW, changed(9, 6000)),
         "m.waypoints:3: item 1 (waypoint) cannot be reached: 6000 m above home, more than 5000 m"),
        (rows(ROW, changed(3, "x")), "m.waypoints:3: param 1 must be a number, not 'x'"),
        (rows(ROW, changed(1, 2.5)), "m.waypoints:3: frame must be a whole number from 0, not 2.5"),
        (rows(ROW, ROW[:-1]),
         "m.waypoints:3: has 11 columns instead of the 12 of a mission item (index, current, frame,"
         " command, param 1, param 2, param 3, param 4, latitude, longitude, altitude, autocontinue)"),
        (rows(ROW, ROW).replace("\n1\t", "\n5\t"),
         "m.waypoints:3: has the index 5 where 1 is expected (items count from 0 without gaps)"),
        (rows(ROW, (0, 2, 177, 9.0, 1.0, 0, 0, 0, 0, 0, 1)),
         "m.waypoints:3: item 1 jumps to an item that does not exist"),
    ],
)  # fmt: skip
def test_every_mistake_in_a_waypoints_file_is_named_with_its_line(text: str, problem: str) -> None:
    assert refused(text, "m.waypoints") == [problem]


def test_a_first_waypoint_above_sea_level_is_home_and_jumps_move_with_it() -> None:
    home = (1, 0, 16, 0, 0, 0, 0, *SITE, 1)
    mission = load(rows(home, ROW, ROW, (0, 2, 177, 1, 2, 0, 0, 0, 0, 0, 1)), "m.waypoints")
    assert mission.planned_home == SITE
    assert [i.command for i in mission.items] == [16, 16, 177]
    assert mission.items[2].param1 == 0.0


FINITE = st.floats(-1e6, 1e6, allow_nan=False)
PLACE = st.tuples(st.integers(-2000, 2000), st.integers(-2000, 2000), st.floats(0, 500))
POSITIVE = st.floats(0, 1e6)  # times and acceptance radii
ITEMS = st.lists(st.tuples(st.tuples(POSITIVE, POSITIVE, FINITE, FINITE), PLACE), min_size=1, max_size=8)


@given(ITEMS)
def test_both_formats_carry_the_same_mission(drawn: list[Any]) -> None:
    entries, table = [], []
    for params, (north, east, up) in drawn:
        latitude, longitude = 47.397742 + north * 1e-7, 8.545594 + east * 1e-7
        entries.append(item(params=[*params, latitude, longitude, up]))
        table.append((0, 3, 16, *(repr(p) for p in params), f"{latitude:.9f}", f"{longitude:.9f}", repr(up), 1))
    Path("h.plan").write_text(plan(*entries))
    first = load_mission(Path("h.plan"), site=SITE)
    second = parse_waypoints(rows(*table), Path("h.waypoints"), site=SITE)
    assert first.items == second.items
    assert [i.lat_degE7 for i in first.items] == [473977420 + north for _, (north, _, _) in drawn]


@given(st.data())
def test_a_damaged_plan_is_a_mission_or_a_config_error(data: st.DataObject) -> None:
    whole = json.loads((MISSIONS / "rectangle.plan").read_text())
    broken = copy.deepcopy(whole)
    here, key = broken, "mission"
    for _ in range(data.draw(st.integers(0, 4))):
        inner = here[key]
        if not isinstance(inner, dict | list) or not inner:
            break
        here = inner
        key = data.draw(st.sampled_from(sorted(here) if isinstance(here, dict) else list(range(len(here)))))
    here[key] = data.draw(st.sampled_from([None, True, -1, 10**30, 1e300, math.nan, "x", [], {}, [[]], {"type": 1}]))
    Path("d.plan").write_text(json.dumps(broken))
    with contextlib.suppress(ConfigError):
        load_mission(Path("d.plan"), site=SITE)


def jump(target: Any, times: Any, jump_id: int) -> dict[str, Any]:
    return item(177, frame=2, params=[target, times, 0, 0, 0, 0, 0], jump_id=jump_id)


def test_endless_jumps_without_a_place_are_refused_and_those_round_a_place_are_not() -> None:
    self_jump = refused(plan(item(jump_id=1), jump(2, -1, 2), item(21, jump_id=3)))
    assert [p.partition(": the")[0] for p in self_jump] == ["m.plan:4: item 2"]
    assert "never ends" in self_jump[0]
    two = refused(plan(item(jump_id=1), jump(3, -1, 2), jump(2, -1, 3)))
    assert [p.partition(": the")[0] for p in two] == ["m.plan:4: item 2", "m.plan:5: item 3"]
    assert len(refused(plan(item(jump_id=1), jump(3, 2, 2), jump(2, -1, 3)))) == 1
    assert len(load(plan(item(jump_id=1), jump(1, -1, 2), item(21, jump_id=3))).items) == 3
    assert len(load(plan(item(jump_id=1), jump(2, 3, 2))).items) == 2


@pytest.mark.parametrize("number", ["9" * 400, str(10**400), "-" + "9" * 400])
def test_whole_numbers_beyond_every_float_are_problems(number: str) -> None:
    text = plan(item(), item(command=16)).replace("47.3978", number, 1)
    assert "m.plan:3: item 1: param 5 is not finite" in refused(text)[0]
    home = plan(item(), plannedHomePosition=[1, 2, 3]).replace("[1, 2, 3]", f"[{number}, 2, 3]")
    assert refused(home) == ["m.plan:2: plannedHomePosition must be latitude, longitude and altitude"]
    assert "m.plan:4: item 2: param 1" in refused(plan(item(), jump(7, 1, 2)).replace("[7,", f"[{number},"))[0]
    assert len(max(refused(text), key=len)) < 200


def test_planned_homes_off_the_globe() -> None:
    assert refused(plan(item(), plannedHomePosition=[True, 2, 3]))
    assert refused(plan(item(), plannedHomePosition=[999, 2, 3]))
    lines = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t999\t8.5\t488\t1\n1\t0\t3\t16\t0\t0\t0\t0\t47.3978\t8.5456\t10\t1\n"
    assert refused(lines, "m.waypoints") == ["m.waypoints:2: the planned home is not on the globe"]


@pytest.mark.parametrize("column", ["1_0", "2_2", "\uff11", "0x1", "1e", "."])
def test_columns_are_plain_numbers(column: str) -> None:
    line = f"0\t1\t3\t16\t0\t0\t0\t0\t47.3978\t8.5456\t{column}\t1"
    assert refused(f"QGC WPL 110\n{line}\n", "m.waypoints") == [
        f"m.waypoints:2: altitude must be a number, not {column!r}"
    ]
