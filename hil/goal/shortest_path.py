"""The shortest way through a place whose map is known: what a flight through the unknown is compared with.

A* over cells that are at least `berth_m` from anything, with steps to the 16 cells that a chess king and a knight reach
(at most 2.8 % longer than the straight way in open space), then pulled straight between cells that see each other.
What is found is no shorter than the shortest way, and seldom more than a per cent longer.
"""

from __future__ import annotations

import heapq
import math
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.goal.true_slice import TrueSlice

Point = tuple[float, float]
_KING = ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_KNIGHT = ((1, 2), (2, 1), (-1, 2), (-2, 1), (1, -2), (2, -1), (-1, -2), (-2, -1))


def shortest_path(place: TrueSlice, start_W: Point, goal_W: Point, *, berth_m: float) -> list[Point] | None:
    """Points from start to goal; None where there is no way. Both ends count as free where they are."""
    free = _free(place, berth_m)
    start, goal = place.cell_of(*start_W), place.cell_of(*goal_W)
    if not (place.inside(*start) and place.inside(*goal)):
        return None
    free[start] = free[goal] = True
    _, label = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    if label[start] != label[goal]:
        return None  # at once; no step reaches what four straight ones do not
    cells = _search(free, start, goal)
    if cells is None:
        return None
    points = [start_W, *(place.centre_of(*cell) for cell in cells[1:-1]), goal_W]
    return _pulled(place, free, points)


def length_m(points: list[Point]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(points))


def _free(place: TrueSlice, berth_m: float) -> NDArray[np.bool_]:
    if not place.occupied.any():
        return np.ones(place.occupied.shape, np.bool_)
    clear = np.where(place.occupied, 0, 1).astype(np.uint8)
    # Surfaces lie anywhere in their cells: on the average half a cell nearer than the cell's middle tells.
    distance = cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * place.cell_m
    return np.asarray(distance >= berth_m, np.bool_)


def _search(free: NDArray[np.bool_], start: tuple[int, int], goal: tuple[int, int]) -> list[tuple[int, int]] | None:
    height, width = free.shape
    stride = width + 4
    padded = np.zeros((height + 4, stride), np.bool_)
    padded[2:-2, 2:-2] = free
    passable = padded.ravel().tolist()

    def index(cell: tuple[int, int]) -> int:
        return (cell[0] + 2) * stride + cell[1] + 2

    first, last = index(start), index(goal)
    moves = [(dr * stride + dc, math.hypot(dr, dc), _between(dr, dc, stride)) for dr, dc in (*_KING, *_KNIGHT)]
    goal_row, goal_column = divmod(last, stride)
    cost, came, done = {first: 0.0}, {first: first}, set[int]()
    heap = [(0.0, first)]
    while heap:
        _, here = heapq.heappop(heap)
        if here == last:
            path = [here]
            while came[path[-1]] != path[-1]:
                path.append(came[path[-1]])
            return [(at // stride - 2, at % stride - 2) for at in reversed(path)]
        if here in done:
            continue
        done.add(here)
        for offset, length, between in moves:
            there = here + offset
            if not passable[there] or not all(passable[here + b] for b in between):
                continue
            through = cost[here] + length
            if there not in cost or through < cost[there] - 1e-12:
                cost[there] = through
                came[there] = here
                row, column = divmod(there, stride)
                heapq.heappush(heap, (through + math.hypot(row - goal_row, column - goal_column), there))
    return None


def _between(dr: int, dc: int, stride: int) -> tuple[int, ...]:
    """Cells that a step brushes."""
    if abs(dr) == abs(dc) == 1:
        return (dr * stride, dc)
    if abs(dr) == 2:
        return (dr // 2 * stride, dr // 2 * stride + dc)
    if abs(dc) == 2:
        return (dc // 2, dc // 2 + dr * stride)
    return ()


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
