"""Darknet networks (cfg text and weights) as ONNX models. OpenCV 5 no longer reads Darknet's files.

The layers are those of yolov4-tiny: convolutional, route, maxpool, upsample and yolo. The weights file holds float32
after a header of 20 bytes: for each convolution the bias, or with batch normalisation bias, scale, mean and variance,
then the kernel (https://github.com/AlexeyAB/darknet, src/parser.c). The normalisation is folded into the kernel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.realism.onnx_file import OnnxGraph
from signals.errors import RecordingError

_HEADER_BYTES = 20
_EPSILON = 1e-6  # of darknet's batch normalisation


@dataclass(frozen=True)
class YoloHead:
    """One output of a YOLO network: (1, anchors * (5 + classes), rows, columns), before the sigmoids."""

    anchors_px: NDArray[np.float64]  # (n, 2) width and height at the input size
    scale_xy: float


@dataclass(frozen=True)
class DarknetModel:
    """ONNX model of a Darknet network, its input size and heads in the order of the outputs."""

    onnx: bytes
    width: int
    height: int
    outputs: tuple[str, ...]
    heads: tuple[YoloHead, ...]


def read_darknet(cfg: str, weights: bytes) -> DarknetModel:
    """Convert a network. Raises RecordingError for unknown layers and for a file of weights of another length."""
    net, *layers = _sections(cfg)
    values = _Weights(np.frombuffer(weights, np.float32, offset=_HEADER_BYTES))
    graph = OnnxGraph()
    last, channels = "input", int(net[1]["channels"])
    made: list[tuple[str, int]] = []  # output and channels of each layer
    outputs: list[str] = []
    heads: list[YoloHead] = []
    for number, (kind, keys) in enumerate(layers):
        if kind == "convolutional":
            last, channels = _convolution(graph, values, keys, last, channels)
        elif kind == "route":
            last, channels = _route(graph, keys, made, number)
        elif kind == "maxpool":
            size = int(keys["size"])
            last = graph.add("MaxPool", [last], kernel_shape=[size] * 2, strides=[int(keys["stride"])] * 2)
        elif kind == "upsample":
            scales = graph.constant(np.array([1.0, 1.0, *[float(keys["stride"])] * 2], np.float32))
            last = graph.add(
                "Resize",
                [last, "", scales],
                mode="nearest",
                coordinate_transformation_mode="asymmetric",
                nearest_mode="floor",
            )
        elif kind == "yolo":
            anchors = np.array([float(v) for v in keys["anchors"].split(",")]).reshape(-1, 2)
            mask = [int(v) for v in keys["mask"].split(",")]
            heads.append(YoloHead(anchors[mask], float(keys.get("scale_x_y", "1"))))
            outputs.append(last)
        else:
            raise RecordingError(f"Darknet network: layer {number} is of the unknown kind {kind!r}")
        made.append((last, channels))
    values.finish()
    width, height = int(net[1]["width"]), int(net[1]["height"])
    model = graph.model("input", (1, int(net[1]["channels"]), height, width), outputs, axes=4)
    return DarknetModel(model, width, height, tuple(outputs), tuple(heads))


class _Weights:
    def __init__(self, values: NDArray[np.float32]) -> None:
        self._values, self._at = values, 0

    def take(self, *shape: int) -> NDArray[np.float64]:
        count = int(np.prod(shape))
        if self._at + count > len(self._values):
            raise RecordingError("Darknet network: the weights end before the last layer")
        self._at += count
        return self._values[self._at - count : self._at].reshape(shape).astype(np.float64)

    def finish(self) -> None:
        if self._at != len(self._values):
            raise RecordingError(
                f"Darknet network: {len(self._values) - self._at} weights are left after the last layer"
            )


def _sections(cfg: str) -> list[tuple[str, dict[str, str]]]:
    sections: list[tuple[str, dict[str, str]]] = []
    for line in cfg.splitlines():
        line = line.split("#")[0].strip()
        if line.startswith("["):
            sections.append((line.strip("[]"), {}))
        elif line:
            key, _, value = line.partition("=")
            sections[-1][1][key.strip()] = value.strip()
    return sections


def _convolution(
    graph: OnnxGraph, values: _Weights, keys: dict[str, str], source: str, channels: int
) -> tuple[str, int]:
    filters, size, stride = int(keys["filters"]), int(keys["size"]), int(keys["stride"])
    bias, factor = values.take(filters), np.ones(filters)
    if keys.get("batch_normalize") == "1":
        scale, mean, variance = values.take(filters), values.take(filters), values.take(filters)
        factor = scale / (np.sqrt(variance) + _EPSILON)
        bias = bias - mean * factor
    kernel = values.take(filters, channels, size, size) * factor[:, None, None, None]
    pads = [size // 2 if keys.get("pad") == "1" else 0] * 4
    inputs = [source, graph.constant(kernel), graph.constant(bias)]
    last = graph.add("Conv", inputs, kernel_shape=[size, size], strides=[stride, stride], pads=pads)
    if keys["activation"] == "leaky":
        last = graph.add("LeakyRelu", [last], alpha=0.1)
    elif keys["activation"] != "linear":
        raise RecordingError(f"Darknet network: unknown activation {keys['activation']!r}")
    return last, filters


def _route(graph: OnnxGraph, keys: dict[str, str], made: list[tuple[str, int]], number: int) -> tuple[str, int]:
    numbers = [int(v) for v in keys["layers"].split(",")]
    sources = [made[number + n if n < 0 else n] for n in numbers]
    channels = sum(count for _, count in sources)
    last = sources[0][0] if len(sources) == 1 else graph.add("Concat", [name for name, _ in sources], axis=1)
    groups = int(keys.get("groups", "1"))
    if groups > 1:
        width = channels // groups
        first = int(keys["group_id"]) * width
        bounds = [graph.constant(np.array([value])) for value in (first, first + width, 1)]
        last, channels = graph.add("Slice", [last, *bounds]), width
    return last, channels
