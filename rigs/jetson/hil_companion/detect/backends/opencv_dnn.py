"""The network run by OpenCV's DNN module, which needs nothing further."""

from __future__ import annotations

import cv2
import numpy as np

from hil_companion.detect.anchors import by_anchor
from hil_companion.detect.model_file import ModelFile
from hil_companion.errors import CutError, OptionError


class Backend:
    name = "opencv"

    def __init__(self, model: ModelFile, threads: int | None = None) -> None:
        self._model = model
        if threads is not None:
            cv2.setNumThreads(threads)  # OpenCV has one number for the whole process
        try:
            self._net = cv2.dnn.readNetFromONNX(str(model.path))
        except cv2.error as error:
            raise OptionError(f"{model.path}: OpenCV {cv2.__version__} cannot read it ({_first(error)})") from None
        # By name, in the order in which the training numbered them: libraries list outputs in any order.
        self._outputs = [f"level{i}" for i in range(len(model.levels))]

    def forward(self, blob: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logits (N, classes) and offsets (N, 4) for a blob (1, 3, H, W) float32. CutError."""
        try:
            self._net.setInput(blob)
            maps = self._net.forward(self._outputs)
            return by_anchor(self._model.levels, self._model.input_px, maps, len(self._model.classes))
        except (cv2.error, ValueError) as error:
            raise CutError(f"{self._model.path}: OpenCV cannot run it ({_first(error)})") from None


def _first(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
