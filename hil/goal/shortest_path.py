"""The shortest way through a place whose map is known: what a flight through the unknown is compared with.

The explorer's own A* (`hil_companion.explore.astar`) over cells that are at least `berth_m` from anything, all at one
price, then pulled straight between cells that see each other.
What is found is no shorter than the shortest way, and seldom more than a per cent longer.
"""

from __future__ import annotations

import math
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.companion.started import use_client
from hil.goal.true_slice import TrueSlice

Point = tuple[float, float]


def shortest_path(place: TrueSlice, start_W: Point, goal_W: Point, *, berth_m: float) -> list[Point] | None:
    """Points from start to goal; None where there is no way. Both ends count as free where they are."""
    use_client()
    from hil_companion.explore.astar import connected, search

    free = _free(place, berth_m)
    start, goal = place.cell_of(*start_W), place.cell_of(*goal_W)
    if not (place.inside(*start) and place.inside(*goal)):
        return None
    free[start] = free[goal] = True
    price = np.where(free, 1.0, np.inf)
    found = search(price, start, goal) if connected(price, start, goal) else None
    if found is None:
        return None
    points = [start_W, *(place.centre_of(*cell) for cell in found[0][1:-1]), goal_W]
    return min((_pulled(place, free, points), _pulled(place, free, points[::-1])[::-1]), key=length_m)


def length_m(points: list[Point]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(points))


def _free(place: TrueSlice, berth_m: float) -> NDArray[np.bool_]:
    if not place.occupied.any():
        return np.ones(place.occupied.shape, np.bool_)
    clear = np.where(place.occupied, 0, 1).astype(np.uint8)
    # Surfaces lie anywhere in their cells: on the average half a cell nearer than the cell's middle tells.
    distance = cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * place.cell_m
    return np.asarray(distance >= berth_m, np.bool_)


def _pulled(place: TrueSlice, free: NDArray[np.bool_], points: list[Point]) -> list[Point]:
    """Without the points between two that see each other; the farthest that is seen each time."""
    kept, here = [points[0]], 0
    while here < len(points) - 1:
        there = here + 1
        for candidate in range(len(points) - 1, here + 1, -1):
            if _sees(place, free, points[here], points[candidate]):
                there = candidate
                break
        kept.append(points[there])
        here = there
    return kept


def _sees(place: TrueSlice, free: NDArray[np.bool_], a: Point, b: Point) -> bool:
    count = max(2, math.ceil(4.0 * math.dist(a, b) / place.cell_m))
    share = np.linspace(0.0, 1.0, count)
    column = np.floor((a[0] + share * (b[0] - a[0]) - place.origin_W[0]) / place.cell_m).astype(int)
    row = np.floor((a[1] + share * (b[1] - a[1]) - place.origin_W[1]) / place.cell_m).astype(int)
    return bool(free[row, column].all())
