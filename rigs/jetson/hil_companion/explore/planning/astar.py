"""A* on a grid of prices, 8-connected, in two levels.

    cost of a step = its length * (price here + price there) / 2

A diagonal step needs both adjacent cells free, so that no path cuts a corner. The heuristic is the octile distance
times the lowest price, times 1.0001 to break ties, so a path costs at most 0.01 % more than the cheapest. `plan` first
searches a coarse grid with the cheapest cell of each block, which contains every passable path, and then the fine cells
near the coarse path. Its result is the cheapest path there and close to the cheapest of all.
"""

from __future__ import annotations

import heapq
import math
from typing import Tuple

import cv2
import numpy as np

Cell = Tuple[int, int]  # row, column
BLOCK = 4  # fine cells per coarse cell, along each side
_BAND = 1  # coarse cells on each side of the coarse path
_TIES = 1.0001  # in open space many paths cost the same; this expands cells nearer to the goal first


def search(price: np.ndarray, start: Cell, goal: Cell) -> tuple[list[Cell], float] | None:
    """Return the cells from start to goal and their cost in cell lengths; None if there is no path.

    `price` (rows, columns): infinite where impassable. Start and goal may lie on impassable cells, which then have the
    lowest price of the grid, but at least 1.
    """
    height, width = price.shape
    for row, column in (start, goal):
        if not (0 <= row < height and 0 <= column < width):
            return None
    stride = width + 2
    padded = np.full((height + 2, stride), np.inf)
    padded[1:-1, 1:-1] = price
    passable = np.isfinite(padded)
    lowest_price = float(padded[passable].min()) if passable.any() else 1.0
    first = (start[0] + 1) * stride + start[1] + 1
    last = (goal[0] + 1) * stride + goal[1] + 1
    dy = np.abs(np.arange(height + 2) - (goal[0] + 1))[:, None]
    dx = np.abs(np.arange(stride) - (goal[1] + 1))[None, :]
    octile = np.maximum(dx, dy) + (math.sqrt(2.0) - 1.0) * np.minimum(dx, dy)
    ahead = (octile * (lowest_price * _TIES)).ravel().tolist()
    prices = padded.ravel().tolist()
    infinite = math.inf
    for end in (first, last):
        if prices[end] == infinite:
            prices[end] = max(lowest_price, 1.0)
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
        cost_here, price_here = cost[here], prices[here]
        for step in straight:
            there = here + step
            p = prices[there]
            if p != infinite:
                through = cost_here + half * (price_here + p)
                if there not in cost or through < cost[there]:
                    cost[there] = through
                    came[there] = here
                    push(heap, (through + ahead[there], there))
        for step, beside, across in slanted:
            there = here + step
            p = prices[there]
            if p != infinite and prices[here + beside] != infinite and prices[here + across] != infinite:
                through = cost_here + diagonal * (price_here + p)
                if there not in cost or through < cost[there]:
                    cost[there] = through
                    came[there] = here
                    push(heap, (through + ahead[there], there))
    return None


def plan(price: np.ndarray, start: Cell, goal: Cell) -> list[Cell] | None:
    """Return the cells from start to goal, found in two levels; None if there is no path."""
    if not connected(price, start, goal):
        return None  # without a search, which would expand every reachable cell
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
    in_band = band.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[: part.shape[0], : part.shape[1]]
    found = search(
        np.where(in_band > 0, part, np.inf), (start[0] - top, start[1] - left), (goal[0] - top, goal[1] - left)
    )
    if found is not None:
        return [(row + top, column + left) for row, column in found[0]]
    # The coarse path led through a block whose fine cells are not connected.
    found = search(price, start, goal)
    return None if found is None else found[0]


def coarser(price: np.ndarray, blocks: int) -> np.ndarray:
    """Return the lowest price of each block; a block is impassable if all of its cells are."""
    height, width = price.shape
    padded = np.pad(price, ((0, -height % blocks), (0, -width % blocks)), constant_values=np.inf)
    h, w = padded.shape
    return np.asarray(padded.reshape(h // blocks, blocks, w // blocks, blocks).min(axis=(1, 3)))


def connected(price: np.ndarray, start: Cell, goal: Cell) -> bool:
    """Return True if there is any path. 4-connectivity suffices, as a diagonal step equals two straight ones."""
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
