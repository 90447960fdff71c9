"""Average precision as defined by Pascal VOC from 2010 on: the area under the precision-recall curve, at every point.

Each detection is matched with the object of its class that it overlaps most. It is a true positive if their IoU is at
least `iou` and no detection with a higher score has matched that object. A detection matched with a difficult object is
ignored. Precision at a recall is the greatest precision at that recall or above.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hil_companion.detect.decode import Detection, overlaps
from numpy.typing import NDArray

from hil.apps.detect.pictures import Picture

TRUE_POSITIVE, FALSE_POSITIVE, IGNORED = 1, 0, -1


@dataclass(frozen=True)
class ClassResult:
    """Detections of one class by falling score, and the number of objects to find (without difficult ones)."""

    scores: NDArray[np.float64]  # (n,)
    correct: NDArray[np.bool_]  # (n,) True for true positives
    objects: int

    @property
    def average_precision(self) -> float:
        """Average precision, 0 to 1; NaN if there are no objects."""
        if not self.objects:
            return float("nan")
        correct = np.cumsum(self.correct)
        recall = correct / self.objects
        precision = correct / np.arange(1, len(correct) + 1)
        best_precision = np.maximum.accumulate(precision[::-1])[::-1]
        return float(np.sum(np.diff(np.concatenate([[0.0], recall])) * best_precision))

    def counts_at(self, threshold: float) -> tuple[int, int]:
        """Return the number of true and false positives with at least this score."""
        counted = self.scores >= threshold
        return int((self.correct & counted).sum()), int((~self.correct & counted).sum())


def match_detections(detections: Sequence[Detection], picture: Picture, label: str, iou: float) -> list[int]:
    """Return TRUE_POSITIVE, FALSE_POSITIVE or IGNORED for each detection of class `label`, given by falling score."""
    rows = [i for i, name in enumerate(picture.labels) if name == label]
    boxes, difficult = picture.boxes_px[rows].astype(np.float64), picture.difficult[rows]
    matched = np.zeros(len(rows), bool)
    outcomes = []
    for d in detections:
        ious = overlaps(np.array(d.box_px), boxes) if len(rows) else np.zeros(0)
        best = int(ious.argmax()) if len(ious) else -1
        if best < 0 or ious[best] < iou:
            outcomes.append(FALSE_POSITIVE)
        elif difficult[best]:
            outcomes.append(IGNORED)
        else:
            outcomes.append(FALSE_POSITIVE if matched[best] else TRUE_POSITIVE)
            matched[best] = True
    return outcomes


def evaluate_classes(
    pictures: Sequence[Picture], detections: Sequence[Sequence[Detection]], classes: Sequence[str], iou: float = 0.5
) -> dict[str, ClassResult]:
    """Return the result of each class; `detections[i]` are those in `pictures[i]`, by falling score."""
    results = {}
    for label in classes:
        scores: list[float] = []
        correct: list[bool] = []
        objects = 0
        for picture, all_detections in zip(pictures, detections, strict=True):
            objects += sum(n == label and not d for n, d in zip(picture.labels, picture.difficult, strict=True))
            of_class = [d for d in all_detections if d.label == label]
            for d, outcome in zip(of_class, match_detections(of_class, picture, label, iou), strict=True):
                if outcome != IGNORED:
                    scores.append(d.score)
                    correct.append(outcome == TRUE_POSITIVE)
        order = np.argsort(-np.array(scores), kind="stable")
        results[label] = ClassResult(np.array(scores)[order], np.array(correct, bool)[order], objects)
    return results
