"""Detection in pieces of a picture, so that small objects are not scaled down to the network's smaller input.

Pieces overlap by a quarter, so that an object cut by a border is whole in the neighbouring piece. Overlapping boxes of
one label count as one object. A box that lies almost wholly in another one shows a part of the same object.
"""

from __future__ import annotations

from typing import Any, Sequence, Tuple

import numpy as np

from hil_companion.detect.decode import overlaps
from hil_companion.locate.seats import SEATS

_OVERLAP = 0.25
_SAME_IOU, _INSIDE_SHARE, _RIVAL_IOU = 0.45, 0.7, 0.4

Piece = Tuple[int, int, int, int]  # x0, y0, x1, y1


def pieces(size_px: tuple[int, int], across: int, down: int) -> list[Piece]:
    """Return the pieces of a picture of that width and height, row by row."""
    columns, rows = _spans(size_px[0], across), _spans(size_px[1], down)
    return [(x0, y0, x1, y1) for y0, y1 in rows for x0, x1 in columns]


def _spans(length: int, count: int) -> list[tuple[int, int]]:
    size = length / (count - (count - 1) * _OVERLAP)
    starts = [i * size * (1.0 - _OVERLAP) for i in range(count)]
    return [(round(start), min(length, round(start + size))) for start in starts]


def without_duplicates(found: Sequence[Any]) -> list[Any]:
    """Return the highest-scoring box of each object, in falling order of score."""
    kept: list[Any] = []
    for box in sorted(found, key=lambda d: (-d.score, d.box_px)):
        if not any(box.label == other.label and _same(box.box_px, other.box_px) for other in kept):
            kept.append(box)
    return kept


def has_rival(box: Any, found: Sequence[Any]) -> bool:
    """Return True if a higher-scoring box of another label, other than a seat, overlaps this box."""
    return any(
        other.score > box.score
        and other.label not in (box.label, *SEATS)
        and _iou(box.box_px, other.box_px) > _RIVAL_IOU
        for other in found
    )


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    first, second = np.asarray(a, float), np.asarray(b, float)
    wide, high = np.maximum(np.minimum(first[2:], second[2:]) - np.maximum(first[:2], second[:2]), 0.0)
    smaller_area = min(np.prod(first[2:] - first[:2]), np.prod(second[2:] - second[:2]))
    return bool(_iou(a, b) > _SAME_IOU or wide * high > _INSIDE_SHARE * smaller_area)


def _iou(a: Sequence[float], b: Sequence[float]) -> float:
    return float(overlaps(np.asarray(a, float), np.asarray([b], float))[0])
