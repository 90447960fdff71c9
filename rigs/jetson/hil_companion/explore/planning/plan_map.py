"""The map for planning: a fine grid of distances to obstacles and unknown cells, and a coarse grid of prices for A*.

The fine grid is the SLAM's, padded so that it contains start and goal. A cell of the price grid is a block of fine
cells, about half a metre wide, and holds the cost of a metre of path through it.

The SLAM's grid is first cleaned by its straight lines, since most buildings consist of walls: segments found by the
probabilistic Hough transform close small gaps in walls, and specks on no segment, with few cells and little evidence,
are removed. Cells with strong evidence always stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Sequence

import cv2
import numpy as np

from hil_companion.explore.mapping.maps import GridView
from hil_companion.explore.planning.flight_settings import FlightSettings

PLAN_CELL_M = 0.5
_MARGIN_M = 8.0  # about all known cells, for a path round the outermost wall
MAX_CELLS = 6_000_000  # of the fine grid
_KNOWN_SHARE = 0.5  # a cell is unknown if a smaller share of the nine cells about it is known
FREE, UNKNOWN_BAND = -0.3, 0.3  # log-odds: free below, occupied above
SURE, SURELY_FREE = 2.5, -1.4  # log-odds of cells that cleaning never removes, or never fills
_VOTES = 8  # cells on a line
_MIN_WALL_M, _GAP_M = 2.0, 0.8  # of a line; the vehicle with its clearance does not fit through such a gap
MAX_SIGMA_M = 0.4  # more position uncertainty lowers the speed instead of the clearances, which would close streets
_NEAR_PRICE = 1.5  # a metre at `hard_m` from an obstacle costs 1 + this
_SPECK_CELLS = 2  # occupied cells among the nine about a cell, up to which it is a speck


@dataclass(frozen=True)
class Clearances:
    """Limits of the distance from the vehicle's centre to obstacles [m]."""

    red_m: float  # nearer: stop and back off, the clearance is nearly used up
    orange_m: float  # nearer: move away from the obstacle
    hard_m: float  # nearer: impassable for the plan
    comfort_m: float  # nearer: more expensive for the plan, and slower


def sigma_m(covariance_xy: np.ndarray) -> float:
    """Return the larger standard deviation of a covariance (2, 2); infinite if it is not a valid one."""
    a, b, d = float(covariance_xy[0][0]), float(covariance_xy[0][1]), float(covariance_xy[1][1])
    largest = 0.5 * (a + d) + math.sqrt(max(0.25 * (a - d) * (a - d) + b * b, 0.0))
    return math.sqrt(largest) if largest >= 0.0 and math.isfinite(largest) else math.inf


def clearances_for(settings: FlightSettings, sigma: float, cell_m: float) -> Clearances:
    """Return the clearances for a standard deviation of the position."""
    smallest = settings.vehicle_radius_m + settings.clearance_m
    spread = 2.0 * min(sigma, MAX_SIGMA_M)
    hard = smallest + spread + settings.slow_mps * settings.reaction_s + 0.7072 * cell_m
    comfort = hard + settings.speed_mps * settings.reaction_s
    red = smallest + 0.1
    # Red and orange are measured in the newest sweep, independent of the position's error.
    return Clearances(red, max(red + 0.1, hard - 0.5 * spread - 0.1), hard, comfort)


def distances_m(occupied: np.ndarray, cell_m: float) -> np.ndarray:
    """Return the distance of each cell's centre to the nearest occupied cell's; 1000 m if none is occupied."""
    if not occupied.any():
        return np.full(occupied.shape, 1e3, np.float32)
    free = np.where(occupied, 0, 1).astype(np.uint8)
    # OpenCV takes its own code or another library's, by processor, threads and size, and they round differently: the
    # squares are whole numbers. With a mask of 5 x 5 they would differ by up to 2 %.
    cells = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.sqrt(np.rint(np.square(cells, dtype=np.float64))).astype(np.float32) * np.float32(cell_m)


def prices(distance_m: np.ndarray, unknown: np.ndarray, clearances: Clearances, unknown_price: float) -> np.ndarray:
    """Return the price of a metre in each cell: 1 in known space far from obstacles, infinite within `hard_m`."""
    near = np.clip((clearances.comfort_m - distance_m) / max(clearances.comfort_m - clearances.hard_m, 1e-6), 0.0, 1.0)
    price = 1.0 + _NEAR_PRICE * near * near + unknown_price * unknown
    return np.where(distance_m < clearances.hard_m, np.inf, price).astype(np.float64)


def occupied_mask(log_odds: np.ndarray) -> np.ndarray:
    return np.asarray(log_odds > UNKNOWN_BAND)


def unknown_mask(log_odds: np.ndarray) -> np.ndarray:
    return np.asarray((log_odds <= UNKNOWN_BAND) & (log_odds >= FREE))


