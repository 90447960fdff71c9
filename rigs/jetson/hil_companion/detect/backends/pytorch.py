"""Back end PyTorch: runs the graph of the ONNX file with PyTorch's functions, on a GPU if PyTorch finds one."""

from __future__ import annotations

from typing import Any, Callable

import numpy as np
import onnx
import torch
import torch.nn.functional as F
from google.protobuf.message import DecodeError
from onnx import helper, numpy_helper

from hil_companion.detect.model_file import ModelFile

LIBRARY = "PyTorch"
ERRORS = (RuntimeError, ValueError, LookupError, OSError, DecodeError)


def load(model: ModelFile, threads: int | None) -> Callable[[np.ndarray], Any]:
    if threads is not None:
        torch.set_num_threads(threads)  # applies to the whole process
    device = "cuda" if torch.cuda.is_available() else "cpu"
    graph = onnx.load(str(model.path)).graph
    arrays = {t.name: numpy_helper.to_array(t) for t in graph.initializer}
    steps = []
    for node in graph.node:
        attributes = {a.name: helper.get_attribute_value(a) for a in node.attribute}
        if node.op_type == "Constant":
            arrays[node.output[0]] = numpy_helper.to_array(attributes["value"])
        elif node.op_type in _OPERATORS:
            steps.append((_OPERATORS[node.op_type], attributes, list(node.input), node.output[0]))
        else:
            raise ValueError(f"operator {node.op_type}; detectors of `hil detect train` have {', '.join(_OPERATORS)}")
    constants = {name: torch.from_numpy(array.copy()).to(device) for name, array in arrays.items()}

    def run(blob: np.ndarray) -> Any:
        values = dict(constants)
        with torch.inference_mode():
            values[graph.input[0].name] = torch.from_numpy(blob).to(device)
            for operator, attributes, inputs, output in steps:
                values[output] = operator(attributes, *(values[name] for name in inputs))
        return [values[f"level{i}"].cpu().numpy() for i in range(len(model.levels))]

    return run


def _conv(a: dict[str, Any], x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    top, left, bottom, right = a["pads"]
    if (top, left) != (bottom, right):
        raise ValueError(f"a Conv has pads {a['pads']}; the same on opposite sides are known")
    return F.conv2d(x, weight, bias, a["strides"], (top, left), a["dilations"], a["group"])


def _resize(a: dict[str, Any], x: torch.Tensor, _: torch.Tensor, scales: torch.Tensor) -> torch.Tensor:
    if (a["mode"], a["nearest_mode"], a["coordinate_transformation_mode"]) != (b"nearest", b"floor", b"asymmetric"):
        raise ValueError(f"a Resize has mode {a['mode'].decode()}; nearest with floor is known")
    return F.interpolate(x, scale_factor=scales[2:].tolist())


_OPERATORS: dict[str, Callable[..., torch.Tensor]] = {
    "Conv": _conv,
    "Relu": lambda _, x: torch.relu(x),
    "Add": lambda _, x, y: x + y,
    "Resize": _resize,
}
