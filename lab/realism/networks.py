"""Object detectors trained on real photographs, run by OpenCV.

| name | trained on | input | score | known objects |
|---|---|---|---|---|
| yolov4-tiny | COCO | 416 x 416, RGB 0 to 1 | 0.25 (Darknet's default) | 80 classes |
| nanodet | COCO | 416 x 416, BGR less mean, by deviation | 0.35 (NanoDet's demo) | 80 classes |
| centernet | COCO | 512 x 512, RGB 0 to 255 | 0.3 | 80 classes |
| ssd-mobilenetv2 | Open Images V4 | 300 x 300, RGB -1 to 1 | 0.3 | 23 classes |

The SSD's score is lower than that of MediaPipe's graph, 0.5, at which it finds none of the people in bus.jpg. Every
network stretches the picture to its input, as its authors do. Overlapping boxes of one label are reduced to the
best one (IoU above 0.45 yolo, 0.6 the others).
"""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.config.companion.clients import make_client_importable
from lab.realism.darknet import YoloHead, read_darknet
from lab.realism.graph_model import read_graph_model

make_client_importable()

from hil_companion.detect.decode import suppressed  # noqa: E402

Float = NDArray[np.float64]
LOWEST_SCORE = 0.05  # boxes below are not kept; average precision needs those below the threshold
_MAX_BOXES = 100  # of a picture
_SSD_SIDES = (19, 10, 5, 3, 2, 1)  # cells along an edge of each level

_COCO = (
    "person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, stop sign, "
    "parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, backpack, umbrella, "
    "handbag, tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball bat, baseball glove, "
    "skateboard, surfboard, tennis racket, bottle, wine glass, cup, fork, knife, spoon, bowl, banana, apple, "
    "sandwich, orange, broccoli, carrot, hot dog, pizza, donut, cake, chair, couch, potted plant, bed, dining "
    "table, toilet, tv, laptop, mouse, remote, keyboard, cell phone, microwave, oven, toaster, sink, "
    "refrigerator, book, clock, vase, scissors, teddy bear, hair drier, toothbrush"
)
COCO_LABELS = tuple(_COCO.split(", "))


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


class YoloTiny(Detector):
    """YOLOv4-tiny (Wang et al. 2021): sigmoids of Darknet's outputs at strides 32 and 16."""

    name, threshold, labels, _max_overlap = "yolov4-tiny", 0.25, COCO_LABELS, 0.45

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._model = read_darknet(files["yolov4-tiny.cfg"].decode(), files["yolov4-tiny.weights"])
        self._net = _open(self._model.onnx)

    def _scores_and_boxes(self, rgb: NDArray[np.uint8]) -> tuple[Float, Float]:
        size = (self._model.width, self._model.height)
        self._net.setInput(cv2.dnn.blobFromImage(rgb, 1.0 / 255.0, size))
        levels = self._net.forward(list(self._model.outputs))
        parts = [_yolo_level(level[0], head, size) for level, head in zip(levels, self._model.heads, strict=True)]
        return np.concatenate([scores for scores, _ in parts]), np.concatenate([boxes for _, boxes in parts])


def _yolo_level(level: NDArray[np.float32], head: YoloHead, size: tuple[int, int]) -> tuple[Float, Float]:
    """Decode a level (anchors * (5 + classes), rows, columns).

    Centre: s sigmoid(t) - (s - 1) / 2 + cell, with s the head's scale; size: exp(t) times the anchor.
    """
    rows, columns = level.shape[1:]
    values = level.reshape(len(head.anchors_px), -1, rows, columns).transpose(0, 2, 3, 1)
    scores = _sigmoid(values[..., 5:]) * _sigmoid(values[..., 4:5])
    cells = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
    centres = (head.scale_xy * _sigmoid(values[..., :2]) - 0.5 * (head.scale_xy - 1.0) + cells) / (columns, rows)
    halves = 0.5 * np.exp(values[..., 2:4].astype(np.float64)) * head.anchors_px[:, None, None] / size
    boxes = np.concatenate([centres - halves, centres + halves], axis=-1)
    return scores.reshape(-1, scores.shape[-1]), boxes.reshape(-1, 4)


