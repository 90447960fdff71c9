"""Verdicts on flights to a goal; full maps, shortest paths and clearances with known answers."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.apps.view.command import load_frames
from hil.config import load_bench
from hil.config.schema import Goal
from hil.run.verdict.clearance import Clearance, vehicle_radius_m
from hil.run.verdict.goal import GoalMeasurement
from hil.run.verdict.shortest_path import length_m, shortest_path
from hil.run.verdict.true_slice import TrueSlice, true_slice
from signals.errors import ConfigError
from signals.samples import TruthState
from sim.physics.vehicle import Vehicle
from tests.worlds.mjcf_world import truth_at

SCENE = """name: two_boxes
description: "two boxes"
site: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_m: 400.0}
ground_friction: 0.7
gravity_mps2: 9.80665
wind_W_mps: [0.0, 0.0, 0.0]
boxes:
  - {name: hall, center_m: [10.0, 0.0, 5.0], size_m: [4.0, 6.0, 10.0]}
  - {name: low, center_m: [10.0, 8.0, 1.0], size_m: [4.0, 4.0, 2.0]}
"""
R_M = 0.393
ROOT = Path(__file__).resolve().parents[5]


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("scene") / "two_boxes.yaml"
    path.write_text(SCENE)
    _, _, frames = load_frames(str(path), None)
    yield frames
    frames.close()


@pytest.fixture(scope="module")
def x500() -> Vehicle:
    return load_bench(None, settings=["mission=null"]).vehicle


def test_the_sphere_encloses_the_vehicle(x500: Vehicle) -> None:
    assert vehicle_radius_m(x500) == pytest.approx(math.hypot(0.174, 0.174, 0.058131) + 0.127)


def test_a_slice_holds_only_surfaces_at_its_heights(frames: Any) -> None:
    full = true_slice(frames.geometry, low_m=4.5, high_m=5.5, area_W=(-10.0, -15.0, 30.0, 15.0))
    rows, columns = np.nonzero(full.occupied)
    x, y = np.array([full.centre_of(int(r), int(c)) for r, c in zip(rows, columns, strict=True)]).T
    assert x.min() == pytest.approx(8.0, abs=0.25)
    assert x.max() == pytest.approx(12.0, abs=0.25)
    assert y.min() == pytest.approx(-3.0, abs=0.25)
    assert y.max() == pytest.approx(3.0, abs=0.25)
    edge = np.minimum(np.minimum(x - 8.0, 12.0 - x), np.minimum(y + 3.0, 3.0 - y))
    assert np.abs(edge).max() < 0.3  # surfaces only
    low = true_slice(frames.geometry, low_m=1.0, high_m=1.8, area_W=(-10.0, -15.0, 30.0, 15.0))
    assert low.occupied[low.cell_of(8.05, 8.0)]


def around_a_box(clearance_m: float) -> float:
    """Length of the shortest path from (0, 0) to (20, 0) around a box from (8, -3) to (12, 3): tangents and arcs."""
    to_corner = math.hypot(8.0, 3.0)
    tangent = math.sqrt(to_corner**2 - clearance_m**2)
    turn = math.atan2(3.0, 8.0) + math.asin(clearance_m / to_corner)  # direction of the tangent
    return 2.0 * (tangent + clearance_m * turn) + 4.0


@pytest.mark.parametrize("clearance_m", [0.5, 0.9, 2.0])
def test_the_shortest_path_around_a_box(frames: Any, clearance_m: float) -> None:
    full = true_slice(frames.geometry, low_m=4.5, high_m=5.5, area_W=(-10.0, -15.0, 30.0, 15.0))
    found = shortest_path(full, (0.0, 0.0), (20.0, 0.0), clearance_m=clearance_m)
    assert found is not None
    assert length_m(found) == pytest.approx(around_a_box(clearance_m), rel=0.02)


def test_no_path_exists_through_a_wall_or_to_a_goal_off_the_map() -> None:
    occupied = np.zeros((40, 40), np.bool_)
    occupied[:, 20] = True
    full = TrueSlice(occupied, (0.0, 0.0), 0.25)
    assert shortest_path(full, (1.0, 1.0), (9.0, 9.0), clearance_m=0.5) is None
    assert shortest_path(full, (1.0, 1.0), (99.0, 9.0), clearance_m=0.5) is None
    straight = shortest_path(full, (1.0, 1.0), (3.0, 9.0), clearance_m=0.5)
    assert straight == [(1.0, 1.0), (3.0, 9.0)]


@pytest.mark.parametrize(
    ("place", "distance_m"),
    [
        ((6.0, 0.0, 5.0), 2.0),  # a face
        ((7.5, 3.5, 5.0), math.hypot(0.5, 0.5)),  # an edge
        ((7.0, 4.0, 11.0), math.sqrt(3.0)),  # a corner
        ((0.0, 0.0, 1.3), 1.3),  # the ground
        ((-20.0, 0.0, 30.0), 5.0),  # no surface within range
    ],
)
def test_clearance_is_the_distance_to_the_nearest_surface(frames: Any, place: Any, distance_m: float) -> None:
    found = Clearance(frames.geometry).nearest_m(place, 0)
    assert distance_m <= found + 1e-9 <= distance_m * 1.004 + 1e-6


def test_clearance_sees_people_where_they_are_at_the_time() -> None:
    _, _, frames = load_frames("training_village", 1)
    meter = Clearance(frames.geometry)
    actor = frames.geometry.world.map.actors[0]
    for t_ns in (0, 7_000_000_000, 0):
        (x, y, z), radius = actor.bound(t_ns)
        assert meter.nearest_m((x, y, z + radius + 0.5), t_ns) < radius + 0.5
    frames.close()


def flown(measurement: GoalMeasurement, points: Any, *, contact_at: int | None = None, first: int = 0) -> int:
    t_ns = 0
    for k, p in enumerate(points, start=first):
        t_ns = k * 100_000_000
        truth: TruthState = truth_at(t_ns, p_WB=tuple(float(v) for v in p), tick=k)
        measurement.add(truth._replace(in_contact=k == contact_at))
    return t_ns


def path(y_m: float, end_x: float = 20.0) -> np.ndarray:
    corners = np.array([(0, 0, 0.2), (0, 0, 5), (4, y_m, 5), (16, y_m, 5), (end_x, 0, 5)], float)
    parts = [np.linspace(a, b, 80, endpoint=False) for a, b in itertools.pairwise(corners)]
    return np.vstack([*parts, corners[-1:]])


def test_a_good_flight_passes_and_is_measured(frames: Any, x500: Vehicle) -> None:
    measurement = GoalMeasurement(Goal(p_W=(20.0, 0.0, 5.0)), x500)
    t_ns = flown(measurement, path(5.0))
    measurement.reported({"outcome": "flying"}, t_ns - 1)
    measurement.reported({"outcome": "goal", "why": ""}, t_ns)
    flown(measurement, [(50.0, 50.0, 0.0)] * 3, first=1000)  # after the end of the flight: not measured
    measurement.conclude(frames.geometry)
    result = measurement.result
    assert result.goal_error_m == pytest.approx(0.0, abs=1e-6)
    # Along y = 5, from x = 8 to 12, the hall's face is 2 m away.
    assert result.clearance_m == pytest.approx(2.0 - R_M, abs=0.02)
    assert result.path_m == pytest.approx(12.0 + 2.0 * math.hypot(4.0, 5.0), rel=1e-6)
    assert result.shortest_m == pytest.approx(around_a_box(R_M + 0.5), rel=0.02)
    rows, reasons = measurement.verdict_rows()
    assert not reasons
    assert {row.name for row in rows} == {"goal_error_m", "height_error_m", "clearance_m", "path_ratio", "contacts"}
    assert result.height_error_m == 0.0


@pytest.mark.parametrize(
    ("points", "contact", "outcome", "words"),
    [
        (path(5.0, end_x=22.0), None, "goal", "goal_error_m is 2 m"),
        (path(3.5), None, "goal", "clearance_m is 0.1"),
        (path(12.0), None, "goal", "path_ratio is 1.71"),  # 37.30 m over around_a_box's 21.82
        (path(5.0), 200, "goal", "contacts is 1"),
        (path(5.0), None, "stuck", "the client reported the outcome 'stuck' (lost), but the bench expects 'goal'"),
        (path(5.0), None, None, "reported no outcome"),
    ],
)
def test_each_limit_can_fail(frames: Any, x500: Vehicle, points: Any, contact: Any, outcome: Any, words: str) -> None:
    measurement = GoalMeasurement(Goal(p_W=(20.0, 0.0, 5.0)), x500)
    t_ns = flown(measurement, points, contact_at=contact)
    if outcome is not None:
        measurement.reported({"outcome": outcome, "why": "lost" if outcome == "stuck" else ""}, t_ns)
    measurement.conclude(frames.geometry)
    _, reasons = measurement.verdict_rows()
    assert len(reasons) == 1
    assert words in reasons[0]


def test_the_bench_may_expect_another_outcome(frames: Any, x500: Vehicle) -> None:
    measurement = GoalMeasurement(Goal(p_W=(10.0, 0.0, 5.0), outcome="goal_in_obstacle"), x500)
    t_ns = flown(measurement, path(5.0))
    measurement.reported({"outcome": "goal_in_obstacle"}, t_ns)
    measurement.conclude(frames.geometry)
    assert measurement.verdict_rows()[1] == []


@pytest.mark.parametrize(
    ("goal_x_m", "flown_m", "words"),
    [(20.0, 1, "a path of 23"), (20.0, 321, "a path of 23"), (6.0, 1, None), (10.0, 1, None)],  # 6: 2 m from the hall
)
def test_a_goal_in_the_open_lies_in_no_obstacle(
    frames: Any, x500: Vehicle, goal_x_m: float, flown_m: int, words: str | None
) -> None:
    """A client that reported it at once passed."""
    measurement = GoalMeasurement(Goal(p_W=(goal_x_m, 0.0, 5.0), outcome="goal_in_obstacle"), x500)
    measurement.reported({"outcome": "goal_in_obstacle"}, flown(measurement, path(5.0)[:flown_m]))
    measurement.conclude(frames.geometry)
    reasons = measurement.verdict_rows()[1]
    assert len(reasons) == (0 if words is None else 1)
    assert all(words in reason for reason in reasons if words)


def test_a_flight_that_never_began_fails(frames: Any, x500: Vehicle) -> None:
    measurement = GoalMeasurement(Goal(p_W=(20.0, 0.0, 5.0)), x500)
    measurement.conclude(frames.geometry)
    assert len(measurement.verdict_rows()[1]) == 5


@pytest.mark.parametrize(("limit_m", "reasons"), [(2.0, ["height_error_m is 10 m, at most 2 m"]), (None, [])])
def test_a_flight_over_everything_has_found_no_path(
    frames: Any, x500: Vehicle, limit_m: float | None, reasons: list[str]
) -> None:
    """Straight over the hall, whose roof is at 10 m, to a goal at 5 m: it passed, with a path ratio of 0.92."""
    corners = np.array([(0, 0, 0.2), (0, 0, 15), (20, 0, 15)], float)
    over = np.vstack([np.linspace(a, b, 80) for a, b in itertools.pairwise(corners)])
    measurement = GoalMeasurement(Goal(p_W=(20.0, 0.0, 5.0), max_height_error_m=limit_m), x500)
    measurement.reported({"outcome": "goal"}, flown(measurement, over))
    measurement.conclude(frames.geometry)
    assert measurement.verdict_rows()[1] == reasons


def test_a_flight_far_below_its_goal_fails(frames: Any, x500: Vehicle) -> None:
    measurement = GoalMeasurement(Goal(p_W=(20.0, 0.0, 9.0)), x500)
    measurement.reported({"outcome": "goal"}, flown(measurement, path(5.0)))
    measurement.conclude(frames.geometry)
    assert measurement.verdict_rows()[1] == ["height_error_m was never measured, at most 2 m"]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("mission=rigs/missions/rectangle.plan",), "goal cannot go with a mission"),
        (("companion.start=[]", "companion.control=false"), "goal needs a companion"),
        (("goal.p_W=[1, 2]",), "goal.p_W"),
        (("goal.within_m=-1",), "goal.within_m"),
        (("goal.near=1",), "goal.near"),
    ],
)
def test_goals_that_make_no_sense(settings: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_bench(ROOT / "rigs" / "explore.yaml", settings=settings)
    assert any(words in str(problem) for problem in caught.value.problems)


def test_the_shipped_flight_is_a_legal_bench() -> None:
    bench = load_bench(ROOT / "rigs" / "explore.yaml", seed=7, settings=("map_seed=7", "goal.p_W=[40, 60, 5]"))
    assert bench.config.goal == Goal(p_W=(40.0, 60.0, 5.0))
    assert bench.config.companion.settings["flight"]["time_limit_s"] < bench.config.duration_s
