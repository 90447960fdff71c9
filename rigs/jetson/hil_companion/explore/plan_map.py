"""What planning looks at: distances to obstacles, what is unknown, and what a metre costs, on two grids in one place.

The fine grid is the SLAM's own, padded so that start and goal lie on it: distances, and lines of sight. The plan's
grid has cells of about half a metre, each a block of fine ones: prices, for A*.

Before that the grid is cleaned by the straight lines in it: most of what people build is made of walls. Segments found
by the probabilistic Hough transform close the small gaps that sweeps have left in walls; a speck that lies on no
segment and has few cells and little evidence goes. What is surely there stays, however small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Sequence

import cv2
import numpy as np

from hil_companion.explore.maps import GridView
from hil_companion.explore.settings import FlightSettings

PLAN_CELL_M = 0.5
_MARGIN_M = 8.0  # round everything: the way round the outermost wall
MOST_CELLS = 6_000_000  # of the fine grid
_SEEN_SHARE = 0.5  # of a cell and its eight neighbours: a cell missed among seen ones is no unknown place
FREE, UNKNOWN_BAND = -0.3, 0.3  # log-odds: free below, occupied above
SURE, SURELY_FREE = 2.5, -1.4  # log-odds of cells that no cleaning takes away, or fills
_VOTES = 8  # cells on a line
_SHORTEST_M, _GAP_M = 2.0, 0.8  # a gap that small is no way through for anything with a clearance
MOST_SIGMA_M = 0.4  # more uncertainty than this is flown with slower, not with a wider berth: streets are not wider
_NEAR_PRICE = 1.5  # a metre at `hard` counts as 1 + this
_SPECK_CELLS = 2  # in the nine round a cell, itself included


@dataclass(frozen=True)
class Berth:
    """Distances of the vehicle's middle to obstacles [m]."""

    red_m: float  # the clearance is nearly used up: stop, back off
    orange_m: float  # move away from the obstacle
    hard_m: float  # nothing is planned nearer
    comfort_m: float


def sigma_m(covariance_xy: np.ndarray) -> float:
    """The larger half axis; infinite where it is no covariance."""
    a, b, d = float(covariance_xy[0][0]), float(covariance_xy[0][1]), float(covariance_xy[1][1])
    largest = 0.5 * (a + d) + math.sqrt(max(0.25 * (a - d) * (a - d) + b * b, 0.0))
    return math.sqrt(largest) if largest >= 0.0 and math.isfinite(largest) else math.inf


def berth(settings: FlightSettings, sigma: float, cell_m: float) -> Berth:
    """For this uncertainty of the position."""
    least = settings.vehicle_radius_m + settings.clearance_m
    spread = 2.0 * min(sigma, MOST_SIGMA_M)
    hard = least + spread + settings.slow_mps * settings.reaction_s + 0.7072 * cell_m
    comfort = hard + settings.speed_mps * settings.reaction_s
    red = least + 0.1
    # Measured by the newest sweep, which no error of the position touches.
    return Berth(red, max(red + 0.1, hard - 0.5 * spread - 0.1), hard, comfort)


def distances_m(occupied: np.ndarray, cell_m: float) -> np.ndarray:
    """From the middle of every cell to the nearest occupied one's; large where there is none."""
    if not occupied.any():
        return np.full(occupied.shape, 1e3, np.float32)
    free = np.where(occupied, 0, 1).astype(np.uint8)
    return np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, 5), np.float32) * np.float32(cell_m)


def prices(distance_m: np.ndarray, unknown: np.ndarray, around: Berth, unknown_price: float) -> np.ndarray:
    """Of a metre in every cell: 1 in known free space far from anything, infinite nearer than `hard`."""
    near = np.clip((around.comfort_m - distance_m) / max(around.comfort_m - around.hard_m, 1e-6), 0.0, 1.0)
    price = 1.0 + _NEAR_PRICE * near * near + unknown_price * unknown
    return np.where(distance_m < around.hard_m, np.inf, price).astype(np.float64)


def occupied_mask(log_odds: np.ndarray) -> np.ndarray:
    return np.asarray(log_odds > UNKNOWN_BAND)


