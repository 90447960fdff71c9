"""A* on a grid of prices, 8-connected, in two levels.

    cost of a step = its length * (price here + price there) / 2

A diagonal step needs both cells beside it: nothing is passed by its corner. The heuristic is the octile distance times
the least price there is, so a path is the cheapest, but for a ten-thousandth. `plan` looks for it on a coarse grid of
the cheapest cell of every block first, in which no passable way is missing, and then among the fine cells near the
coarse path; what is found is the cheapest there, and close to the cheapest of all.
"""

from __future__ import annotations

import heapq
import math
from typing import Tuple

import cv2
import numpy as np

Cell = Tuple[int, int]  # row, column
BLOCK = 4  # fine cells to a coarse one, along each side
_BAND = 1  # coarse cells on each side of the coarse path
_TIES = 1.0001  # in the open many ways cost the same: the one that is nearer to its end first; costs 0.01 % at most


def search(price: np.ndarray, start: Cell, goal: Cell) -> tuple[list[Cell], float] | None:
    """Cells from start to goal and what they cost, in cell lengths; None where there is no way. Start and goal may lie
    on impassable cells: the way out of one costs as if its price were that of the cell beside it."""
    height, width = price.shape
    for row, column in (start, goal):
        if not (0 <= row < height and 0 <= column < width):
            return None
    stride = width + 2
    padded = np.full((height + 2, stride), np.inf)
    padded[1:-1, 1:-1] = price
    passable = np.isfinite(padded)
    least = float(padded[passable].min()) if passable.any() else 1.0
    first = (start[0] + 1) * stride + start[1] + 1
    last = (goal[0] + 1) * stride + goal[1] + 1
    dy = np.abs(np.arange(height + 2) - (goal[0] + 1))[:, None]
    dx = np.abs(np.arange(stride) - (goal[1] + 1))[None, :]
    octile = np.maximum(dx, dy) + (math.sqrt(2.0) - 1.0) * np.minimum(dx, dy)
    ahead = (octile * (least * _TIES)).ravel().tolist()
    prices = padded.ravel().tolist()
    infinite = math.inf
    for end in (first, last):
        if prices[end] == infinite:
            prices[end] = max(least, 1.0)
    half, diagonal = 0.5, 0.5 * math.sqrt(2.0)
    straight = (1, -1, stride, -stride)
    slanted = ((stride + 1, stride, 1), (stride - 1, stride, -1), (1 - stride, -stride, 1), (-stride - 1, -stride, -1))
    cost = {first: 0.0}
    came = {first: first}
    done = set()
    heap = [(ahead[first], first)]
    push, pop = heapq.heappush, heapq.heappop
    while heap:
        _, here = pop(heap)
        if here == last:
            return _trace(came, here, stride), cost[here]
        if here in done:
            continue
        done.add(here)
        so_far, own = cost[here], prices[here]
        for step in straight:
            there = here + step
            p = prices[there]
            if p != infinite:
                through = so_far + half * (own + p)
                if there not in cost or through < cost[there]:
                    cost[there] = through
                    came[there] = here
                    push(heap, (through + ahead[there], there))
        for step, beside, across in slanted:
            there = here + step
            p = prices[there]
            if p != infinite and prices[here + beside] != infinite and prices[here + across] != infinite:
                through = so_far + diagonal * (own + p)
                if there not in cost or through < cost[there]:
                    cost[there] = through
                    came[there] = here
                    push(heap, (through + ahead[there], there))
    return None


def plan(price: np.ndarray, start: Cell, goal: Cell) -> list[Cell] | None:
    """Cells from start to goal, found in two levels; None where there is no way at all."""
    if not connected(price, start, goal):
        return None  # at once: a search would look at every cell that can be reached
    small = coarser(price, BLOCK)
    ends = [(row // BLOCK, column // BLOCK) for row, column in (start, goal)]
    coarse = search(small, ends[0], ends[1])
    if coarse is None:
        return None
    band = np.zeros(small.shape, np.uint8)
    for row, column in coarse[0]:
        band[row, column] = 1
    size = 2 * _BAND + 1
    band = cv2.dilate(band, np.ones((size, size), np.uint8))
    rows, columns = np.flatnonzero(band.any(axis=1)), np.flatnonzero(band.any(axis=0))
    top, left = int(rows[0]) * BLOCK, int(columns[0]) * BLOCK
    part = price[top : (int(rows[-1]) + 1) * BLOCK, left : (int(columns[-1]) + 1) * BLOCK]
    band = band[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    near = band.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[: part.shape[0], : part.shape[1]]
    found = search(np.where(near > 0, part, np.inf), (start[0] - top, start[1] - left), (goal[0] - top, goal[1] - left))
    if found is not None:
        return [(row + top, column + left) for row, column in found[0]]
    # The coarse path went where the fine cells have no way through.
    found = search(price, start, goal)
    return None if found is None else found[0]


def coarser(price: np.ndarray, blocks: int) -> np.ndarray:
    """Of every block of cells the cheapest. Optimistic: what cannot be passed here, cannot be in the finer grid."""
    height, width = price.shape
    padded = np.pad(price, ((0, -height % blocks), (0, -width % blocks)), constant_values=np.inf)
    h, w = padded.shape
    return np.asarray(padded.reshape(h // blocks, blocks, w // blocks, blocks).min(axis=(1, 3)))


def connected(price: np.ndarray, start: Cell, goal: Cell) -> bool:
    """Whether there is any way: a diagonal step can always be taken as two straight ones."""
    height, width = price.shape
    if not all(0 <= row < height and 0 <= column < width for row, column in (start, goal)):
        return False
    passable = np.isfinite(price).astype(np.uint8)
    passable[start] = passable[goal] = 1
    _, label = cv2.connectedComponents(passable, connectivity=4)
    return bool(label[start] == label[goal])


def _trace(came: dict[int, int], here: int, stride: int) -> list[Cell]:
    path = [here]
    while came[here] != here:
        here = came[here]
        path.append(here)
    return [(at // stride - 1, at % stride - 1) for at in reversed(path)]
