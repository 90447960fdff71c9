"""A* against an exact reference on small grids, which relaxes every cell's cost until none gets cheaper."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.worlds.scripted_bench import CLIENT

from hil_companion.explore.planning.astar import Cell, connected, plan, search  # isort: skip
import itertools

assert CLIENT


def reference(price: np.ndarray, start: Cell, goal: Cell) -> float:
    """Reference costs by Bellman-Ford, without heap or heuristic."""
    height, width = price.shape
    cost = np.full(price.shape, np.inf)
    cost[start] = 0.0
    free = np.isfinite(price)
    changed = True
    while changed:
        changed = False
        for r in range(height):
            for c in range(width):
                for dr in (-1, 0, 1):
                    for dc in (-1, 0, 1):
                        a, b = r + dr, c + dc
                        if (dr or dc) and free[r, c] and 0 <= a < height and 0 <= b < width and free[a, b]:
                            if dr and dc and not (free[r, b] and free[a, c]):
                                continue
                            through = cost[r, c] + math.hypot(dr, dc) * 0.5 * (price[r, c] + price[a, b])
                            if through < cost[a, b] - 1e-12:
                                cost[a, b] = through
                                changed = True
    return float(cost[goal])


def cost_of(price: np.ndarray, cells: list[Cell]) -> float:
    return sum(math.hypot(b[0] - a[0], b[1] - a[1]) * 0.5 * (price[a] + price[b]) for a, b in itertools.pairwise(cells))


@settings(max_examples=40)
@given(st.integers(0, 10_000), st.floats(0.0, 0.5))
def test_a_path_is_the_cheapest_there_is(seed: int, blocked: float) -> None:
    rng = np.random.default_rng(seed)
    price = 1.0 + 2.0 * rng.random((9, 11))
    price[rng.random(price.shape) < blocked] = np.inf
    start, goal = (0, 0), (8, 10)
    price[start] = price[goal] = 1.0
    exact, found = reference(price, start, goal), search(price, start, goal)
    assert (found is None) == (exact == math.inf) == (not connected(price, start, goal))
    if found is not None:
        cells, cost = found
        assert cells[0] == start
        assert cells[-1] == goal
        assert cost == pytest.approx(cost_of(price, cells))
        assert exact - 1e-9 <= cost <= 1.0002 * exact


def test_nothing_is_passed_by_its_corner() -> None:
    price = np.ones((3, 3))
    price[0, 1] = price[1, 0] = np.inf
    assert search(price, (0, 0), (2, 2)) is None
    price[1, 0] = 1.0
    found = search(price, (0, 0), (2, 2))
    assert found is not None
    assert (1, 0) in found[0]


def test_two_levels_find_what_one_does() -> None:
    rng = np.random.default_rng(3)
    ways = 0
    for _ in range(14):
        price = 1.0 + 0.2 * rng.random((83, 90))
        for _ in range(14):
            r, c = rng.integers(4, 78, 2)
            h, w = (2, int(rng.integers(5, 50))) if rng.random() < 0.5 else (int(rng.integers(5, 50)), 2)
            price[r : r + h, c : c + w] = np.inf
        start, goal = (1, 1), (80, 86)
        price[start] = price[goal] = 1.0
        whole, two = search(price, start, goal), plan(price, start, goal)
        assert (whole is None) == (two is None)
        if whole is not None and two is not None:
            ways += 1
            assert cost_of(price, two) <= 1.03 * whole[1]
    assert ways > 5


def test_a_gap_of_one_cell_is_found_through_the_coarse_level() -> None:
    price = np.ones((64, 64))
    price[:, 30] = np.inf
    assert plan(price, (10, 5), (10, 60)) is None
    price[57, 30] = 1.0
    cells = plan(price, (10, 5), (10, 60))
    assert cells is not None
    assert (57, 30) in cells


def test_ends_off_the_grid_have_no_way() -> None:
    assert search(np.ones((4, 4)), (0, 0), (4, 0)) is None
    assert plan(np.ones((4, 4)), (-1, 0), (2, 2)) is None
