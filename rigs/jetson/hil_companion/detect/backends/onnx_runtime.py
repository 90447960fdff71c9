"""Back end ONNX Runtime: TensorRT or CUDA if its build has them and they start, else the CPU."""

from __future__ import annotations

from typing import Any, Callable

import numpy as np
import onnxruntime

from hil_companion.detect.model_file import ModelFile

LIBRARY = "ONNX Runtime"
ERRORS = (Exception,)  # its errors have no public common base class
PROVIDERS = ("TensorrtExecutionProvider", "CUDAExecutionProvider", "CPUExecutionProvider")  # best first


def load(model: ModelFile, threads: int | None) -> Callable[[np.ndarray], Any]:
    options: Any = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # hide warnings about a provider that does not start: the next one is used
    if threads is not None:
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
    there = [p for p in PROVIDERS if p in onnxruntime.get_available_providers()]
    session: Any = onnxruntime.InferenceSession(str(model.path), options, providers=there)
    name = session.get_inputs()[0].name
    outputs = [f"level{i}" for i in range(len(model.levels))]
    return lambda blob: session.run(outputs, {name: blob})
