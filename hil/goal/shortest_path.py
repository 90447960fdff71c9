"""The shortest way through a place whose map is known: what a flight through the unknown is compared with.

The explorer's own A* over cells that are at least `berth_m` from anything, all at one price, and its straightening
between cells that see each other (`hil_companion.explore`).
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
    from hil_companion.explore.plan_map import PlanMap
    from hil_companion.explore.route import straightened

    distance_m = _distance_m(place)
    free = distance_m >= berth_m
    start, goal = place.cell_of(*start_W), place.cell_of(*goal_W)
    if not (place.inside(*start) and place.inside(*goal)):
        return None
    free[start] = free[goal] = True
    price = np.where(free, 1.0, np.inf)
    found = search(price, start, goal) if connected(price, start, goal) else None
    if found is None:
        return None
    points = np.array([start_W, *(place.centre_of(*cell) for cell in found[0][1:-1]), goal_W])
    full = PlanMap(distance_m, ~free, price, place.origin_W, place.cell_m, 1, np.zeros((0, 4)))
    ways = (straightened(full, points), straightened(full, points[::-1])[::-1])
    return min(([(float(x), float(y)) for x, y in way] for way in ways), key=length_m)


def length_m(points: list[Point]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(points))


def _distance_m(place: TrueSlice) -> NDArray[np.float32]:
    """Of every cell's middle from the nearest occupied cell's."""
    if not place.occupied.any():
        return np.full(place.occupied.shape, 1e3, np.float32)
    clear = np.where(place.occupied, 0, 1).astype(np.uint8)
    # Surfaces lie anywhere in their cells: on the average half a cell nearer than the cell's middle tells.
    return np.asarray(cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * place.cell_m, np.float32)
