"""How good a detector is on labelled pictures: average precision by class, and false boxes at a threshold.

Works with any back end of the companion, on the very files that fly. `all classes` is the mean over the model's classes
that the pictures hold at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from hil_companion.detect.decode import Detection
from hil_companion.detect.detector import Detector

from hil.detect.average_precision import Judged, judge
from hil.detect.picture_store import read_rgb
from hil.detect.pictures import Picture

LOWEST_SCORE = 0.01  # of the detections that average precision is counted from
FALSE_BOXES_A_PICTURE = 0.15  # that a threshold is chosen for


@dataclass(frozen=True)
class Evaluation:
    """One detector on some pictures."""

    judged: dict[str, Judged]
    pictures: int
    threshold: float

    @property
    def mean_average_precision(self) -> float:
        """NaN where there was nothing to find."""
        each = [j.average_precision for j in self.judged.values() if j.objects]
        return float(np.mean(each)) if each else math.nan

    def false_boxes(self, threshold: float | None = None) -> float:
        """A picture, of all classes."""
        least = self.threshold if threshold is None else threshold
        return sum(j.at(least)[1] for j in self.judged.values()) / max(1, self.pictures)

    def threshold_for(self, false_boxes: float = FALSE_BOXES_A_PICTURE) -> float:
        """The lowest score at which there are no more false boxes a picture than that, rounded up to a hundredth."""
        wrong = np.sort(np.concatenate([j.scores[~j.right] for j in self.judged.values()] or [np.zeros(0)]))[::-1]
        allowed = int(false_boxes * self.pictures)
        if allowed >= len(wrong):
            return LOWEST_SCORE
        return min(0.99, math.ceil((float(wrong[allowed]) + 1e-6) * 100.0) / 100.0)

    def as_json(self) -> dict[str, Any]:
        rows = {}
        for name, j in self.judged.items():
            right, wrong = j.at(self.threshold)
            rows[name] = {
                "objects": j.objects,
                "average_precision": _number(j.average_precision),
                "recall": _number(right / j.objects if j.objects else math.nan),
                "precision": _number(right / (right + wrong) if right + wrong else math.nan),
            }
        return {
            "pictures": self.pictures,
            "iou": 0.5,
            "mean_average_precision": _number(self.mean_average_precision),
            "threshold": self.threshold,
            "false_boxes_per_picture": _number(self.false_boxes()),
            "classes": rows,
        }


def _number(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def evaluate(
    detector: Detector, pictures: Sequence[Picture], *, shown: Callable[[int], None] | None = None
) -> Evaluation:
    """`detector`: with a threshold of LOWEST_SCORE or below. False boxes are counted at the model's own."""
    detections: list[list[Detection]] = []
    for i, picture in enumerate(pictures):
        detections.append(detector.detect(read_rgb(picture)))
        if shown is not None:
            shown(i + 1)
    return judged_at(detector.model.score_threshold, pictures, detections, detector.model.classes)


def judged_at(
    threshold: float, pictures: Sequence[Picture], detections: Sequence[Sequence[Detection]], classes: Sequence[str]
) -> Evaluation:
    return Evaluation(judge(pictures, detections, classes), len(pictures), threshold)
