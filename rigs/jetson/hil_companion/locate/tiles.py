"""Looking at a picture piece by piece: small things keep their pixels where the network's input is smaller.

Pieces overlap by a quarter, so that what a border cuts is whole in a neighbour. Boxes of one label that lie on one
another are one thing; so is a box that another one holds nearly all of: the part of a thing that a border left.
"""

from __future__ import annotations

from typing import Any, Sequence, Tuple

import numpy as np

_OVERLAP = 0.25
_SEATS = ("bench",)
_SAME_IOU, _HELD_SHARE, _RIVAL_IOU = 0.45, 0.7, 0.4

Piece = Tuple[int, int, int, int]  # x0, y0, x1, y1


def pieces(size_px: tuple[int, int], across: int, down: int) -> list[Piece]:
    """Of a picture of that width and height, row by row."""
    columns, rows = _spans(size_px[0], across), _spans(size_px[1], down)
    return [(x0, y0, x1, y1) for y0, y1 in rows for x0, x1 in columns]


def _spans(length: int, count: int) -> list[tuple[int, int]]:
    size = length / (count - (count - 1) * _OVERLAP)
    starts = [i * size * (1.0 - _OVERLAP) for i in range(count)]
    return [(round(start), min(length, round(start + size))) for start in starts]


def without_doubles(found: Sequence[Any]) -> list[Any]:
    """The best of each thing, best first."""
    kept: list[Any] = []
    for one in sorted(found, key=lambda d: (-d.score, d.box_px)):
        if not any(one.label == other.label and _same(one.box_px, other.box_px) for other in kept):
            kept.append(one)
    return kept


def outdone(one: Any, found: Sequence[Any]) -> bool:
    """Whether what is in this box is more likely something else: a surer box of another label lies on it. What people
    sit on says nothing against them."""
    return any(
        other.score > one.score
        and other.label not in (one.label, *_SEATS)
        and _iou(one.box_px, other.box_px) > _RIVAL_IOU
        for other in found
    )


def _iou(a: Sequence[float], b: Sequence[float]) -> float:
    wide, high = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    if wide <= 0.0 or high <= 0.0:
        return 0.0
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (a, b))
    return wide * high / (areas - wide * high)


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    wide = min(a[2], b[2]) - max(a[0], b[0])
    high = min(a[3], b[3]) - max(a[1], b[1])
    if wide <= 0.0 or high <= 0.0:
        return False
    both = wide * high
    area_a, area_b = ((box[2] - box[0]) * (box[3] - box[1]) for box in (a, b))
    return bool(both > _SAME_IOU * (area_a + area_b - both) or both > _HELD_SHARE * np.minimum(area_a, area_b))
