"""Back end OpenCV DNN, which needs no further package."""

from __future__ import annotations

from typing import Any, Callable

import cv2
import numpy as np

from hil_companion.detect.model_file import ModelFile

LIBRARY = f"OpenCV {cv2.__version__}"
ERRORS = (cv2.error,)


def load(model: ModelFile, threads: int | None) -> Callable[[np.ndarray], Any]:
    if threads is not None:
        cv2.setNumThreads(threads)  # applies to the whole process
    net = cv2.dnn.readNetFromONNX(str(model.path))
    # Outputs are requested by name, in the order of training, because libraries list them in any order.
    outputs = [f"level{i}" for i in range(len(model.levels))]

    def run(blob: np.ndarray) -> Any:
        net.setInput(blob)
        return net.forward(outputs)

    return run
