"""Average precision as Pascal VOC 2010 and later counts it: the area under precision over recall, at every point.

A detection is right where it overlaps an object of its class by at least `iou` that no better scored one has taken; it
takes the one that it overlaps most. Objects marked difficult count neither for nor against: what lies on one is left
out. Precision at a recall is the best at that recall or any above.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hil_companion.detect.decode import Detection, overlaps
from numpy.typing import NDArray

from hil.detect.pictures import Picture

RIGHT, WRONG, LEFT_OUT = 1, 0, -1


@dataclass(frozen=True)
class Judged:
    """All detections of one class, best first, and how many objects there were to find."""

    scores: NDArray[np.float64]
    right: NDArray[np.bool_]
    objects: int

    @property
    def average_precision(self) -> float:
        """NaN where there was nothing to find."""
        if not self.objects:
            return float("nan")
        right = np.cumsum(self.right)
        recall = right / self.objects
        precision = right / np.arange(1, len(right) + 1)
        best = np.maximum.accumulate(precision[::-1])[::-1]
        return float(np.sum(np.diff(np.concatenate([[0.0], recall])) * best))

    def at(self, threshold: float) -> tuple[int, int]:
        """Right and wrong detections with at least this score."""
        counted = self.scores >= threshold
        return int((self.right & counted).sum()), int((~self.right & counted).sum())


def verdicts(detections: Sequence[Detection], picture: Picture, label: str, iou: float) -> list[int]:
    """RIGHT, WRONG or LEFT_OUT for each of the detections of one class, given best first."""
    rows = [i for i, name in enumerate(picture.labels) if name == label]
    boxes, hard = picture.boxes_px[rows].astype(np.float64), picture.difficult[rows]
    taken = np.zeros(len(rows), bool)
    found = []
    for d in detections:
        over = overlaps(np.array(d.box_px), boxes) if len(rows) else np.zeros(0)
        best = int(over.argmax()) if len(over) else -1
        if best < 0 or over[best] < iou:
            found.append(WRONG)
        elif hard[best]:
            found.append(LEFT_OUT)
        else:
            found.append(WRONG if taken[best] else RIGHT)
            taken[best] = True
    return found


def judge(
    pictures: Sequence[Picture], detections: Sequence[Sequence[Detection]], classes: Sequence[str], iou: float = 0.5
) -> dict[str, Judged]:
    """By class. `detections`: of each picture, best first."""
    judged = {}
    for label in classes:
        scores: list[float] = []
        right: list[bool] = []
        objects = 0
        for picture, found in zip(pictures, detections, strict=True):
            objects += sum(n == label and not h for n, h in zip(picture.labels, picture.difficult, strict=True))
            own = [d for d in found if d.label == label]
            for d, verdict in zip(own, verdicts(own, picture, label, iou), strict=True):
                if verdict != LEFT_OUT:
                    scores.append(d.score)
                    right.append(verdict == RIGHT)
        order = np.argsort(-np.array(scores), kind="stable")
        judged[label] = Judged(np.array(scores)[order], np.array(right, bool)[order], objects)
    return judged
