"""The network run by ONNX Runtime: TensorRT or CUDA where its build has them and they start, else the processor."""

from __future__ import annotations

from typing import Any

import numpy as np
import onnxruntime

from hil_companion.detect.anchors import by_anchor
from hil_companion.detect.model_file import ModelFile
from hil_companion.errors import CutError, OptionError

PROVIDERS = ("TensorrtExecutionProvider", "CUDAExecutionProvider", "CPUExecutionProvider")  # best first


class Backend:
    name = "onnxruntime"

    def __init__(self, model: ModelFile, threads: int | None = None) -> None:
        self._model = model
        options: Any = onnxruntime.SessionOptions()
        options.log_severity_level = 3  # a provider that does not start is told by `providers`
        if threads is not None:
            options.intra_op_num_threads = threads
            options.inter_op_num_threads = 1
        there = [p for p in PROVIDERS if p in onnxruntime.get_available_providers()]
        try:
            self._session: Any = onnxruntime.InferenceSession(str(model.path), options, providers=there)
        except Exception as error:  # noqa: BLE001  its errors have no common base that is public
            raise OptionError(f"{model.path}: ONNX Runtime cannot read it ({_first(error)})") from None
        self.providers: tuple[str, ...] = tuple(self._session.get_providers())  # those in use
        self._input = self._session.get_inputs()[0].name
        self._outputs = [f"level{i}" for i in range(len(model.levels))]

    def forward(self, blob: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logits (N, classes) and offsets (N, 4) for a blob (1, 3, H, W) float32. CutError."""
        try:
            maps = self._session.run(self._outputs, {self._input: blob})
            return by_anchor(self._model.levels, self._model.input_px, maps, len(self._model.classes))
        except Exception as error:  # noqa: BLE001  as above
            raise CutError(f"{self._model.path}: ONNX Runtime cannot run it ({_first(error)})") from None


def _first(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
