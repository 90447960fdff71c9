"""Whole flights of the explorer in flat worlds of boxes: their outcomes, without any contact."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from tests.worlds.flat_box_world import Box, Flat

CLEAR_M = 0.9  # of the vehicle's centre: vehicle_radius_m + clearance_m


def ring(x: float, y: float, half: float, thick: float = 0.4) -> tuple[Box, ...]:
    """Return four walls about a place."""
    a, b = half, half + thick
    return (
        *((x - b, y - b, x + b, y - a), (x - b, y + a, x + b, y + b)),
        *((x - b, y - b, x - a, y + b), (x + a, y - b, x + b, y + b)),
    )


def test_it_goes_round_a_hall_to_the_goal() -> None:
    boxes = ((6.0, -6.0, 12.0, 5.0), (16.0, 4.0, 17.0, 14.0))
    flat = Flat(boxes, (20.0, 2.0)).fly()
    assert flat.outcome == "goal"
    assert flat.goal_error_m < 0.6
    assert flat.least_m >= CLEAR_M
    assert flat.path_m < 1.35 * 24.0  # 23.9 m: round the hall's corner (6, 5), (12, 5), with 0.9 m to spare
    assert 2.0 < flat.fastest_mps <= 3.1


@pytest.mark.parametrize(
    ("middle_x", "half_m", "goal_x", "outcome"), [(8.0, 2.5, 8.0, "goal_in_obstacle"), (0.0, 5.0, 15.0, "no_path")]
)
def test_walls_without_a_way_through_are_told_apart(
    middle_x: float, half_m: float, goal_x: float, outcome: str
) -> None:
    flat = Flat(ring(middle_x, 0.0, half_m), (goal_x, 0.0)).fly(90.0)
    assert flat.outcome == outcome
    assert flat.explorer.finished
    assert flat.least_m >= CLEAR_M


LOSSES: dict[str, Any] = {
    "none": lambda _points: None,
    "nan": lambda points: np.full_like(points, math.nan),
    "empty": lambda points: points[:0],
    "ranges of zero": np.zeros_like,
}


@pytest.mark.parametrize("loss", LOSSES)
def test_without_a_lidar_it_brakes_at_once_and_says_so(loss: str) -> None:
    def lidar(t_s: float, points: np.ndarray) -> Any:
        return LOSSES[loss](points) if t_s > 2.0 else points

    flat = Flat(((9.0, -4.0, 10.0, 4.0),), (20.0, 0.0), lidar=lidar).fly(40.0)
    assert flat.outcome == "lidar_lost"
    assert flat.explorer.report.retreats == 0
    assert flat.explorer.finished
    assert flat.least_m >= CLEAR_M
    assert float(np.hypot(*flat.v[:2])) < 0.05
    assert flat.p[0] < 2.0 * 3.0 + 5.0


def test_a_vehicle_driven_to_and_fro_is_stuck() -> None:
    """An obstacle that jumps from side to side blocks the passage and drives the vehicle farther than `progress_m`."""
    settings = {"stuck_s": 4.0, "progress_m": 0.3, "no_path_s": 60.0}
    flat = Flat((), (20.0, 0.0), settings=settings)
    for k in range(300):
        side = 1.0 if k // 15 % 2 else -1.0
        x, y = float(flat.p[0]) + 1.1 * side, float(flat.p[1])
        flat.boxes = ((x - 0.1, y - 3.0, x + 0.1, y + 3.0),)
        flat.step()
        if flat.outcome != "flying":
            break
    assert flat.outcome == "stuck"
    assert "to and fro" in flat.explorer.report.why


def test_a_stuck_lidar_counts_as_lost() -> None:
    """Timestamps advance, points do not: the wall ahead would seem to keep its distance."""
    hung: list[np.ndarray] = []

    def hang(t_s: float, points: np.ndarray) -> np.ndarray:
        hung.extend([points] if t_s > 2.0 and not hung else [])
        return hung[0] if hung else points

    flat = Flat(((14.0, -9.0, 15.0, 9.0),), (20.0, 0.0), lidar=hang).fly(20.0)
    assert flat.outcome == "lidar_lost"
    assert flat.least_m >= CLEAR_M


@pytest.mark.parametrize(("lost_s", "lowest_m", "highest_m"), [(0.0, 0.2 - 1e-7, 0.2 + 1e-7), (1.5, 0.5, 3.0)])
def test_a_lidar_lost_in_the_climb_ends_it_at_that_height(lost_s: float, lowest_m: float, highest_m: float) -> None:
    flat = Flat((), (20.0, 0.0), lidar=lambda t_s, points: points if t_s < lost_s else None)
    flat.p[2] = 0.2
    flat.fly(12.0)
    assert flat.outcome == "lidar_lost"
    assert flat.explorer.finished
    assert lowest_m < flat.p[2] < highest_m


def test_not_knowing_what_is_level_it_hovers_and_then_says_so() -> None:
    for back_s, outcome in ((4.0, "goal"), (1e9, "imu_lost")):
        flat = Flat((), (9.0, 0.0), settings={"imu_lost_s": 3.0})
        known = flat.localiser.update

        def update(frame: Any, known: Any = known, back_s: float = back_s) -> Any:
            return dataclasses.replace(known(frame), imu_ok=not 2.0 < frame.t_ns * 1e-9 < back_s)

        flat.localiser.update = update
        for _ in range(38):
            flat.step()
        assert float(np.hypot(*flat.v[:2])) < 0.2
        assert flat.outcome == "flying"
        assert flat.fly(30.0).outcome == outcome


@pytest.mark.parametrize(
    ("wrong", "why"),
    [({"v_W": np.array([18.0, 0.0, 0.0])}, ""), ({"p_W": np.array([math.nan, 0.0, 5.0])}, "position")],
)
def test_an_estimate_that_flies_away_or_is_no_place_stops_it(wrong: dict[str, np.ndarray], why: str) -> None:
    flat = Flat((), (25.0, 0.0), settings={"stuck_s": 3.0})
    for _ in range(20):
        flat.step()
    assert flat.fastest_mps > 1.0
    known = flat.localiser.update
    flat.localiser.update = lambda frame: dataclasses.replace(known(frame), **wrong)
    flat.fly(10.0)
    assert flat.outcome == "stuck"
    assert why in flat.explorer.report.why
    assert float(np.hypot(*flat.v[:2])) < 0.05


def test_an_older_frame_changes_nothing() -> None:
    one, other = Flat((), (8.0, 0.0)), Flat((), (8.0, 0.0))
    for k in range(25):
        wanted = one.step()
        if k % 3 == 2:
            other.explorer.step(other.frame(k - 2))
        assert other.step() == wanted


def test_nan_points_are_ignored() -> None:
    def some(t_s: float, points: np.ndarray) -> np.ndarray:
        spoiled = points.copy()
        spoiled[:: 2 + round(10 * t_s) % 2] = math.nan
        return spoiled

    flat = Flat(((5.0, -4.0, 6.0, 3.0),), (10.0, 0.0), lidar=some).fly()
    assert flat.outcome == "goal"
    assert flat.least_m >= CLEAR_M


def test_a_lidar_that_comes_back_is_flown_on_with() -> None:
    def gap(t_s: float, points: np.ndarray) -> np.ndarray | None:
        return None if 2.0 < t_s < 3.5 else points

    flat = Flat((), (12.0, 0.0), lidar=gap).fly()
    assert flat.outcome == "goal"


def test_a_goal_beyond_every_map_is_no_path() -> None:
    flat = Flat((), (1e5, 0.0)).fly(5.0)
    assert flat.outcome == "no_path"
    assert flat.frames < 20


def test_the_vehicle_retreats_from_an_approaching_object() -> None:
    """A box approaches the hovering vehicle, which waits for its path to open."""
    flat = Flat(ring(0.0, 0.0, 9.0), (15.0, 0.0), settings={"no_path_s": 30.0})
    for k in range(60):
        x = 5.0 - 0.07 * k  # from 5 m to 0.9 m off
        flat.boxes = (*ring(0.0, 0.0, 9.0), (x, -0.4, x + 0.8, 0.4))
        flat.step()
        assert min(math.hypot(max(x - flat.p[0], 0.0), max(abs(flat.p[1]) - 0.4, 0.0)), 9.0) > CLEAR_M
    assert flat.explorer.report.retreats >= 1


def test_the_same_frames_give_the_same_flight() -> None:
    def track() -> list[float]:
        flat = Flat(((4.0, -3.0, 5.0, 2.0),), (8.0, 0.0))
        return [float(v) for _ in range(25) for v in flat.step().v_W]

    assert track() == track()
