"""Look of an object: the pixels of its box that show the object, and its colours.

A box also shows what is around the object. The colours of a frame of pixels around the box are counted in cells of
CIE L*a*b*, and a pixel of the box belongs to the object if its cell holds less than `_COMMON` of that frame (histogram
backprojection, Swain and Ballard 1991, Color Indexing, used here for the surroundings). Where too few pixels remain,
as with a green coat on a lawn, the middle of the box counts.

A look is the median colour of the object's upper and lower part: six numbers, NaN where too few pixels show the part.
Two looks differ by the mean over their parts of the colours' distance dE = |(L, a, b)_1 - (L, a, b)_2| (CIE 1976).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import cv2
import numpy as np

_COMMON = 0.04
_CELL = np.array([12.0, 8.0, 8.0])
_ACROSS = (0.15, 0.85)  # part of the box's width that is looked at
_UP_PX = 4  # height of the surroundings above and below the box; beside it, they are as wide as the box
_LEAST_AROUND, _LEAST_PIXELS, _LEAST_PART, _LEAST_HEIGHT_PX = 12, 6, 3, 12.0
_PARTS = ((0.2, 0.45), (0.52, 0.82))  # upper and lower part, as shares of the box's height


@dataclass(frozen=True)
class ObjectPixels:
    """Pixels of a box that show its object. `rows`, `columns`: of the picture; `shown`: of these, (rows, columns)."""

    rows: slice
    columns: slice
    shown: np.ndarray
    lab: np.ndarray


def object_pixels(rgb: np.ndarray, box_px: Sequence[float]) -> ObjectPixels:
    """Return the pixels of a box whose colours are rare around it."""
    height, width = rgb.shape[:2]
    x0, y0, x1, y1 = box_px
    left, right = max(0, math.floor(x0)), min(width, max(math.ceil(x1), math.floor(x0) + 1))
    top, bottom = max(0, math.floor(y0)), min(height, max(math.ceil(y1), math.floor(y0) + 1))
    wide = max(3, right - left)
    rows = slice(max(0, top - _UP_PX), min(height, bottom + _UP_PX))
    columns = slice(max(0, left - wide), min(width, right + wide))
    patch = rgb[rows, columns]
    lab = cv2.cvtColor((patch / 255.0).astype(np.float32), cv2.COLOR_RGB2LAB)
    cells = np.round(lab / _CELL).astype(np.int64) @ np.array([1_000_000, 1_000, 1])
    around = np.ones(cells.shape, bool)
    box = np.s_[top - rows.start : bottom - rows.start, left - columns.start : right - columns.start]
    around[box] = False
    x = (np.arange(left, right) + 0.5 - x0) / max(x1 - x0, 1e-9)
    shown = np.zeros((bottom - top, right - left), bool)
    shown[:, (x > _ACROSS[0]) & (x < _ACROSS[1])] = True
    if around.sum() >= _LEAST_AROUND:
        values, counts = np.unique(cells[around], return_counts=True)
        rare = shown & ~np.isin(cells[box], values[counts > _COMMON * around.sum()])
        if rare.sum() >= _LEAST_PIXELS:
            shown = rare
    return ObjectPixels(slice(top, bottom), slice(left, right), shown, lab[box])


def look_of(pixels: ObjectPixels, box_px: Sequence[float]) -> np.ndarray | None:
    """Return the look of the object in a box; None if the box is too small."""
    y0, y1 = box_px[1], box_px[3]
    if y1 - y0 < _LEAST_HEIGHT_PX:
        return None
    y = (np.arange(pixels.rows.start, pixels.rows.stop) + 0.5 - y0) / (y1 - y0)
    look = np.full(6, math.nan)
    for k, (top, bottom) in enumerate(_PARTS):
        part = (y >= top) & (y < bottom)
        colours = pixels.lab[part][pixels.shown[part]]
        if len(colours) >= _LEAST_PART:
            look[3 * k : 3 * k + 3] = np.median(colours, axis=0)
    return None if np.isnan(look).all() else look


def median_look(looks: Sequence[np.ndarray]) -> np.ndarray:
    """Return the median of each number over the looks that have it."""
    rows = np.array(looks)
    known = ~np.isnan(rows)
    counts = known.sum(axis=0)
    ordered = np.sort(rows, axis=0)  # NaN last
    middle = np.maximum(counts - 1, 0)
    columns = np.arange(rows.shape[1])
    return 0.5 * (ordered[middle // 2, columns] + ordered[(middle + 1) // 2, columns])


def look_difference(a: np.ndarray | None, b: np.ndarray | None) -> float | None:
    """Return the difference of two looks in CIE units, of the parts that both show; None without such a part."""
    if a is None or b is None:
        return None
    apart = np.sqrt(((a - b).reshape(-1, 3) ** 2).sum(axis=1))
    known = ~np.isnan(apart)
    return float(apart[known].mean()) if known.any() else None