def segments(occupied: np.ndarray, cell_m: float) -> np.ndarray:
    """Return the straight segments (n, 4): column and row of both ends, in cells."""
    found: Any = cv2.HoughLinesP(
        occupied.astype(np.uint8) * 255,
        rho=1.0,
        theta=math.pi / 90.0,
        threshold=_VOTES,
        minLineLength=_MIN_WALL_M / cell_m,
        maxLineGap=_GAP_M / cell_m,
    )
    return np.zeros((0, 4), np.int32) if found is None else np.asarray(found, np.int32).reshape(-1, 4)


def clean(log_odds: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the mask of occupied cells after cleaning, and the segments found."""
    occupied = occupied_mask(log_odds)
    if not occupied.any():
        return occupied, np.zeros((0, 4), np.int32)
    found = segments(occupied, cell_m)
    drawn = np.zeros(occupied.shape, np.uint8)
    for x0, y0, x1, y1 in found.tolist():
        cv2.line(drawn, (x0, y0), (x1, y1), 1)
    kept = occupied & ~_specks(log_odds, occupied, drawn)
    # A segment fills only the gaps between the cells of a wall, and never cells that many beams have crossed.
    filled = (drawn > 0) & (log_odds > SURELY_FREE)
    return kept | filled, found


def _specks(log_odds: np.ndarray, occupied: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    beside = cv2.boxFilter(occupied.astype(np.uint8), -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    near_line = cv2.dilate(drawn, np.ones((3, 3), np.uint8)) > 0
    return np.asarray(occupied & (beside <= _SPECK_CELLS) & (log_odds < SURE) & ~near_line)


class TooFar(ValueError):
    """The map that contains vehicle and goal would be too large to plan on."""


@dataclass(frozen=True, eq=False)
class PlanMap:
    """Fine grid of distances and coarser grid of prices, with the same origin. Rows go north (y), columns east (x)."""

    distance_m: np.ndarray  # (H, W) fine: to the nearest obstacle
    unknown: np.ndarray  # (H, W) fine, bool
    price: np.ndarray  # (h, w) coarse: of a metre, infinite where impassable
    origin_W: tuple[float, float]
    cell_m: float
    blocks: int  # fine cells per coarse cell, along each side
    segments_W: np.ndarray  # (n, 4): x and y of both ends of the walls found

    @property
    def plan_cell_m(self) -> float:
        return self.cell_m * self.blocks

    def fine(self, p_W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and columns of points (n, 2) in the fine grid; a point outside gets the nearest cell."""
        height, width = self.distance_m.shape
        column = np.floor((p_W[:, 0] - self.origin_W[0]) / self.cell_m).astype(int)
        row = np.floor((p_W[:, 1] - self.origin_W[1]) / self.cell_m).astype(int)
        return np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)

    def holds(self, p_W: np.ndarray) -> np.ndarray:
        """Return which points (n, 2) lie on the map."""
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
        """Return the cost of the straight line between two points on the map; infinite if it is blocked."""
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
    clearances: Clearances,
    unknown_price: float,
) -> PlanMap:
    """Make the map from the SLAM's grid. Raises TooFar.

    `gone`: mask of vacated cells; `near_W` (n, 2): obstacles near the vehicle in the newest sweep; `ends_W`: vehicle
    and goal, which the map has to contain.
    """
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
    known = np.where(unknown_mask(log_odds), np.float32(0.0), np.float32(1.0))
    unknown = (cv2.blur(known, (3, 3)) < _KNOWN_SHARE) & ~occupied
    h, w = distance.shape[0] // blocks, distance.shape[1] // blocks
    pooled = cv2.resize(distance, (w, h), interpolation=cv2.INTER_AREA)
    share = cv2.resize(unknown.astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
    price = prices(pooled, share, clearances, unknown_price)
    segments_W = (found + 0.5) * cell_m + np.asarray([*origin_W, *origin_W])
    return PlanMap(distance, unknown, price, origin_W, cell_m, blocks, segments_W)


def _framed(
    grid: GridView, gone: np.ndarray, ends_W: Sequence[tuple[float, float]], blocks: int
) -> tuple[np.ndarray, tuple[float, float]]:
    """Crop the grid to its known cells, both ends and a margin, in whole blocks; return log-odds and origin.

    Further unknown cells would only cost time. Raises TooFar.
    """
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
    if height * width > MAX_CELLS:
        raise TooFar(f"a map of {width * cell_m:.0f} by {height * cell_m:.0f} m is more than can be planned on")
    framed = np.zeros((height, width), np.float32)
    first, last = np.maximum(low, 0), np.minimum(high, all_odds.shape)
    if (first < last).all():
        source = (slice(first[0], last[0]), slice(first[1], last[1]))
        target = (slice(first[0] - low[0], last[0] - low[0]), slice(first[1] - low[1], last[1] - low[1]))
        odds = all_odds[source]
        framed[target] = np.where(gone[source] | ~np.isfinite(odds), np.float32(0.0), odds)
    return framed, (float(corner[0] + low[1] * cell_m), float(corner[1] + low[0] * cell_m))
