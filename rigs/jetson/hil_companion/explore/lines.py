"""Cleans an occupancy grid by the straight lines in it: most of what people build is made of walls.

Segments found by the probabilistic Hough transform close the small gaps that sweeps have left in walls; a speck that
lies on no segment and has few cells and little evidence goes. What is surely there stays, however small.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

FREE, UNKNOWN_BAND = -0.3, 0.3  # log-odds: free below, occupied above
SURE, SURELY_FREE = 2.5, -1.4  # log-odds of cells that no cleaning takes away, or fills
_VOTES = 8  # cells on a line
_SHORTEST_M, _GAP_M = 2.0, 0.8  # a gap that small is no way through for anything with a clearance
_SPECK_CELLS = 2  # in the nine round a cell, itself included


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
