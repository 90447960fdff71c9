"""Planning maps from occupancy grids: walls, moving people, distances, prices, straightened routes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.worlds.scripted_bench import CLIENT

from hil_companion.explore.mapping.maps import GridView  # isort: skip
from hil_companion.explore.planning.plan_map import SURE, clearances_for, clean, distances_m, prices, sigma_m  # isort: skip
from hil_companion.explore.planning.moving import MovingObstacles  # isort: skip
from hil_companion.explore.planning.plan_map import PlanMap, make_map  # isort: skip
from hil_companion.explore.planning.route import Router, path_cost  # isort: skip
from hil_companion.explore.planning.flight_settings import FlightSettings  # isort: skip

assert CLIENT
CELL_M = 0.25
FLIGHT = FlightSettings()
NOBODY = np.zeros((0, 2))


def walled(holes: tuple[int, ...] = ()) -> np.ndarray:
    """Return free space with a wall along row 40."""
    odds = np.full((80, 80), -1.0, np.float32)
    odds[40, 10:70] = 2.0
    for column in holes:
        odds[40, column] = 0.0
    return odds


def test_gaps_in_a_wall_close_and_doubtful_specks_go() -> None:
    odds = walled(holes=(25, 26, 50))
    odds[10, 10] = 1.0  # seen once, alone
    odds[20, 20] = SURE + 1.0  # a pole
    odds[41, 30] = 1.0  # beside the wall
    occupied, segments = clean(odds, CELL_M)
    assert len(segments) >= 1
    assert occupied[40, 10:70].all()
    assert not occupied[10, 10]
    assert occupied[20, 20]
    assert occupied[41, 30]
    assert occupied.sum() <= 60 + 2 + 12  # nothing grew


def test_a_door_that_beams_went_through_stays_open() -> None:
    odds = walled()
    odds[40, 38:42] = -3.0
    occupied, _ = clean(odds, CELL_M)
    assert not occupied[40, 38:42].any()


def test_a_passer_by_leaves_nothing_behind_and_a_wall_does_not_walk() -> None:
    moving = MovingObstacles(keep_s=1.0, settle_s=8.0)
    odds = np.full((60, 60), -2.0, np.float32)
    odds[50, :] = 5.0  # static from the beginning, at the largest log-odds

    def vacated(t_s: float, seen: Any) -> np.ndarray:
        return moving.vacated(GridView(odds.copy(), (0.0, 0.0), CELL_M, round(10 * t_s)), np.asarray(seen, float), t_s)

    assert not vacated(0.0, NOBODY).any()
    for k in range(20):  # a person walks along row 20, a cell every 0.1 s; no beam clears the cells
        odds[20, 10 + k] = 2.0
        here = [((10 + k + 0.5) * CELL_M, 20.5 * CELL_M)]
        out = vacated(0.1 * (k + 1), here)
        assert not out[20, 10 + k]
        assert not out[50].any()
    assert out[20, 10:16].all()  # the trail of more than a second ago
    assert not out[20, 20:].any()
    stays = here
    for k in range(100):  # it stands still and becomes static
        out = vacated(2.1 + 0.1 * k, stays)
        assert not out[20, 29]
    assert not vacated(30.0, NOBODY)[20, 29]


def test_what_moved_is_known_though_the_grid_has_grown() -> None:
    moving = MovingObstacles(keep_s=1.0)
    odds = np.full((40, 40), -2.0, np.float32)
    moving.vacated(GridView(odds.copy(), (0.0, 0.0), CELL_M, 0), NOBODY, 0.0)
    odds[20, 10] = 2.0
    moving.vacated(GridView(odds.copy(), (0.0, 0.0), CELL_M, 1), NOBODY, 0.1)
    grown = np.zeros((60, 64), np.float32)
    grown[12:52, 16:56] = odds
    grown[5, 5] = 2.0  # a cell that was unknown before is not a moving obstacle
    out = moving.vacated(GridView(grown, (-16 * CELL_M, -12 * CELL_M), CELL_M, 2), NOBODY, 2.0)
    assert np.argwhere(out).tolist() == [[32, 26]]
    out = moving.vacated(GridView(odds.copy(), (0.0, 0.0), CELL_M, 3), NOBODY, 2.1)  # and shrunk
    assert np.argwhere(out).tolist() == [[20, 10]]


def test_a_wall_that_beams_had_missed_is_no_passer_by() -> None:
    moving = MovingObstacles(keep_s=0.5, settle_s=8.0)
    odds = np.full((40, 40), -2.0, np.float32)
    odds[20, 5:15] = 3.0
    moving.vacated(GridView(odds.copy(), (0.0, 0.0), CELL_M, 0), NOBODY, 0.0)
    odds[20, 15:17] = 3.0
    moving.vacated(GridView(odds.copy(), (0.0, 0.0), CELL_M, 1), NOBODY, 0.1)
    assert not moving.vacated(GridView(odds.copy(), (0.0, 0.0), CELL_M, 2), NOBODY, 3.0)[20, 15]


def test_the_distance_kept_grows_with_size_speed_and_uncertainty() -> None:
    plain = clearances_for(FLIGHT, 0.0, CELL_M)
    assert plain.red_m < plain.orange_m <= plain.hard_m < plain.comfort_m
    assert plain.red_m >= FLIGHT.vehicle_radius_m + FLIGHT.clearance_m
    assert clearances_for(FLIGHT, 0.2, CELL_M).hard_m == pytest.approx(plain.hard_m + 0.4)
    assert clearances_for(FlightSettings(speed_mps=6.0), 0.0, CELL_M).comfort_m > plain.comfort_m
    assert clearances_for(FlightSettings(vehicle_radius_m=1.0), 0.0, CELL_M).hard_m == pytest.approx(plain.hard_m + 0.6)
    assert math.isfinite(clearances_for(FLIGHT, math.inf, CELL_M).hard_m)


def test_sigma_is_the_larger_half_axis() -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    assert sigma_m(turn @ np.diag([0.04, 0.25]) @ turn.T) == pytest.approx(0.5)
    assert sigma_m(np.full((2, 2), math.nan)) == math.inf


def test_distances_and_prices() -> None:
    occupied = np.zeros((40, 40), bool)
    occupied[20, 20] = True
    distance = distances_m(occupied, CELL_M)
    rows, columns = np.mgrid[:40, :40]
    cells = np.sqrt((rows - 20.0) ** 2 + (columns - 20.0) ** 2).astype(np.float32)
    np.testing.assert_array_equal(distance, cells * np.float32(CELL_M))  # the same bits by whatever OpenCV took
    clearances = clearances_for(FLIGHT, 0.0, CELL_M)
    price = prices(distance, np.zeros_like(distance), clearances, 0.4)
    assert np.isinf(price[distance < clearances.hard_m - 0.2]).all()
    assert (price[distance > clearances.comfort_m + 0.2] == 1.0).all()
    np.testing.assert_allclose(
        prices(distance, np.ones_like(distance), clearances, 0.4)[distance > 4.0], 1.4, rtol=1e-6
    )


def made(odds: np.ndarray, start: tuple[float, float], goal: tuple[float, float]) -> PlanMap:
    grid = GridView(odds, (0.0, 0.0), CELL_M, 0)
    clearances = clearances_for(FLIGHT, 0.0, CELL_M)
    return make_map(grid, np.zeros(odds.shape, bool), NOBODY, (start, goal), clearances, 0.4)


def test_a_way_in_the_open_is_straight_and_one_round_a_wall_is_short() -> None:
    clearances = clearances_for(FLIGHT, 0.0, CELL_M)
    start, goal = np.array([3.0, 3.0]), (17.0, 18.0)
    odds = np.full((80, 80), -1.0, np.float32)
    route = Router(0.0).route(made(odds, (3.0, 3.0), goal), clearances, start, goal)
    assert len(route.points_W) == 2
    odds[40, 20:] = 3.0  # from x = 5 on, at y = 10
    for row in range(40, 120 - 40):
        odds[row - 0, 79] = 3.0
    place = made(odds, (3.0, 3.0), goal)
    route = Router(0.0).route(place, clearances, start, goal)
    assert route.found
    assert math.isfinite(path_cost(place, route.points_W))
    tip = np.array([5.0, 10.125])
    direct = math.dist(start, tip) + math.dist(tip, goal)
    assert direct < np.hypot(*np.diff(route.points_W, axis=0).T).sum() < direct + 2.0 * clearances.comfort_m
    for a, b in zip(route.points_W, route.points_W[1:], strict=False):
        rows, columns = place.fine(a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a))
        assert (place.distance_m[rows, columns] > clearances.red_m).all()


def test_of_two_like_ways_the_one_being_flown_is_kept() -> None:
    clearances = clearances_for(FLIGHT, 0.0, CELL_M)
    odds = np.full((160, 160), -1.0, np.float32)
    odds[60:100, 76:84] = 3.0  # in the middle of the route
    router, goal = Router(0.0), (35.0, 20.0)
    sides = []
    for k in range(12):
        start = np.array([3.0 + 0.3 * k, 20.0 + (0.4 if k % 2 else -0.4)])
        route = router.route(made(odds, (float(start[0]), float(start[1])), goal), clearances, start, goal)
        sides.append(np.sign(route.points_W[1:-1, 1].mean() - 20.0))
    assert len(set(sides)) == 1


def test_causes_of_a_blocked_goal_are_distinguished() -> None:
    clearances = clearances_for(FLIGHT, 0.0, CELL_M)
    odds = np.full((240, 240), -1.0, np.float32)
    odds[120:161, 120:161] = 3.0
    odds[122:159, 122:159] = 0.0  # a building with an unknown inside

    def why(start: tuple[float, float], goal: tuple[float, float], move_m: float = 0.0) -> str:
        return Router(move_m).route(made(odds, start, goal), clearances, np.array(start), goal).why

    assert why((5.0, 5.0), (35.0, 35.0)) == "goal_in_obstacle"  # in its middle
    assert why((5.0, 5.0), (30.3, 35.0)) == "goal_in_obstacle"  # in its wall
    assert why((35.0, 35.0), (5.0, 5.0)) == "no_path"
    assert why((5.0, 5.0), (29.5, 35.0)) == "goal_in_obstacle"  # too near to the wall
    assert why((5.0, 5.0), (29.5, 35.0), move_m=2.0) == ""
