"""Matching of found boxes with the objects of frames; recall, average precision and false boxes.

Boxes of a group are taken by falling score; of two that overlap by an IoU above 0.5, such as a car and a truck, the
better one counts. Each is matched with the object of its group that it overlaps most, if the IoU is at least 0.5. It is
right if no better box has that object, otherwise a duplicate. A box without a match is false. Average precision counts
both as false positives (Pascal VOC 2010), the number of false boxes only the latter. Objects that are hidden or small
(`Truth.counts` is False) are ignored: so is every box that has such an object as its match, or at least half of its
area on one. So is a box without a match that is smaller than any object that counts (its longer side is below
`MIN_PX`): as in COCO's evaluation of a range of sizes, objects and boxes are judged over the same range. Such boxes are
counted apart, as small false boxes. Recall and false boxes count boxes from the network's threshold, average precision
all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hil.config.companion.clients import make_client_importable
from lab.realism.frames import MIN_PX, Truth
from lab.realism.kinds import Kind, group_labels
from lab.realism.networks import Found, area, shared_area

make_client_importable()

from hil_companion.detect.decode import overlaps, suppressed  # noqa: E402

from hil.apps.detect.average_precision import ClassResult  # noqa: E402

MIN_IOU, IGNORED_SHARE = 0.5, 0.5
BUCKETS_PX = ((40.0, 80.0), (80.0, 160.0), (160.0, float("inf")))
RIGHT, DUPLICATE, FALSE, IGNORED, SMALL = 1, 2, 0, -1, -2


@dataclass(frozen=True)
class Match:
    """Outcome of one box of a group, and the object that it has found (-1: none)."""

    found: Found
    outcome: int
    truth: int  # index in the frame's truths


def match_group(truths: Sequence[Truth], boxes: Sequence[Found], group: str) -> list[Match]:
    """Return the outcome of each box of a group in one frame, by falling score."""
    labels = group_labels(group)
    rows = [i for i, truth in enumerate(truths) if truth.kind.group == group]
    places = np.array([truths[i].box_px for i in rows]).reshape(-1, 4)
    hidden = np.array([truths[i].box_px for i in rows if not truths[i].counts]).reshape(-1, 4)
    taken: set[int] = set()
    matches = []
    for one in _without_overlaps([box for box in boxes if box.label in labels]):
        box = np.array(one.box_px)
        ious = overlaps(box, places)
        best = int(ious.argmax()) if len(rows) else -1
        if best >= 0 and ious[best] >= MIN_IOU:
            row = rows[best]
            outcome = IGNORED if not truths[row].counts else DUPLICATE if row in taken else RIGHT
            taken.add(row)
            matches.append(Match(one, outcome, row if outcome == RIGHT else -1))
        else:
            covered = shared_area(box, hidden) >= IGNORED_SHARE * max(float(area(box)), 1e-9)
            small = max(box[2] - box[0], box[3] - box[1]) < MIN_PX
            matches.append(Match(one, IGNORED if covered.any() else SMALL if small else FALSE, -1))
    return matches


def _without_overlaps(boxes: Sequence[Found]) -> list[Found]:
    """Return the boxes by falling score, without those that overlap a better one."""
    places = np.array([box.box_px for box in boxes]).reshape(-1, 4)
    return [boxes[row] for row in suppressed(places, np.array([box.score for box in boxes]), MIN_IOU, None)]


@dataclass
class Tally:
    """Objects of one kind, and what one network has found of them."""

    threshold: float
    kind: Kind
    frames: int = 0
    objects: int = 0
    found: int = 0  # from the threshold, under any label of the group
    named: int = 0  # of those, under a label of the kind
    false_boxes: int = 0  # from the threshold, of the group
    small_false_boxes: int = 0  # the same, smaller than any object that counts
    sizes: dict[tuple[float, float], list[int]] = field(
        default_factory=lambda: {bucket: [0, 0] for bucket in BUCKETS_PX}
    )  # found and objects by the longer side of the box
    missed: list[tuple[int, int]] = field(default_factory=list)  # (frame, truth)
    _scores: list[float] = field(default_factory=list)
    _right: list[bool] = field(default_factory=list)

    def add(self, frame: int, truths: Sequence[Truth], matches: Sequence[Match]) -> None:
        """Add one frame; `matches` are those of the kind's group, `frame` is its number."""
        self.frames += 1
        found: dict[int, str] = {}
        for match in matches:
            counts = match.found.score >= self.threshold
            if match.outcome == RIGHT:
                if truths[match.truth].kind != self.kind:
                    continue  # an object of another kind of the group
                if counts:
                    found[match.truth] = match.found.label
            elif match.outcome in (IGNORED, SMALL):
                self.small_false_boxes += counts and match.outcome == SMALL
                continue
            self.false_boxes += counts and match.outcome == FALSE
            self._scores.append(match.found.score)
            self._right.append(match.outcome == RIGHT)
        for i, truth in enumerate(truths):
            if truth.kind != self.kind or not truth.counts:
                continue
            self.objects += 1
            self.found += i in found
            self.named += found.get(i) in self.kind.labels
            if i not in found:
                self.missed.append((frame, i))
            for bucket, counts_of in self.sizes.items():
                if bucket[0] <= truth.side_px < bucket[1]:
                    counts_of[0] += i in found
                    counts_of[1] += 1

    @property
    def recall(self) -> float:
        """Share of the objects found; NaN without objects."""
        return self.found / self.objects if self.objects else float("nan")

    @property
    def average_precision(self) -> float:
        """Average precision at IoU 0.5 over all scores; NaN without objects."""
        order = np.argsort(-np.array(self._scores), kind="stable")
        scores, right = np.array(self._scores)[order], np.array(self._right, bool)[order]
        return ClassResult(scores, right, self.objects).average_precision

    @property
    def false_per_frame(self) -> float:
        """False boxes of the group per frame."""
        return self.false_boxes / self.frames if self.frames else float("nan")

    @property
    def small_false_per_frame(self) -> float:
        """Small false boxes of the group per frame."""
        return self.small_false_boxes / self.frames if self.frames else float("nan")
