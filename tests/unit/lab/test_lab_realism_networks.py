"""Conversion of networks to ONNX, and decoding of their outputs, against closed forms."""

from __future__ import annotations

import base64
from typing import Any

import cv2
import numpy as np
import pytest

from lab.realism import networks
from lab.realism.darknet import YoloHead, read_darknet
from lab.realism.graph_model import read_graph_model
from signals.errors import RecordingError

CFG = """\
[net]
width=4
height=4
channels=2
[convolutional]  # 1 x 1 with batch normalisation
batch_normalize=1
filters=4
size=1
stride=1
pad=1
activation=leaky
[route]
layers=-1
groups=2
group_id=1
[maxpool]
size=2
stride=2
[upsample]
stride=2
[route]
layers=-1,0
[convolutional]
filters=6
size=1
stride=1
pad=1
activation=linear
[yolo]
mask=1
anchors=10,14, 23,27
scale_x_y=1.05
"""


def run(onnx: bytes, blob: np.ndarray, outputs: tuple[str, ...]) -> list[np.ndarray]:
    net = cv2.dnn.readNetFromONNX(np.frombuffer(onnx, np.uint8))
    net.setInput(blob)
    return list(net.forward(list(outputs)))


def test_a_darknet_network_gives_the_same_numbers_as_its_definition() -> None:
    rng = np.random.default_rng(1)
    bias, scale, mean, kernel = (rng.normal(size=n) for n in (4, 4, 4, (4, 2)))
    variance = rng.uniform(0.5, 2.0, 4)
    bias2, kernel2 = rng.normal(size=6), rng.normal(size=(6, 6))
    values = np.concatenate([v.ravel() for v in (bias, scale, mean, variance, kernel, bias2, kernel2)])
    weights = bytes(20) + values.astype(np.float32).tobytes()
    model = read_darknet(CFG, weights)
    x = rng.normal(size=(1, 2, 4, 4)).astype(np.float32)

    def per_channel(v: np.ndarray) -> np.ndarray:
        return v[:, None, None]

    a = np.einsum("oc,chw->ohw", kernel, x[0])
    a = (a - per_channel(mean)) / np.sqrt(per_channel(variance)) * per_channel(scale) + per_channel(bias)
    a = np.where(a > 0, a, 0.1 * a)
    pooled = a[2:].reshape(2, 2, 2, 2, 2).max(axis=(2, 4))
    joined = np.concatenate([pooled.repeat(2, axis=1).repeat(2, axis=2), a])
    expected = np.einsum("oc,chw->ohw", kernel2, joined) + per_channel(bias2)
    (found,) = run(model.onnx, x, model.outputs)
    np.testing.assert_allclose(found[0], expected, atol=1e-4)
    assert model.heads[0].anchors_px.tolist() == [[23.0, 27.0]]
    with pytest.raises(RecordingError, match="the weights end before the last layer"):
        read_darknet(CFG, weights[:-4])
    with pytest.raises(RecordingError, match="1 weights are left"):
        read_darknet(CFG, weights + bytes(4))
    with pytest.raises(RecordingError, match="unknown kind 'dropout'"):
        read_darknet(CFG + "[dropout]\n", weights)


def constant(name: str, shape: list[int], dtype: str = "float32") -> dict[str, Any]:
    return {"name": name, "shape": shape, "dtype": dtype}


