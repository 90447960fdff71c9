"""Assignment of anchors to objects: adaptive training sample selection (Zhang et al. 2020, ATSS).

The anchors at the nearest positions of each level are an object's candidates. A candidate is assigned to the object if
its centre lies in the object's box and its IoU is at least the mean plus the standard deviation of all candidates' IoU.
The best candidate is always assigned, so that thin objects are not lost. Any other anchor claimed by two objects goes
to the one it overlaps more. Anchors of difficult objects are ignored in training.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hil_companion.detect.model_file import Level
from numpy.typing import NDArray

BACKGROUND, IGNORED = -1, -2  # in place of a class
_NEAREST = 9  # positions of each level


class Assigner:
    """Assigns anchors of given levels, for an input of width and height `input_px`."""

    def __init__(self, levels: Sequence[Level], input_px: tuple[int, int]) -> None:
        self._levels = list(levels)
        of_level = [level.anchors_px(input_px) for level in levels]
        self._centres = [a[:: level.per_place, :2] for a, level in zip(of_level, levels, strict=True)]
        self.anchors_px = np.concatenate(of_level)
        centres, half = self.anchors_px[:, :2], 0.5 * self.anchors_px[:, 2:]
        self._corners = np.concatenate([centres - half, centres + half], axis=1)
        self._areas = self.anchors_px[:, 2] * self.anchors_px[:, 3]

    def targets(
        self, boxes_px: NDArray[np.float32], classes: NDArray[np.int64], difficult: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Return each anchor's class, (N,), or BACKGROUND or IGNORED, and its target box, (N, 4) px, zeros for none.

        `boxes_px` is (n, 4) x0, y0, x1, y1; `classes` and `difficult` are (n,).
        """
        found = np.full(len(self.anchors_px), BACKGROUND, np.int64)
        target = np.zeros((len(self.anchors_px), 4), np.float32)
        if not len(boxes_px):
            return found, target
        candidates = self._candidates(boxes_px)  # (objects, candidates)
        rows = np.arange(len(boxes_px))[:, None]
        iou = self._overlaps(boxes_px, candidates)
        least = iou.mean(axis=1, keepdims=True) + iou.std(axis=1, keepdims=True)
        centre = self.anchors_px[candidates, :2]
        inside = ((centre > boxes_px[:, None, :2]) & (centre < boxes_px[:, None, 2:])).all(axis=2)
        assigned = (iou >= least) & inside
        best = iou.argmax(axis=1)
        assigned[rows[:, 0], best] = True
        iou[rows[:, 0], best] += 1.0  # an object's best anchor must not go to another object
        # The last assignment wins, so anchors are sorted by rising overlap.
        objects, columns = np.nonzero(assigned)
        order = np.argsort(iou[objects, columns], kind="stable")
        objects, anchors = objects[order], candidates[objects, columns][order]
        found[anchors] = np.where(difficult[objects], IGNORED, classes[objects])
        target[anchors] = boxes_px[objects]
        return found, target

    def _candidates(self, boxes_px: NDArray[np.float32]) -> NDArray[np.intp]:
        """Return each object's candidates, (objects, candidates): the anchors at each level's nearest positions."""
        middle = 0.5 * (boxes_px[:, :2] + boxes_px[:, 2:])
        found, first = [], 0
        for level, centres in zip(self._levels, self._centres, strict=True):
            distance2 = np.square(centres[:, 0] - middle[:, :1]) + np.square(centres[:, 1] - middle[:, 1:])
            nearest = np.argpartition(distance2, _NEAREST, axis=1)[:, :_NEAREST]
            anchors = first + nearest[:, :, None] * level.per_place + np.arange(level.per_place)
            found.append(anchors.reshape(len(boxes_px), -1))
            first += len(centres) * level.per_place
        return np.concatenate(found, axis=1)

    def _overlaps(self, boxes_px: NDArray[np.float32], candidates: NDArray[np.intp]) -> NDArray[np.float32]:
        corners, box = self._corners[candidates], boxes_px[:, None]
        common = np.minimum(corners[..., 2:], box[..., 2:]) - np.maximum(corners[..., :2], box[..., :2])
        area = np.maximum(common, 0.0).prod(axis=2)
        of_box = ((boxes_px[:, 2] - boxes_px[:, 0]) * (boxes_px[:, 3] - boxes_px[:, 1]))[:, None]
        ratio: NDArray[np.float32] = area / np.maximum(self._areas[candidates] + of_box - area, 1e-6)
        return ratio
