"""TensorFlow.js graph models (model.json and one file of weights) as ONNX models.

Only the operations of the benchmark's models are known. TensorFlow has channels last, ONNX channels first: each value
is held with channels first, together with a mark that tells which order the graph means, so that a transpose between
the two orders only changes the mark.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.realism.onnx_file import OnnxGraph
from signals.errors import RecordingError

_TO_LAST, _TO_FIRST = (0, 2, 3, 1), (0, 3, 1, 2)
_COLOURS = 3  # channels of a picture
_ELEMENTWISE = {"LeakyRelu": "LeakyRelu", "Sigmoid": "Sigmoid", "Relu": "Relu", "Relu6": "Clip"}
_CONVOLUTIONS = ("Conv2D", "_FusedConv2D", "DepthwiseConv2dNative", "FusedDepthwiseConv2dNative")


class _Value(NamedTuple):
    name: str
    channels_last: bool = False  # order that the graph means; the ONNX value has channels first


def read_graph_model(
    model: Mapping[str, Any], weights: bytes, wanted: Sequence[str] = ()
) -> tuple[bytes, tuple[str, ...]]:
    """Return the ONNX model and its outputs, those of the names `wanted` or else all of the signature, in its order.

    The model's input has channels first, its outputs have the order of axes that the graph gives them. Raises
    RecordingError for an operation that is not known, or weights that do not fit.
    """
    return _Converter(model, weights).convert(wanted)


class _Converter:
    def __init__(self, model: Mapping[str, Any], weights: bytes) -> None:
        self._nodes = {node["name"]: node for node in model["modelTopology"]["node"]}
        self._signature = model["signature"]
        self._constants = _constants(model, weights)
        self._graph = OnnxGraph()
        self._values: dict[str, _Value] = {}

    def convert(self, wanted: Sequence[str]) -> tuple[bytes, tuple[str, ...]]:
        inputs = list(self._signature["inputs"].values())
        shape = [int(dim["size"]) for dim in inputs[0]["tensorShape"]["dim"]]
        source = inputs[0]["name"].split(":")[0]
        is_last = shape[-1] == _COLOURS
        self._values[source] = _Value("input", channels_last=is_last)
        if is_last:
            shape = [shape[i] for i in _TO_FIRST]
        made = list(self._signature["outputs"].values())
        chosen = [one for one in made if not wanted or one["name"] in wanted]
        outputs = tuple(self._plain(output["name"].split(":")[0]).name for output in chosen)
        axes = len(chosen[0]["tensorShape"]["dim"])
        return self._graph.model("input", shape, outputs, axes=axes), outputs

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
        if kind in _ELEMENTWISE:
            return [self._elementwise(kind, self._value(inputs[0]), attributes)]
        if kind in _CONVOLUTIONS:
            return [self._convolution(kind, inputs, attributes)]
        if kind in ("Add", "AddV2", "Mul", "Sub"):
            return [self._of_two(kind.removesuffix("V2"), inputs)]
        if kind == "Mean":
            return [self._mean(inputs, attributes)]
        if kind in ("Pad", "PadV2"):
            return [self._pad(inputs)]
        if kind == "MaxPool":
            source = self._value(inputs[0])
            size, strides = _integers(attributes["ksize"]), _integers(attributes["strides"])
            return [_Value(add("MaxPool", [source.name], kernel_shape=size[1:3], strides=strides[1:3]), True)]
        if kind == "ConcatV2":
            sources = [self._value(name) for name in inputs[:-1]]
            is_last = _same_order("ConcatV2", sources)
            axis = int(self._array(inputs[-1]))
            axis = _TO_FIRST.index(axis % 4) if is_last else axis
            return [_Value(add("Concat", [value.name for value in sources], axis=axis), is_last)]
        if kind == "ResizeBilinear":
            return [self._resize(inputs, attributes)]
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

    def _elementwise(self, kind: str, source: _Value, attributes: Mapping[str, Any]) -> _Value:
        inputs, options = [source.name], {}
        if kind == "LeakyRelu":
            options["alpha"] = float(attributes["alpha"]["f"])
        elif kind == "Relu6":
            inputs += [self._graph.constant(np.array(limit, np.float32)) for limit in (0.0, 6.0)]
        return _Value(self._graph.add(_ELEMENTWISE[kind], inputs, **options), source.channels_last)

    def _convolution(self, kind: str, inputs: Sequence[str], attributes: Mapping[str, Any]) -> _Value:
        source, kernel = self._value(inputs[0]), self._array(inputs[1])  # (height, width, in, out)
        if not source.channels_last:
            raise RecordingError("graph model: convolutions with channels first are not known")
        groups = 1
        if "Depthwise" in kind:  # (height, width, in, outputs of each)
            groups = kernel.shape[2]
            kernel = kernel.reshape(*kernel.shape[:2], 1, -1)
        kernel = kernel.transpose(3, 2, 0, 1)
        fused = [
            base64.b64decode(text).decode() for text in attributes.get("fused_ops", {}).get("list", {}).get("s", [])
        ]
        tensors = [self._graph.constant(kernel)]
        if fused[:1] == ["BiasAdd"]:
            tensors.append(self._graph.constant(self._array(inputs[2]).reshape(-1)))
            fused = fused[1:]
        strides = _integers(attributes["strides"])[1:3]
        pads = [0, 0, 0, 0]
        if base64.b64decode(attributes["padding"]["s"]) == b"SAME":  # the sizes are multiples of the strides
            total = [max(size - stride, 0) for size, stride in zip(kernel.shape[2:], strides, strict=True)]
            pads = [total[0] // 2, total[1] // 2, total[0] - total[0] // 2, total[1] - total[1] // 2]
        name = self._graph.add(
            "Conv",
            [source.name, *tensors],
            kernel_shape=list(kernel.shape[2:]),
            strides=strides,
            group=groups,
            pads=pads,
        )
        value = _Value(name, channels_last=True)
        for activation in fused:
            if activation not in _ELEMENTWISE:
                raise RecordingError(f"graph model: the operation {activation!r} is not known")
            value = self._elementwise(activation, value, attributes)
        return value

    def _of_two(self, kind: str, inputs: Sequence[str]) -> _Value:
        values = [self._value(name) for name in inputs if name not in self._constants]
        is_last = _same_order(kind, values)
        names = []
        for name in inputs:
            if name not in self._constants:
                names.append(self._value(name).name)
                continue
            array = self._array(name)
            if is_last and array.ndim == 1:
                array = array.reshape(1, -1, 1, 1)
            elif is_last and array.size > 1:
                raise RecordingError(f"graph model: {kind} of a constant with {array.ndim} axes is not known")
            names.append(self._graph.constant(array))
        return _Value(self._graph.add(kind, names), is_last)

    def _mean(self, inputs: Sequence[str], attributes: Mapping[str, Any]) -> _Value:
        source, axes = self._value(inputs[0]), self._array(inputs[1]).reshape(-1).tolist()
        if not (source.channels_last and attributes["keep_dims"]["b"]):
            raise RecordingError("graph model: a mean that removes axes is not known")
        axes = [_TO_FIRST.index(axis) for axis in axes]
        return _Value(self._graph.add("ReduceMean", [source.name], axes=axes, keepdims=1), channels_last=True)

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

    def _resize(self, inputs: Sequence[str], attributes: Mapping[str, Any]) -> _Value:
        source, size = self._value(inputs[0]), self._array(inputs[1])
        if not source.channels_last:
            raise RecordingError("graph model: resizing with channels first is not known")
        corners, centres = (attributes.get(key, {}).get("b") for key in ("align_corners", "half_pixel_centers"))
        mode = "align_corners" if corners else "half_pixel" if centres else "asymmetric"
        shape = self._graph.constant(np.array([1, self._channels(inputs[0]), *size.tolist()]))
        name = self._graph.add(
            "Resize", [source.name, "", "", shape], mode="linear", coordinate_transformation_mode=mode
        )
        return _Value(name, channels_last=True)

    def _channels(self, name: str) -> int:
        """Return the number of channels of a value: that of the convolution which it comes from."""
        node = self._nodes[name.split(":")[0]]
        if node["op"] in ("Conv2D", "_FusedConv2D"):
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


def _same_order(kind: str, values: Sequence[_Value]) -> bool:
    """Return whether the values have channels last."""
    orders = {value.channels_last for value in values}
    if len(orders) > 1:
        raise RecordingError(f"graph model: {kind} of two orders of axes is not known")
    return orders.pop()


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
