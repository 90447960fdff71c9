"""TensorFlow.js graph models (model.json and one file of weights) as ONNX models.

Only the operations of the NanoDet model are known. TensorFlow convolves with channels last, ONNX with channels first:
each value is held with channels first together with a mark that tells which order the graph means, so that a transpose
between the two orders only changes the mark.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.realism.onnx_file import OnnxGraph
from signals.errors import RecordingError

_TO_LAST, _TO_FIRST = (0, 2, 3, 1), (0, 3, 1, 2)
_INT32 = 3  # DataType of TensorFlow


class _Value(NamedTuple):
    name: str
    channels_last: bool = False  # order that the graph means; the ONNX value has channels first


def read_graph_model(model: Mapping[str, Any], weights: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Return the ONNX model and its outputs, in the order of the signature.

    Raises RecordingError for an operation that is not known, or weights that do not fit.
    """
    return _Converter(model, weights).convert()


class _Converter:
    def __init__(self, model: Mapping[str, Any], weights: bytes) -> None:
        self._nodes = {node["name"]: node for node in model["modelTopology"]["node"]}
        self._signature = model["signature"]
        self._constants = _constants(model, weights)
        self._graph = OnnxGraph()
        self._values: dict[str, _Value] = {}

    def convert(self) -> tuple[bytes, tuple[str, ...]]:
        inputs = list(self._signature["inputs"].values())
        shape = [int(dim["size"]) for dim in inputs[0]["tensorShape"]["dim"]]
        source = inputs[0]["name"].split(":")[0]
        self._values[source] = _Value(source)
        names = [output["name"].split(":")[0] for output in self._signature["outputs"].values()]
        outputs = tuple(self._plain(name).name for name in names)
        return self._graph.model(source, shape, outputs, axes=3), outputs

    def _array(self, name: str) -> NDArray[Any]:
        """Return the value of a constant."""
        if name not in self._constants:
            raise RecordingError(f"graph model: {name!r} is not a constant")
        return self._constants[name]

    def _value(self, name: str) -> _Value:
        if name not in self._values:
            source, _, index = name.partition(":")
            node = self._nodes[source]
            made = self._node(node["op"], node.get("input", []), node.get("attr", {}))
            for i, value in enumerate(made):
                self._values[f"{source}:{i}"] = value
            self._values[source] = made[0]
            name = f"{source}:{index or 0}"
        return self._values[name]

    def _plain(self, name: str) -> _Value:
        value = self._value(name)
        if not value.channels_last:
            return value
        return _Value(self._graph.add("Transpose", [value.name], perm=list(_TO_LAST)))

    def _node(self, kind: str, inputs: Sequence[str], attributes: Mapping[str, Any]) -> list[_Value]:
        add = self._graph.add
        if kind == "Identity":
            return [self._value(inputs[0])]
        if kind == "Transpose":
            return [self._transpose(self._value(inputs[0]), tuple(self._array(inputs[1]).tolist()))]
        if kind in ("LeakyRelu", "Sigmoid"):
            source = self._value(inputs[0])
            alpha = {"alpha": float(attributes["alpha"]["f"])} if kind == "LeakyRelu" else {}
            return [_Value(add(kind, [source.name], **alpha), source.channels_last)]
        if kind == "Conv2D":
            return [self._convolution(inputs, attributes)]
        if kind in ("Add", "AddV2"):
            return [self._sum(inputs)]
        if kind in ("Pad", "PadV2"):
            return [self._pad(inputs)]
        if kind == "MaxPool":
            source = self._value(inputs[0])
            size, strides = _integers(attributes["ksize"]), _integers(attributes["strides"])
            return [_Value(add("MaxPool", [source.name], kernel_shape=size[1:3], strides=strides[1:3]), True)]
        if kind == "ConcatV2":
            sources = [self._value(name) for name in inputs[:-1]]
            axis = int(self._array(inputs[-1]))
            if any(value.channels_last for value in sources):
                raise RecordingError("graph model: ConcatV2 with channels last is not known")
            return [_Value(add("Concat", [value.name for value in sources], axis=axis))]
        if kind == "ResizeBilinear":
            return [self._resize(inputs)]
        if kind == "SplitV":
            source, sizes = self._plain(inputs[0]), self._array(inputs[1])
            names = self._graph.add_many(
                "Split", [source.name, self._graph.constant(sizes)], len(sizes), axis=int(self._array(inputs[2]))
            )
            return [_Value(name) for name in names]
        if kind == "Reshape":
            shape = self._graph.constant(self._shape(inputs[1]))
            return [_Value(add("Reshape", [self._plain(inputs[0]).name, shape]))]
        raise RecordingError(f"graph model: the operation {kind!r} is not known")

    def _transpose(self, source: _Value, perm: tuple[int, ...]) -> _Value:
        if perm == _TO_LAST and not source.channels_last:
            return _Value(source.name, channels_last=True)
        if perm == _TO_FIRST and source.channels_last:
            return _Value(source.name)
        if source.channels_last:
            raise RecordingError(f"graph model: the transpose {perm} of a value with channels last is not known")
        return _Value(self._graph.add("Transpose", [source.name], perm=list(perm)))

    def _convolution(self, inputs: Sequence[str], attributes: Mapping[str, Any]) -> _Value:
        source = self._value(inputs[0])
        padding = base64.b64decode(attributes["padding"]["s"])
        if not source.channels_last or padding != b"VALID":
            raise RecordingError("graph model: only convolutions with channels last and without padding are known")
        kernel = self._array(inputs[1]).transpose(3, 2, 0, 1)  # (height, width, in, out) -> (out, in, height, width)
        name = self._graph.add(
            "Conv",
            [source.name, self._graph.constant(kernel)],
            kernel_shape=list(kernel.shape[2:]),
            strides=_integers(attributes["strides"])[1:3],
        )
        return _Value(name, channels_last=True)

    def _sum(self, inputs: Sequence[str]) -> _Value:
        if inputs[1] in self._constants:
            first, bias = self._value(inputs[0]), self._array(inputs[1])
            if first.channels_last and bias.ndim == 1:
                bias = bias.reshape(1, -1, 1, 1)
            return _Value(self._graph.add("Add", [first.name, self._graph.constant(bias)]), first.channels_last)
        first, second = self._value(inputs[0]), self._value(inputs[1])
        if first.channels_last != second.channels_last:
            raise RecordingError("graph model: a sum of two orders of axes is not known")
        return _Value(self._graph.add("Add", [first.name, second.name]), first.channels_last)

    def _pad(self, inputs: Sequence[str]) -> _Value:
        source, pads = self._value(inputs[0]), self._array(inputs[1])  # pads: (axes, 2)
        if source.channels_last:
            raise RecordingError("graph model: padding with channels last is not known")
        if not pads.any():
            return source
        sizes = self._graph.constant(np.concatenate([pads[:, 0], pads[:, 1]]).astype(np.int64))
        level = float(self._array(inputs[2])) if len(inputs) > 2 else 0.0
        fill = self._graph.constant(np.array(max(level, -1e30), np.float32))
        return _Value(self._graph.add("Pad", [source.name, sizes, fill], mode="constant"))

    def _resize(self, inputs: Sequence[str]) -> _Value:
        source, size = self._value(inputs[0]), self._array(inputs[1])
        if not source.channels_last:
            raise RecordingError("graph model: resizing with channels first is not known")
        shape = self._graph.constant(np.array([1, self._channels(inputs[0]), *size.tolist()]))
        name = self._graph.add(
            "Resize",
            [source.name, "", "", shape],
            mode="linear",
            coordinate_transformation_mode="half_pixel",
        )
        return _Value(name, channels_last=True)

    def _channels(self, name: str) -> int:
        """Return the number of channels of a value: that of the convolution which it comes from."""
        node = self._nodes[name.split(":")[0]]
        if node["op"] == "Conv2D":
            return int(self._array(node["input"][1]).shape[-1])
        return self._channels(node["input"][0])

    def _shape(self, name: str) -> NDArray[np.int64]:
        """Return the shape that the graph computes from constants: a sum of a constant and zeros."""
        if name in self._constants:
            return self._constants[name].astype(np.int64).reshape(-1)
        node = self._nodes[name]
        if node["op"] == "AddV2":
            return self._shape(node["input"][0]) + self._shape(node["input"][1])
        if node["op"] == "SparseToDense":
            indices, shape, values, default = (self._array(one) for one in node["input"])
            dense = np.full(shape.reshape(-1).tolist(), default, np.int64)
            dense[tuple(indices.T)] = values
            return dense
        raise RecordingError(f"graph model: a shape from {node['op']!r} is not known")


def _integers(attribute: Mapping[str, Any]) -> list[int]:
    return [int(value) for value in attribute["list"]["i"]]


def _constants(model: Mapping[str, Any], weights: bytes) -> dict[str, NDArray[Any]]:
    constants: dict[str, NDArray[Any]] = {}
    at = 0
    for group in model["weightsManifest"]:
        for entry in group["weights"]:
            quantisation = entry.get("quantization")
            dtype = np.dtype((quantisation or entry)["dtype"])
            count = int(np.prod(entry["shape"]))
            if at + count * dtype.itemsize > len(weights):
                raise RecordingError("graph model: the weights end before the last tensor")
            values = np.frombuffer(weights, dtype, count, at).reshape(entry["shape"])
            at += count * dtype.itemsize
            if quantisation and "scale" in quantisation:
                values = values * np.float32(quantisation["scale"]) + np.float32(quantisation["min"])
            constants[entry["name"]] = values.astype(entry["dtype"])
    if at != len(weights):
        raise RecordingError(f"graph model: {len(weights) - at} bytes of weights are left after the last tensor")
    return constants
