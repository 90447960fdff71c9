"""Writer of ONNX models: the few messages of onnx.proto (opset 13) that a convolutional network needs.

The `onnx` package is not needed: a protobuf message is a sequence of (field number and wire type, value).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

_VARINT, _BYTES, _FIXED32 = 0, 2, 5  # wire types
_FLOAT, _INT64 = 1, 7  # TensorProto.DataType
_ATTRIBUTE_TYPES = {float: 1, int: 2, str: 3}
_FLOATS, _INTS = 6, 7  # AttributeProto.AttributeType
_IR_VERSION, _OPSET = 8, 13


@dataclass
class OnnxGraph:
    """Graph in construction. `add` returns the name of the output of a new node, `constant` that of a new tensor."""

    nodes: list[bytes] = field(default_factory=list)
    constants: list[bytes] = field(default_factory=list)

    def add(self, kind: str, inputs: Sequence[str], **attributes: Any) -> str:
        """Add a node with one output and return the output's name."""
        return self.add_many(kind, inputs, 1, **attributes)[0]

    def add_many(self, kind: str, inputs: Sequence[str], outputs: int, **attributes: Any) -> list[str]:
        """Add a node and return the names of its outputs."""
        name = f"n{len(self.nodes)}"
        names = [f"{name}_{i}" for i in range(outputs)]
        self.nodes.append(
            b"".join(_text(1, one) for one in inputs)
            + b"".join(_text(2, one) for one in names)
            + _text(3, name)
            + _text(4, kind)
            + b"".join(_block(5, _attribute(key, value)) for key, value in attributes.items())
        )
        return names

    def constant(self, values: NDArray[Any]) -> str:
        """Add a tensor, float32 or int64, and return its name."""
        name = f"c{len(self.constants)}"
        is_int = np.issubdtype(values.dtype, np.integer)
        data = np.ascontiguousarray(values, np.int64 if is_int else np.float32)
        self.constants.append(
            b"".join(_number(1, size) for size in data.shape)
            + _number(2, _INT64 if is_int else _FLOAT)
            + _text(8, name)
            + _block(9, data.tobytes())
        )
        return name

    def model(self, input_name: str, input_shape: Sequence[int], outputs: Sequence[str], *, axes: int) -> bytes:
        """Return the file's content. Every output has `axes` axes, of lengths that the reader finds out."""
        graph = (
            b"".join(_block(1, node) for node in self.nodes)
            + _text(2, "network")
            + b"".join(_block(5, constant) for constant in self.constants)
            + _block(11, _value(input_name, input_shape))
            + b"".join(_block(12, _value(name, (None,) * axes)) for name in outputs)
        )
        return _number(1, _IR_VERSION) + _block(7, graph) + _block(8, _text(1, "") + _number(2, _OPSET))


def _varint(value: int) -> bytes:
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _number(number: int, value: int) -> bytes:
    return _varint(number << 3 | _VARINT) + _varint(value)


def _block(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | _BYTES) + _varint(len(content)) + content


def _text(number: int, value: str) -> bytes:
    return _block(number, value.encode())


def _float(number: int, value: float) -> bytes:
    return _varint(number << 3 | _FIXED32) + np.float32(value).tobytes()


def _attribute(name: str, value: float | int | str | Sequence[float] | Sequence[int]) -> bytes:
    if isinstance(value, float):
        content = _float(2, value)
    elif isinstance(value, int):
        content = _number(3, value)
    elif isinstance(value, str):
        content = _text(4, value)
    else:
        is_float = any(isinstance(one, float) for one in value)
        content = b"".join(_float(7, one) if is_float else _number(8, int(one)) for one in value)
        return _text(1, name) + content + _number(20, _FLOATS if is_float else _INTS)
    return _text(1, name) + content + _number(20, _ATTRIBUTE_TYPES[type(value)])


def _value(name: str, shape: Sequence[int | None]) -> bytes:
    sizes = b"".join(_block(1, b"" if size is None else _number(1, size)) for size in shape)
    tensor = _number(1, _FLOAT) + _block(2, sizes)
    return _text(1, name) + _block(2, _block(1, tensor))
