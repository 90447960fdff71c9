"""Decoding of a network's outputs: scores, boxes, and non-maximum suppression.

With anchor (x, y, w, h) and offsets (a, b, c, d), after Liu et al. (2016), SSD, with the usual variances:

    centre = (x + 0.1 a w, y + 0.1 b h)      size = (w exp(0.2 c), h exp(0.2 d))      score = 1 / (1 + exp(-logit))

Detections are ordered by score, equal scores by class and then by anchor, so that equal outputs give equal lists.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from hil_companion.detect.model_file import ModelFile

_FILL = 114  # of 255: about the mean of camera pictures
CENTRE_VARIANCE, SIZE_VARIANCE = 0.1, 0.2
_MAX_GROWTH = 4.0  # largest exponent of the size; larger offsets are not boxes, but must not overflow
_MAX_CANDIDATES = 400  # per class, before suppression
MAX_DETECTIONS = 100  # per picture


@dataclass(frozen=True)
class Detection:
    """One box of a picture. `box_px`: x0, y0, x1, y1 in pixels; x1 - x0 is the width."""

    label: str
    box_px: tuple[float, float, float, float]
    score: float  # 0 to 1
    range_m: float | None = None  # from depth or the ground
    radial_speed_mps: float | None = None  # from a radar; positive: receding
    p_W: tuple[float, float, float] | None = None  # by geolocation


@dataclass(frozen=True)
class Letterbox:
    """Mapping of a picture of any size into a network's input: input pixel = picture pixel * scale + shift.

    Both directions have the same scale, so that nothing is stretched; the remaining margins are filled with grey.
    """

    scale: float
    shift_x_px: int
    shift_y_px: int
    placed_px: tuple[int, int]  # width, height of the picture within the input

    @classmethod
    def of(cls, picture_px: tuple[int, int], input_px: tuple[int, int]) -> Letterbox:
        """Make the mapping for a picture and an input of these widths and heights."""
        scale = min(input_px[0] / picture_px[0], input_px[1] / picture_px[1])
        width = max(1, min(input_px[0], round(picture_px[0] * scale)))
        height = max(1, min(input_px[1], round(picture_px[1] * scale)))
        return cls(scale, (input_px[0] - width) // 2, (input_px[1] - height) // 2, (width, height))

    def place(self, rgb: np.ndarray, out: np.ndarray) -> None:
        """Write the scaled picture into `out` (height, width, 3) uint8."""
        width, height = self.placed_px
        if (width, height) != (out.shape[1], out.shape[0]):
            out[:] = _FILL
        shrinks = rgb.shape[1] > width
        part = out[self.shift_y_px : self.shift_y_px + height, self.shift_x_px : self.shift_x_px + width]
        if rgb.shape[:2] == (height, width):
            part[:] = rgb
        else:
            part[:] = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)

    def back(self, boxes_px: np.ndarray) -> np.ndarray:
        """Convert boxes (N, 4) from pixels of the input to pixels of the picture."""
        shift = np.array([self.shift_x_px, self.shift_y_px, self.shift_x_px, self.shift_y_px], np.float64)
        return (boxes_px - shift) / self.scale


def boxes_px(anchors_px: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return boxes (N, 4) as x0, y0, x1, y1 in pixels of the input, from anchors and offsets (N, 4)."""
    centre = anchors_px[:, :2] + CENTRE_VARIANCE * offsets[:, :2] * anchors_px[:, 2:]
    half = 0.5 * anchors_px[:, 2:] * np.exp(np.clip(SIZE_VARIANCE * offsets[:, 2:], -_MAX_GROWTH, _MAX_GROWTH))
    return np.concatenate([centre - half, centre + half], axis=1)


def overlaps(box: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the intersection over union of a box (4,) with each of (N, 4)."""
    width = np.minimum(box[2], others[:, 2]) - np.maximum(box[0], others[:, 0])
    height = np.minimum(box[3], others[:, 3]) - np.maximum(box[1], others[:, 1])
    common = np.maximum(width, 0.0) * np.maximum(height, 0.0)
    areas = (others[:, 2] - others[:, 0]) * (others[:, 3] - others[:, 1])
    union = (box[2] - box[0]) * (box[3] - box[1]) + areas - common
    return np.where(union > 0.0, common / np.where(union > 0.0, union, 1.0), 0.0)


def suppressed(boxes: np.ndarray, scores: np.ndarray, iou: float, most: int | None = _MAX_CANDIDATES) -> list[int]:
    """Return the indices of the remaining boxes, best first. Each removes worse boxes that overlap it by over `iou`.

    `most`: the number of boxes that are looked at, the best ones; None: all.
    """
    left = np.argsort(-scores, kind="stable")[:most]
    kept: list[int] = []
    while left.size:
        best = int(left[0])
        kept.append(best)
        left = left[1:][overlaps(boxes[best], boxes[left[1:]]) <= iou]
    return kept


def decode(
    model: ModelFile,
    logits: np.ndarray,
    offsets: np.ndarray,
    picture_size_px: tuple[int, int],
    threshold: float | None = None,
) -> list[Detection]:
    """Return the detections of a picture (width, height) from logits (N, classes) and offsets (N, 4), best first.

    `threshold`: the lowest score, default the model's. Boxes are clipped at the picture's edges. Raises ValueError for
    outputs of another network.
    """
    anchors, classes = model.anchors_px, len(model.classes)
    if logits.shape != (len(anchors), classes) or offsets.shape != (len(anchors), 4):
        raise ValueError(
            f"logits {logits.shape} and offsets {offsets.shape} for {len(anchors)} anchors and {classes} classes"
        )
    min_score = model.score_threshold if threshold is None else threshold
    # Logits are compared, to compute the exponential only for the few that remain. A NaN is never a detection.
    min_logit = (
        -np.inf if min_score <= 0.0 else np.inf if min_score >= 1.0 else float(np.log(min_score / (1.0 - min_score)))
    )
    candidates = logits >= min_logit
    width, height = picture_size_px
    found: list[tuple[float, int, int, np.ndarray]] = []
    fit = Letterbox.of(picture_size_px, model.input_px)
    for number in np.flatnonzero(candidates.any(axis=0)).tolist():
        rows = np.flatnonzero(candidates[:, number])
        boxes = boxes_px(anchors[rows].astype(np.float64), offsets[rows].astype(np.float64))
        whole = np.isfinite(boxes).all(axis=1)
        rows, boxes = rows[whole], boxes[whole]
        scores = 1.0 / (1.0 + np.exp(-logits[rows, number].astype(np.float64)))
        for i in suppressed(boxes, scores, model.nms_iou):
            found.append((-float(scores[i]), number, int(rows[i]), boxes[i]))
    found.sort(key=lambda f: f[:3])
    detections: list[Detection] = []
    for negative_score, number, _, box in found[:MAX_DETECTIONS]:
        x0, y0, x1, y1 = np.clip(fit.back(box[None])[0], 0.0, (width, height, width, height)).tolist()
        if x1 > x0 and y1 > y0:
            detections.append(Detection(model.classes[number], (x0, y0, x1, y1), -negative_score))
    return detections
