"""Object detectors trained on real photographs, run by OpenCV, which reads their files as they were published.

| name | trained on | input | score | known objects |
|---|---|---|---|---|
| ssd-mobilenetv2 | Open Images V4 | 300 x 300, RGB -1 to 1 | 0.3 | 23 classes |

Its score is lower than that of MediaPipe's graph, 0.5, at which it finds none of the people in bus.jpg. It stretches
the picture to its input, as its authors do. Overlapping boxes of one label are reduced to the best one (IoU above 0.6).
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion.detect.decode import suppressed  # noqa: E402

Float = NDArray[np.float64]
LOWEST_SCORE = 0.05  # boxes below are not kept; average precision needs those below the threshold
_MAX_BOXES = 100  # of a picture
_SSD_SIDES = (19, 10, 5, 3, 2, 1)  # cells along an edge of each level


class Found(NamedTuple):
    """Detected object: label, score and box (x_min, y_min, x_max, y_max) in pixels of the picture's edges."""

    label: str
    score: float
    box_px: tuple[float, float, float, float]


class Detector(ABC):
    """Detector with its labels and the score from which a box counts as found."""

    name: str
    threshold: float
    labels: tuple[str, ...]
    _max_overlap: float

    @abstractmethod
    def _scores_and_boxes(self, rgb: NDArray[np.uint8]) -> tuple[Float, Float]:
        """Return scores (n, labels) and boxes (n, 4) as shares of the picture's width and height."""

    def detect(self, rgb: NDArray[np.uint8]) -> tuple[list[Found], float]:
        """Return what is found in a picture (height, width, 3), by falling score, and the processor time [s]."""
        began = time.process_time()
        scores, boxes = self._scores_and_boxes(rgb)
        height, width = rgb.shape[:2]
        boxes = np.clip(boxes, 0.0, 1.0) * np.array([width, height, width, height])
        found = []
        for number in np.flatnonzero(scores.max(axis=0, initial=0.0) >= LOWEST_SCORE):
            score = scores[:, number]
            rows = np.flatnonzero(score >= LOWEST_SCORE)
            for row in suppressed(boxes[rows], score[rows], self._max_overlap, None):
                box = boxes[rows[row]].tolist()
                found.append(Found(self.labels[number], float(score[rows[row]]), tuple(box)))
        found.sort(key=lambda one: -one.score)
        return found[:_MAX_BOXES], time.process_time() - began


def shared_area(box: Float, boxes: Float) -> Float:
    """Return the area that a box (4,) shares with each of `boxes` (n, 4)."""
    low, high = np.maximum(box[:2], boxes[:, :2]), np.minimum(box[2:], boxes[:, 2:])
    size = np.maximum(high - low, 0.0)
    return size[:, 0] * size[:, 1]


def area(boxes: Float) -> Float:
    """Return the area of boxes (..., 4)."""
    return (boxes[..., 2] - boxes[..., 0]) * (boxes[..., 3] - boxes[..., 1])


def _sigmoid(values: NDArray[Any]) -> Float:
    return 1.0 / (1.0 + np.exp(-values.astype(np.float64)))


class SsdMobileNet(Detector):
    """SSD-MobileNetV2 of MediaPipe's Objectron, with the constants of object_detection_oid_v4_cpu.pbtxt there."""

    name, threshold, _max_overlap = "ssd-mobilenetv2", 0.3, 0.6

    def __init__(self, files: Mapping[str, bytes]) -> None:
        label_map = files["object_detection_oidv4_labelmap.txt"].decode().split("\n")
        self.labels = tuple(label.lower() for label in label_map[1:] if label)  # the first is the background
        self._net = cv2.dnn.readNetFromTFLite(np.frombuffer(files["object_detection_ssd.tflite"], np.uint8))
        self._anchors = ssd_anchors()

    def _scores_and_boxes(self, rgb: NDArray[np.uint8]) -> tuple[Float, Float]:
        self._net.setInput(cv2.dnn.blobFromImage(rgb, 1.0 / 127.5, (300, 300), (127.5,) * 3))
        logits = self._net.forward("raw_outputs/class_predictions").reshape(len(self._anchors), -1)
        codes = _rows_first(self._net.forward("raw_outputs/box_encodings").reshape(len(self._anchors), 4))
        x, y, width, height = self._anchors.T
        centres = np.stack([codes[:, 1] / 10.0 * width + x, codes[:, 0] / 10.0 * height + y], axis=1)
        halves = 0.5 * np.stack([np.exp(codes[:, 3] / 5.0) * width, np.exp(codes[:, 2] / 5.0) * height], axis=1)
        return _sigmoid(logits[:, 1:]), np.concatenate([centres - halves, centres + halves], axis=1)


def ssd_anchors() -> Float:
    """Return the anchors of SSD (Liu et al. 2016, section 2.2) at 300 pixels: (1917, 4) centre, width and height."""
    scales = [*np.linspace(0.2, 0.95, len(_SSD_SIDES)).tolist(), 1.0]
    anchors = []
    for level, side in enumerate(_SSD_SIDES):
        scale, ratios = scales[level], (1.0, 2.0, 0.5, 3.0, 1.0 / 3.0)
        if level == 0:
            shapes = [(0.1, 1.0), (scale, 2.0), (scale, 0.5)]
        else:
            shapes = [*((scale, ratio) for ratio in ratios), ((scale * scales[level + 1]) ** 0.5, 1.0)]
        for row in range(side):
            for column in range(side):
                centre = ((column + 0.5) / side, (row + 0.5) / side)
                anchors += [(*centre, size * ratio**0.5, size / ratio**0.5) for size, ratio in shapes]
    return np.array(anchors)


def _rows_first(codes: NDArray[Any]) -> NDArray[Any]:
    """Return the codes in the anchors' order. OpenCV leaves those of each level with channels before rows."""
    parts, first = [], 0
    for level, side in enumerate(_SSD_SIDES):
        count = side * side * (3 if level == 0 else 6)
        planes = codes[first : first + count].T.reshape(-1, 4, side, side)
        parts.append(planes.transpose(2, 3, 0, 1).reshape(-1, 4))
        first += count
    return np.concatenate(parts)


@dataclass(frozen=True)
class NetworkKind:
    """Detector, and the function that makes it of its files by name."""

    name: str
    make: Callable[[Mapping[str, bytes]], Detector]


NETWORKS = (NetworkKind(SsdMobileNet.name, SsdMobileNet),)
