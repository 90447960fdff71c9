"""Evaluation of a detector on labelled pictures: average precision by class, and false boxes at a threshold.

A false box is a false positive. Evaluation works with any back end of the companion, and with the model files that are
used in flight. The mean average precision is the mean over those of the model's classes that occur in the pictures.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from hil_companion.detect.decode import Detection
from hil_companion.detect.detector import Detector

from hil.apps.detect.average_precision import ClassResult, evaluate_classes
from hil.apps.detect.picture_store import read_rgb
from hil.apps.detect.pictures import Picture

LOWEST_SCORE = 0.01  # detections below this score do not enter average precision
FALSE_BOXES_PER_PICTURE = 0.15  # target for which a threshold is chosen


@dataclass(frozen=True)
class Evaluation:
    """Results of one detector by class, over a number of pictures; `threshold` is the detector's score threshold.

    `others`: numbers of objects of classes that the model does not have, which no figure counts.
    """

    classes: dict[str, ClassResult]
    pictures: int
    threshold: float
    others: Mapping[str, int] = field(default_factory=dict)

    @property
    def mean_average_precision(self) -> float:
        """Mean over the classes that occur, 0 to 1; NaN if there are no objects."""
        precisions = [c.average_precision for c in self.classes.values() if c.objects]
        return float(np.mean(precisions)) if precisions else math.nan

    def false_boxes(self, threshold: float | None = None) -> float:
        """Return the false positives of all classes per picture at a threshold (default: `self.threshold`)."""
        score = self.threshold if threshold is None else threshold
        return sum(c.counts_at(score)[1] for c in self.classes.values()) / max(1, self.pictures)

    def threshold_for(self, false_boxes: float = FALSE_BOXES_PER_PICTURE) -> float:
        """Return the lowest score, rounded up to 0.01, with at most `false_boxes` false positives per picture."""
        scores = [c.scores[~c.correct] for c in self.classes.values()] or [np.zeros(0)]
        false_scores = np.sort(np.concatenate(scores))[::-1]
        allowed = int(false_boxes * self.pictures)
        if allowed >= len(false_scores):
            return LOWEST_SCORE
        return min(0.99, math.ceil((float(false_scores[allowed]) + 1e-6) * 100.0) / 100.0)

    def as_json(self) -> dict[str, Any]:
        """Return the evaluation as a JSON object."""
        rows = {}
        for name, c in self.classes.items():
            correct, false = c.counts_at(self.threshold)
            rows[name] = {
                "objects": c.objects,
                "average_precision": _finite_or_none(c.average_precision),
                "recall": _finite_or_none(correct / c.objects if c.objects else math.nan),
                "precision": _finite_or_none(correct / (correct + false) if correct + false else math.nan),
            }
        return {
            "pictures": self.pictures,
            "iou": 0.5,
            "mean_average_precision": _finite_or_none(self.mean_average_precision),
            "threshold": self.threshold,
            "false_boxes_per_picture": _finite_or_none(self.false_boxes()),
            "classes": rows,
            "not_evaluated": dict(self.others),
        }


def _finite_or_none(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def evaluate(
    detector: Detector, pictures: Sequence[Picture], *, on_done: Callable[[int], None] | None = None
) -> Evaluation:
    """Run a detector on each picture and call `on_done` with the number done. Raises ConfigError for a bad picture.

    The detector's threshold must be at most LOWEST_SCORE; false boxes are counted at the model's own threshold.
    """
    detections: list[list[Detection]] = []
    for i, picture in enumerate(pictures):
        detections.append(detector.detect(read_rgb(picture)))
        if on_done is not None:
            on_done(i + 1)
    return evaluation_of(detector.model.score_threshold, pictures, detections, detector.model.classes)


def evaluation_of(
    threshold: float, pictures: Sequence[Picture], detections: Sequence[Sequence[Detection]], classes: Sequence[str]
) -> Evaluation:
    """Return the evaluation at a score threshold; `detections[i]` are those in `pictures[i]`, by falling score."""
    others = Counter(label for picture in pictures for label in picture.labels if label not in classes)
    return Evaluation(
        evaluate_classes(pictures, detections, classes), len(pictures), threshold, dict(others.most_common())
    )
