"""Verdicts on searches: visible people, found people, position errors, false objects."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.apps.view.command import load_frames
from hil.config import load_bench
from hil.config.schema import Search
from hil.run.verdict.search import PersonResult, SearchMeasurement, SearchResult, assign_objects, judge_search
from hil.run.verdict.true_people import TruePeople, visible_px
from signals.detections import Detections, FoundObject
from signals.errors import ConfigError
from sim.frame.mount import quaternion_of_rpy
from tests.worlds.mjcf_world import truth_at

ROOT = Path(__file__).resolve().parents[5]
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def frames() -> Any:
    _, _, frames = load_frames("radar_range", None)
    yield frames
    frames.close()


@pytest.fixture(scope="module")
def camera() -> Any:
    return load_bench(
        ROOT / "rigs" / "people_search.yaml", settings=["sensors.front.mount_rpy_deg=[0, 0, 0]"]
    ).config.sensors["front"]


def found(number: int, x: float, y: float, *, t_s: float = 0.0, sightings: int = 5) -> FoundObject:
    return FoundObject(number, "person", round(t_s * SECOND), (x, y, 0.0), (0.0, 0.0, 0.0), sightings, 0.3)


def _looking(t_ns: int, turn_deg: float, *, up_m: float = 1.2) -> Any:
    return truth_at(t_ns, p_WB=(0.0, 0.0, up_m), q_WB=quaternion_of_rpy((0.0, 0.0, turn_deg)))


class Standing(SimpleNamespace):
    """People who stand still."""

    def position_m(self, person: Any, t_ns: int) -> tuple[float, float]:
        return person


def test_each_person_gets_the_nearest_object_and_the_rest_are_doubles_or_false() -> None:
    people = Standing(people=[(0.0, 0.0), (3.0, 0.0), (50.0, 0.0)])
    objects = [
        found(0, 0.5, 0.0),
        found(1, 2.0, 0.0, sightings=3),
        found(2, 3.2, 0.0, sightings=9),
        found(3, 20.0, 0.0),
    ]
    near, wrong = assign_objects(objects, people, 4.0)  # type: ignore[arg-type]
    assert [one.number for _, one in near[0]] == [0]
    assert [one.number for _, one in near[1]] == [2, 1]  # most sightings first
    assert 2 not in near
    assert [one.number for one in wrong] == [3]
    # Two beside one person do not take the other's object away.
    near, wrong = assign_objects([found(0, 1.4, 0.0), found(1, 1.3, 0.0)], people, 4.0)  # type: ignore[arg-type]
    assert {k: [one.number for _, one in mine] for k, mine in near.items()} == {0: [1], 1: [0]}
    assert not wrong


def test_a_walker_has_its_position_of_that_time_and_is_visible_in_front_of_the_camera(frames: Any, camera: Any) -> None:
    people = TruePeople(frames.geometry.world, "person")
    (walker,) = people.people
    for t_s in (0.0, 3.0):
        (x, y, _), radius = frames.geometry.world.map.actors[0].bound(round(t_s * SECOND))
        assert math.dist(people.position_m(walker, round(t_s * SECOND)), (x, y)) < 0.3 * radius
    east, north = people.position_m(walker, 0)
    ahead = math.degrees(math.atan2(north, east))
    looks = [_looking(0, ahead + turn) for turn in (0.0, 180.0)]
    counts = visible_px(frames, camera, people.people, looks)
    assert counts[0, 0] > 500
    assert counts[1, 0] == 0
    assert TruePeople(frames.geometry.world, "no such thing").people == ()


def test_a_flight_past_a_person_is_measured_and_written(frames: Any, camera: Any, tmp_path: Path) -> None:
    search = Search(visible_samples=3)
    measurement = SearchMeasurement(search, camera)
    people = TruePeople(frames.geometry.world, "person")
    for k in range(600):
        t_ns = 4_000_000 * k
        east, north = people.position_m(people.people[0], t_ns)
        turn_deg = math.degrees(math.atan2(north, east))
        measurement.add(_looking(t_ns, turn_deg, up_m=0.23 if k < 50 else 1.2))
    at = people.position_m(people.people[0], 2 * SECOND)
    objects = (found(0, at[0] + 0.6, at[1], t_s=2.0), found(1, 30.0, 30.0, t_s=2.0))
    measurement.detected("detect", Detections("front/rgb", 0, (4, 3), (), objects))
    measurement.detected("detect", Detections("front/rgb", 0, (4, 3)))  # nothing new
    cars = tuple(found(k, 9.0 * k, 40.0, t_s=2.0)._replace(label="car") for k in range(5))
    measurement.detected("cars", Detections("front/rgb", 0, (4, 3), (), cars))  # more objects, none of them wanted
    measurement.conclude(frames, frames.geometry.world)
    result = measurement.result
    assert (result.client, result.visible, result.found, result.false_objects) == ("detect", 1, 1, 1)
    assert result.people[0].looks == 10  # at 0.2 s, as it took off, and from 0.25 s to 2.25 s
    assert result.error_m == pytest.approx(0.6)
    rows, reasons = measurement.verdict_rows()
    assert [(row.name, row.ok) for row in rows] == [
        ("found_share", True),
        ("search_error_m", True),
        ("worst_search_error_m", True),
        ("false_objects", True),
        ("double_objects", True),
    ]
    assert reasons == []
    measurement.write(tmp_path)
    told = json.loads((tmp_path / "people.json").read_text())
    assert told["people"][0]["error_m"] == pytest.approx(0.6)
    assert told["false"][0]["p_W"] == [30.0, 30.0, 0.0]
    assert (tmp_path / "search.png").read_bytes().startswith(b"\x89PNG")


def test_each_missed_limit_fails_with_a_reason() -> None:
    people = (
        PersonResult("a", True, 9, 300, (0.0, 0.0)),
        PersonResult("b", True, 9, 300, (5.0, 0.0), (9.0, 0.0), 4.0, 1.0, (0,)),
    )
    poor = SearchResult("detect", 2, 1, 0.5, 3.5, 3.5, 4, 1, 6, people)
    limits = Search(max_false=4, count_duplicates=True, max_worst_error_m=1.5, max_doubles=0)
    rows, reasons = judge_search(poor, limits)
    assert [row.ok for row in rows] == [False] * 5
    names = ["found_share", "search_error_m", "worst_search_error_m", "false_objects", "double_objects"]
    assert [reason.split()[0] for reason in reasons] == names
    rows, _ = judge_search(poor, Search(max_false=4, max_doubles=1))
    assert [row.ok for row in rows] == [False, False, True, True, True]  # at the limits, and without one
    _, silent = judge_search(SearchResult(), Search())
    assert "no client sent a list" in silent[0]
    _, empty = judge_search(SearchResult(client="detect"), Search())
    assert "no 'person' was visible" in empty[0]
    assert judge_search(SearchResult(client="detect", visible=1, found=1, found_share=1.0, error_m=np.nan), Search())[1]


def test_more_than_one_false_or_double_object_fails_unless_the_limit_is_null() -> None:
    everybody = SearchResult("detect", 2, 2, 1.0, 0.1, 0.1, false_objects=1, doubles=1, objects=4)
    assert judge_search(everybody, Search())[1] == []
    crowded = replace(everybody, false_objects=2, doubles=2, objects=6)
    assert [reason.split()[0] for reason in judge_search(crowded, Search())[1]] == ["false_objects", "double_objects"]
    assert judge_search(crowded, Search(max_false=None, max_doubles=None))[1] == []


def test_the_shipped_bench_judges_false_and_double_objects_and_the_worst_error() -> None:
    search = load_bench(ROOT / "rigs" / "people_search.yaml").config.search
    assert search is not None
    assert (search.max_false, search.max_doubles, search.max_worst_error_m) == (1, 1, 1.5)


def test_a_bench_that_cannot_judge_a_search_is_refused() -> None:
    with pytest.raises(ConfigError) as told:
        load_bench(ROOT / "rigs" / "people_search.yaml", settings=["search.camera=fromt", "companion.start=[]"])
    text = str(told.value)
    assert "is not a camera of this bench: 'fromt'" in text
    assert "front" in text
    assert "needs a companion that searches" in text
