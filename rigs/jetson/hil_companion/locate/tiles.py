"""Detection in pieces of a picture, so that small objects are not scaled down to the network's smaller input.

Pieces overlap by a quarter, so that an object cut by a border is whole in the neighbouring piece. Overlapping boxes of
one label count as one object. A box that lies almost wholly in another one shows a part of the same object.
"""

from __future__ import annotations

from typing import Any, Sequence, Tuple

_OVERLAP = 0.25
_SAME_IOU, _INSIDE_SHARE, _RIVAL_IOU, _ON_SEAT = 0.45, 0.7, 0.3, 0.2
_SEATS = ("bench",)  # labels of objects that people sit on

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


def rival_score(box: Any, found: Sequence[Any]) -> float | None:
    """Return the highest score of the boxes of other labels, other than seats, that overlap this box; or None."""
    return max(
        (
            other.score
            for other in found
            if other.label not in (box.label, *_SEATS) and _iou(box.box_px, other.box_px) > _RIVAL_IOU
        ),
        default=None,
    )


def on_seat(box: Any, found: Sequence[Any], least_score: float) -> bool:
    """Return True if a seat of at least this score covers more than a fifth of the box."""
    x0, y0, x1, y1 = box.box_px
    return any(
        other.label in _SEATS
        and other.score >= least_score
        and _shared(box.box_px, other.box_px) > _ON_SEAT * (x1 - x0) * (y1 - y0)
        for other in found
    )


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    smaller_area = min((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in (a, b))
    return bool(_iou(a, b) > _SAME_IOU or _shared(a, b) > _INSIDE_SHARE * smaller_area)


def _shared(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the area that two boxes share [px2]."""
    wide, high = (min(a[i + 2], b[i + 2]) - max(a[i], b[i]) for i in (0, 1))
    return max(0.0, wide) * max(0.0, high)


def _iou(a: Sequence[float], b: Sequence[float]) -> float:
    """Return intersection over union; without arrays, which take ten times as long for two boxes."""
    shared = _shared(a, b)
    union = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in (a, b)) - shared
    return shared / union if union > 0.0 else 0.0
