"""Assignment of anchors to objects: adaptive training sample selection (Zhang et al. 2020, ATSS).

The anchors at the nearest positions of each level are an object's candidates. A candidate is assigned to the object if
its centre lies in the object's box and its IoU is at least the mean plus the standard deviation of all candidates' IoU.
The best candidate is always assigned, so that thin objects are not lost. Any other anchor claimed by two objects goes
to the one it overlaps more. Anchors of difficult objects are ignored in training of their class, and show no other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from hil_companion.detect.model_file import Level
from numpy.typing import NDArray

BACKGROUND = -1  # in place of a class; of a difficult object of class c it is `ignored(c)`
_NEAREST_POSITIONS = 9  # per level and object; the anchors there are the object's candidates


def ignored(class_number: Any) -> Any:
    """Return the target of difficult objects of a class, -2 or less: numbers or arrays. It is its own inverse."""
    return -2 - class_number


class Assigner:
    """Assigner of the anchors of `levels` to objects, for an input of width and height `input_px`."""

    def __init__(self, levels: Sequence[Level], input_px: tuple[int, int]) -> None:
        self._levels = list(levels)
        anchors_by_level = [level.anchors_px(input_px) for level in levels]
        self._centres = [
            a[:: level.anchors_per_position, :2] for a, level in zip(anchors_by_level, levels, strict=True)
        ]
        self.anchors_px = np.concatenate(anchors_by_level)
        centres, half = self.anchors_px[:, :2], 0.5 * self.anchors_px[:, 2:]
        self._corners = np.concatenate([centres - half, centres + half], axis=1)
        self._areas = self.anchors_px[:, 2] * self.anchors_px[:, 3]

    def targets(
        self, boxes_px: NDArray[np.float32], classes: NDArray[np.int64], difficult: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Return the targets of the N anchors: classes (N,) and boxes (N, 4) [px].

        A class is a class number, BACKGROUND or `ignored` of a number; the box of background is zero. `boxes_px` is
        (n, 4) x0, y0, x1, y1; `classes` and `difficult` are (n,).
        """
        target_classes = np.full(len(self.anchors_px), BACKGROUND, np.int64)
        target_px = np.zeros((len(self.anchors_px), 4), np.float32)
        if not len(boxes_px):
            return target_classes, target_px
        candidates = self._candidates(boxes_px)  # (objects, candidates)
        rows = np.arange(len(boxes_px))[:, None]
        iou = self._iou(boxes_px, candidates)
        min_iou = iou.mean(axis=1, keepdims=True) + iou.std(axis=1, keepdims=True)
        centre = self.anchors_px[candidates, :2]
        inside = ((centre > boxes_px[:, None, :2]) & (centre < boxes_px[:, None, 2:])).all(axis=2)
        assigned = (iou >= min_iou) & inside
        best = iou.argmax(axis=1)
        assigned[rows[:, 0], best] = True
        iou[rows[:, 0], best] += 1.0  # an object's best anchor must not go to another object
        # The last assignment wins, so anchors are sorted by rising overlap.
        objects, columns = np.nonzero(assigned)
        order = np.argsort(iou[objects, columns], kind="stable")
        objects, anchors = objects[order], candidates[objects, columns][order]
        target_classes[anchors] = np.where(difficult[objects], ignored(classes[objects]), classes[objects])
        target_px[anchors] = boxes_px[objects]
        return target_classes, target_px

    def _candidates(self, boxes_px: NDArray[np.float32]) -> NDArray[np.intp]:
        """Return each object's candidates, (objects, candidates): the anchors at each level's nearest positions."""
        middle = 0.5 * (boxes_px[:, :2] + boxes_px[:, 2:])
        candidates, first = [], 0
        for level, centres in zip(self._levels, self._centres, strict=True):
            distance2 = np.square(centres[:, 0] - middle[:, :1]) + np.square(centres[:, 1] - middle[:, 1:])
            nearest = np.argpartition(distance2, _NEAREST_POSITIONS, axis=1)[:, :_NEAREST_POSITIONS]
            anchors = first + nearest[:, :, None] * level.anchors_per_position + np.arange(level.anchors_per_position)
            candidates.append(anchors.reshape(len(boxes_px), -1))
            first += len(centres) * level.anchors_per_position
        return np.concatenate(candidates, axis=1)

    def _iou(self, boxes_px: NDArray[np.float32], candidates: NDArray[np.intp]) -> NDArray[np.float32]:
        corners, box = self._corners[candidates], boxes_px[:, None]
        common = np.minimum(corners[..., 2:], box[..., 2:]) - np.maximum(corners[..., :2], box[..., :2])
        area = np.maximum(common, 0.0).prod(axis=2)
        box_area = ((boxes_px[:, 2] - boxes_px[:, 0]) * (boxes_px[:, 3] - boxes_px[:, 1]))[:, None]
        ratio: NDArray[np.float32] = area / np.maximum(self._areas[candidates] + box_area - area, 1e-6)
        return ratio