class NanoDet(Detector):
    """NanoDet: scores, and for each edge a distribution of its distance from the cell's centre (Li et al. 2020)."""

    name, threshold, labels, _max_overlap = "nanodet", 0.35, COCO_LABELS, 0.6
    _size_px = 416
    _mean, _deviation = (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)  # of B, G and R in ImageNet

    def __init__(self, files: Mapping[str, bytes]) -> None:
        onnx, self._outputs = read_graph_model(json.loads(files["nanodet.json"]), files["nanodet.bin"])
        self._net = _open(onnx)

    def _scores_and_boxes(self, rgb: NDArray[np.uint8]) -> tuple[Float, Float]:
        size = (self._size_px, self._size_px)
        blob = cv2.dnn.blobFromImage(rgb, 1.0, size, self._mean, swapRB=True)
        self._net.setInput(blob / np.array(self._deviation, np.float32).reshape(1, 3, 1, 1))
        outputs = [output[0] for output in self._net.forward(list(self._outputs))]
        scores, boxes = [], []
        for level in sorted(len(output) for output in outputs if output.shape[1] == len(self.labels)):
            of_level = [output for output in outputs if len(output) == level]
            score = next(output for output in of_level if output.shape[1] == len(self.labels))
            edges = next(output for output in of_level if output.shape[1] != len(self.labels))
            scores.append(score.astype(np.float64))
            boxes.append(_edges_to_boxes(edges.astype(np.float64)))
        return np.concatenate(scores), np.concatenate(boxes)


def _edges_to_boxes(edges: Float) -> Float:
    """Return boxes (n, 4) as shares of the input; `edges`: (n, 4 * bins), logits of the distance in strides."""
    side = round(len(edges) ** 0.5)
    logits = edges.reshape(len(edges), 4, -1)
    weights = np.exp(logits - logits.max(axis=2, keepdims=True))
    distance = (weights @ np.arange(logits.shape[2])) / weights.sum(axis=2)
    x, y = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    centre = np.stack([x.ravel(), y.ravel()], axis=1)
    return np.concatenate([centre - distance[:, :2], centre + distance[:, 2:]], axis=1) / side


class CenterNet(Detector):
    """CenterNet (Zhou et al. 2019): peaks of each label's map, and at each the distances of the four edges."""

    name, threshold, labels, _max_overlap = "centernet", 0.3, COCO_LABELS, 0.6
    _size_px = 512
    _outputs = ("tower_0/wh", "tower_0/keypoints")

    def __init__(self, files: Mapping[str, bytes]) -> None:
        onnx, names = read_graph_model(json.loads(files["centernet.json"]), files["centernet.bin"], self._outputs)
        self._names = names
        self._net = _open(onnx)

    def _scores_and_boxes(self, rgb: NDArray[np.uint8]) -> tuple[Float, Float]:
        self._net.setInput(cv2.dnn.blobFromImage(rgb, 1.0, (self._size_px, self._size_px)))
        edges, scores = (output[0] for output in self._net.forward(list(self._names)))
        peaks = np.where(cv2.dilate(scores.max(axis=2), np.ones((3, 3))) == scores.max(axis=2))
        rows, columns = peaks
        stride = self._size_px / len(scores)
        centres = np.stack([columns, rows], axis=1) * stride
        distances = edges[peaks].astype(np.float64)
        boxes = np.concatenate([centres - distances[:, :2], centres + distances[:, 2:]], axis=1)
        return scores[peaks].astype(np.float64), boxes / self._size_px


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


def _open(onnx: bytes) -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(np.frombuffer(onnx, np.uint8))


@dataclass(frozen=True)
class NetworkKind:
    """Detector, and the function that makes it of its files by name.

    `is_judged`: its figures enter the checks. The others tell whether the pictures please only the judged networks.
    """

    name: str
    make: Callable[[Mapping[str, bytes]], Detector]
    is_judged: bool = True


NETWORKS = (
    *(NetworkKind(kind.name, kind) for kind in (YoloTiny, NanoDet, SsdMobileNet)),
    NetworkKind(CenterNet.name, CenterNet, is_judged=False),
)