def test_a_graph_model_gives_the_same_numbers_as_its_definition() -> None:
    rng = np.random.default_rng(2)
    kernel, bias = rng.normal(size=(1, 1, 2, 3)).astype(np.float32), rng.normal(size=3).astype(np.float32)
    manifest = [constant("k", [1, 1, 2, 3]), constant("b", [3])]
    manifest += [constant("last", [4], "int32"), constant("first", [4], "int32"), constant("shape", [3], "int32")]
    weights = kernel.tobytes() + bias.tobytes()
    weights += np.array([0, 2, 3, 1, 0, 3, 1, 2, 1, 3, 16], np.int32).tobytes()

    def node(name: str, op: str, *inputs: str, **attr: Any) -> dict[str, Any]:
        return {"name": name, "op": op, "input": list(inputs), "attr": attr}

    def integers(*values: int) -> dict[str, Any]:
        return {"list": {"i": [str(value) for value in values]}}

    valid = {"s": base64.b64encode(b"VALID").decode()}
    nodes = [
        node("x", "Placeholder"),
        node("to_last", "Transpose", "x", "last"),
        node("conv", "Conv2D", "to_last", "k", padding=valid, strides=integers(1, 1, 1, 1)),
        node("sum", "Add", "conv", "b"),
        node("to_first", "Transpose", "sum", "first"),
        node("leaky", "LeakyRelu", "to_first", alpha={"f": 0.1}),
        node("flat", "Reshape", "leaky", "shape"),
    ]
    dims = [{"size": str(size)} for size in (1, 2, 4, 4)]
    model = {
        "signature": {
            "inputs": {"x": {"name": "x:0", "tensorShape": {"dim": dims}}},
            "outputs": {"y": {"name": "flat:0", "tensorShape": {"dim": dims[:3]}}},
        },
        "modelTopology": {"node": nodes},
        "weightsManifest": [{"weights": manifest}],
    }
    x = rng.normal(size=(1, 2, 4, 4)).astype(np.float32)
    expected = np.einsum("co,chw->ohw", kernel[0, 0], x[0]) + bias[:, None, None]
    onnx, outputs = read_graph_model(model, weights)
    (found,) = run(onnx, x, outputs)
    np.testing.assert_allclose(found[0], np.where(expected > 0, expected, 0.1 * expected).reshape(3, 16), atol=1e-5)
    with pytest.raises(RecordingError, match="the weights end"):
        read_graph_model(model, weights[:-1])
    nodes[5]["op"] = "Selu"
    with pytest.raises(RecordingError, match="the operation 'Selu' is not known"):
        read_graph_model(model, weights)


def test_boxes_of_a_yolo_level() -> None:
    level = np.full((6, 2, 2), -20.0, np.float32)  # one anchor, one class
    level[:, 1, 0] = (0.0, 0.0, np.log(2.0), 0.0, 20.0, 0.0)  # centre of the cell, twice the anchor's width
    scores, boxes = networks._yolo_level(level, YoloHead(np.array([[8.0, 16.0]]), 1.05), (32, 32))
    assert scores[2, 0] == pytest.approx(0.5)
    assert scores[[0, 1, 3], 0].max() < 1e-6
    np.testing.assert_allclose(boxes[2], [0.0, 0.5, 0.5, 1.0], atol=1e-6)


def test_edges_of_nanodet_are_means_of_distributions() -> None:
    edges = np.zeros((4, 4 * 3))
    edges[1, 0:3] = (0.0, 50.0, 0.0)  # the left edge is one stride away; the others: the mean of 0, 1 and 2
    boxes = networks._edges_to_boxes(edges)
    np.testing.assert_allclose(boxes[0] * 2.0, [-0.5, -0.5, 1.5, 1.5])
    np.testing.assert_allclose(boxes[1] * 2.0, [0.5, -0.5, 2.5, 1.5])


def test_anchors_of_the_ssd() -> None:
    anchors = networks.ssd_anchors()
    assert len(anchors) == 19 * 19 * 3 + 6 * (100 + 25 + 9 + 4 + 1)
    np.testing.assert_allclose(anchors[0], [0.5 / 19, 0.5 / 19, 0.1, 0.1])
    np.testing.assert_allclose(anchors[-6], [0.5, 0.5, 0.95, 0.95])


def test_overlapping_boxes_are_reduced_to_the_best() -> None:
    boxes = np.array([[0.0, 0.0, 10.0, 10.0], [1.0, 0.0, 11.0, 10.0], [30.0, 0.0, 40.0, 10.0]])
    assert networks.suppressed(boxes, np.array([0.5, 0.9, 0.1]), 0.45, None) == [1, 2]
    assert networks.suppressed(boxes, np.array([0.5, 0.9, 0.1]), 0.85, None) == [1, 0, 2]
