"""Which anchors shall find which object: adaptive training sample selection (Zhang et al. 2020, ATSS).

For each object the nearest places of each level are candidates; those whose overlap with it is at least the mean plus
the standard deviation of all candidates' overlaps, and whose centre lies in it, are its anchors. The best candidate
always is, so that nothing is left out for being thin. Any other anchor of two objects goes to the one it overlaps more.
Anchors of objects that nobody need find say nothing in training.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hil_companion.detect.model_file import Level
from numpy.typing import NDArray

BACKGROUND, NOTHING = -1, -2  # in place of a class
_NEAREST = 9  # places of each level


class Assigner:
    """For one arrangement of anchors."""

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
        """Class of each anchor (or BACKGROUND, NOTHING), and the box that it is to find (zeros for none)."""
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
        taken = (iou >= least) & inside
        best = iou.argmax(axis=1)
        taken[rows[:, 0], best] = True
        iou[rows[:, 0], best] += 1.0  # that one is not lost to a neighbour who has others
        # The last one written wins, so the largest overlaps come last.
        objects, places = np.nonzero(taken)
        order = np.argsort(iou[objects, places], kind="stable")
        objects, anchors = objects[order], candidates[objects, places][order]
        found[anchors] = np.where(difficult[objects], NOTHING, classes[objects])
        target[anchors] = boxes_px[objects]
        return found, target

    def _candidates(self, boxes_px: NDArray[np.float32]) -> NDArray[np.intp]:
        """Of each object, (objects, candidates): all shapes at the nearest places of each level."""
        middle = 0.5 * (boxes_px[:, :2] + boxes_px[:, 2:])
        found, first = [], 0
        for level, centres in zip(self._levels, self._centres, strict=True):
            away = np.square(centres[:, 0] - middle[:, :1]) + np.square(centres[:, 1] - middle[:, 1:])
            nearest = np.argpartition(away, _NEAREST, axis=1)[:, :_NEAREST]
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