def unknown_mask(log_odds: np.ndarray) -> np.ndarray:
    return np.asarray((log_odds <= UNKNOWN_BAND) & (log_odds >= FREE))


def segments(occupied: np.ndarray, cell_m: float) -> np.ndarray:
    """(n, 4): column and row of both ends, in cells."""
    found: Any = cv2.HoughLinesP(
        occupied.astype(np.uint8) * 255,
        rho=1.0,
        theta=math.pi / 90.0,
        threshold=_VOTES,
        minLineLength=_SHORTEST_M / cell_m,
        maxLineGap=_GAP_M / cell_m,
    )
    return np.zeros((0, 4), np.int32) if found is None else np.asarray(found, np.int32).reshape(-1, 4)


def clean(log_odds: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """The cells that obstacles fill, and the segments that were found."""
    occupied = occupied_mask(log_odds)
    if not occupied.any():
        return occupied, np.zeros((0, 4), np.int32)
    found = segments(occupied, cell_m)
    drawn = np.zeros(occupied.shape, np.uint8)
    for x0, y0, x1, y1 in found.tolist():
        cv2.line(drawn, (x0, y0), (x1, y1), 1)
    kept = occupied & ~_specks(log_odds, occupied, drawn)
    # Between the cells of a wall, not beyond: a line is drawn no farther than its gaps, and never over what is surely
    # free, which a beam has crossed again and again.
    filled = (drawn > 0) & (log_odds > SURELY_FREE)
    return kept | filled, found


def _specks(log_odds: np.ndarray, occupied: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    beside = cv2.boxFilter(occupied.astype(np.uint8), -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    near_line = cv2.dilate(drawn, np.ones((3, 3), np.uint8)) > 0
    return np.asarray(occupied & (beside <= _SPECK_CELLS) & (log_odds < SURE) & ~near_line)


class TooFar(ValueError):
    """What has to be on one map is more than can be planned on."""


@dataclass(frozen=True, eq=False)
class PlanMap:
    distance_m: np.ndarray  # (H, W) fine: to the nearest obstacle
    unknown: np.ndarray  # (H, W) fine, bool
    price: np.ndarray  # (h, w) of the plan's grid; infinite where nothing is planned
    origin_W: tuple[float, float]
    cell_m: float
    blocks: int  # fine cells to a cell of the plan, along each side
    segments_W: np.ndarray  # (n, 4): x and y of both ends of the walls that were found

    @property
    def plan_cell_m(self) -> float:
        return self.cell_m * self.blocks

    def fine(self, p_W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of points (n, 2); points outside get the nearest cell."""
        height, width = self.distance_m.shape
        column = np.floor((p_W[:, 0] - self.origin_W[0]) / self.cell_m).astype(int)
        row = np.floor((p_W[:, 1] - self.origin_W[1]) / self.cell_m).astype(int)
        return np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)

    def holds(self, p_W: np.ndarray) -> np.ndarray:
        """Which points (n, 2) lie on the map."""
        height, width = self.distance_m.shape
        at = (p_W - np.asarray(self.origin_W)) / self.cell_m
        return np.asarray(((at >= 0.0) & (at < (width, height))).all(axis=1))

    def plan_cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        size = self.plan_cell_m
        height, width = self.price.shape
        row = math.floor((y_m - self.origin_W[1]) / size)
        column = math.floor((x_m - self.origin_W[0]) / size)
        return min(max(row, 0), height - 1), min(max(column, 0), width - 1)

    def plan_centres(self, cells: Sequence[tuple[int, int]]) -> np.ndarray:
        rows_columns = np.asarray(cells, float).reshape(-1, 2)
        return (rows_columns[:, ::-1] + 0.5) * self.plan_cell_m + np.asarray(self.origin_W)

    def distance_at(self, x_m: float, y_m: float) -> float:
        row, column = self.fine(np.array([[x_m, y_m]]))
        return float(self.distance_m[row[0], column[0]])

    def cost_along(self, a_W: np.ndarray, b_W: np.ndarray) -> float:
        """Of the straight line between two places on the map, by the plan's prices; infinite where it is blocked."""
        size = self.plan_cell_m
        ax, ay, bx, by = (float(v) for v in (*a_W, *b_W))
        length_m = math.hypot(bx - ax, by - ay)
        count = max(2, math.ceil(length_m / self.cell_m) + 1)
        share = np.arange(count) * (1.0 / (count - 1))
        column = ((ax - self.origin_W[0] + share * (bx - ax)) * (1.0 / size)).astype(np.int64)
        row = ((ay - self.origin_W[1] + share * (by - ay)) * (1.0 / size)).astype(np.int64)
        return float(self.price[row, column].sum()) / count * length_m


def make_map(
    grid: GridView,
    gone: np.ndarray,
    near_W: np.ndarray,
    ends_W: Sequence[tuple[float, float]],
    around: Berth,
    unknown_price: float,
) -> PlanMap:
    """`gone`: cells of what has moved away; `near_W` (n, 2): what the newest sweep saw near by; `ends_W`: vehicle and
    goal, which must lie on the map. TooFar."""
    cell_m = float(grid.cell_m)
    blocks = max(1, round(PLAN_CELL_M / cell_m))
    log_odds, origin_W = _framed(grid, gone, ends_W, blocks)
    occupied, found = clean(log_odds, cell_m)
    if len(near_W):
        column = np.floor((near_W[:, 0] - origin_W[0]) / cell_m).astype(int)
        row = np.floor((near_W[:, 1] - origin_W[1]) / cell_m).astype(int)
        there = (row >= 0) & (row < occupied.shape[0]) & (column >= 0) & (column < occupied.shape[1])
        occupied[row[there], column[there]] = True
    distance = distances_m(occupied, cell_m)
    seen = np.where(unknown_mask(log_odds), np.float32(0.0), np.float32(1.0))
    unknown = (cv2.blur(seen, (3, 3)) < _SEEN_SHARE) & ~occupied
    h, w = distance.shape[0] // blocks, distance.shape[1] // blocks
    pooled = cv2.resize(distance, (w, h), interpolation=cv2.INTER_AREA)
    share = cv2.resize(unknown.astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
    price = prices(pooled, share, around, unknown_price)
    segments_W = (found + 0.5) * cell_m + np.asarray([*origin_W, *origin_W])
    return PlanMap(distance, unknown, price, origin_W, cell_m, blocks, segments_W)


def _framed(
    grid: GridView, gone: np.ndarray, ends_W: Sequence[tuple[float, float]], blocks: int
) -> tuple[np.ndarray, tuple[float, float]]:
    """What is known, with start and goal and unknown cells round it, in whole blocks. Cells that nobody has seen yet
    cost time and tell nothing."""
    cell_m = float(grid.cell_m)
    all_odds = np.asarray(grid.log_odds, np.float32)
    corner = np.array([float(grid.origin_W[0]), float(grid.origin_W[1])])
    ends = np.floor((np.asarray(ends_W, float) - corner) / cell_m).astype(int)[:, ::-1]  # rows, columns
    known = all_odds != 0.0
    low, high = ends.min(axis=0), ends.max(axis=0) + 1
    for axis in (0, 1):
        there = np.flatnonzero(known.any(axis=1 - axis))
        if len(there):
            low[axis], high[axis] = min(low[axis], there[0]), max(high[axis], there[-1] + 1)
    margin = round(_MARGIN_M / cell_m)
    low, high = (low - margin) // blocks * blocks, -(-(high + margin) // blocks) * blocks
    height, width = (int(n) for n in high - low)
    if height * width > MOST_CELLS:
        raise TooFar(f"a map of {width * cell_m:.0f} by {height * cell_m:.0f} m is more than can be planned on")
    framed = np.zeros((height, width), np.float32)
    first, last = np.maximum(low, 0), np.minimum(high, all_odds.shape)
    if (first < last).all():
        source = (slice(first[0], last[0]), slice(first[1], last[1]))
        target = (slice(first[0] - low[0], last[0] - low[0]), slice(first[1] - low[1], last[1] - low[1]))
        odds = all_odds[source]
        framed[target] = np.where(gone[source] | ~np.isfinite(odds), np.float32(0.0), odds)
    return framed, (float(corner[0] + low[1] * cell_m), float(corner[1] + low[0] * cell_m))
