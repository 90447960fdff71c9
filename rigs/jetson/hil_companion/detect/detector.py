"""The detector: pictures in, detections out."""

from __future__ import annotations

import numpy as np

from hil_companion.detect.backends import open_backend
from hil_companion.detect.decode import Detection, Letterbox, decode
from hil_companion.detect.model_file import ModelFile
from hil_companion.errors import CutError, OptionError

_WARM_UP = 3  # pictures: the first allocates, the second may still choose kernels


class Detector:
    """One model in one back end, for pictures of any size; not thread-safe."""

    def __init__(
        self,
        model: ModelFile,
        backend: str = "opencv",
        threads: int | None = None,
        threshold: float | None = None,
    ) -> None:
        """Load the model into the back end. `threshold`: the lowest score, default the model's. Raises OptionError."""
        if threshold is not None and not 0.0 <= threshold <= 1.0:
            raise OptionError(f"detect: threshold {threshold!r}: a number from 0 to 1 is needed")
        self.model = model
        self.threshold = threshold
        self.backend = open_backend(backend, model, threads)
        width, height = model.input_px
        self._input = np.empty((height, width, 3), np.uint8)
        self._blob = np.empty((1, 3, height, width), np.float32)
        std = np.array(model.std, np.float32)
        self._scale = (np.float32(1.0 / 255.0) / std).reshape(3, 1, 1)
        self._shift = (np.array(model.mean, np.float32) / std).reshape(3, 1, 1)

    def warm_up(self) -> None:
        """Detect in black pictures, since the first ones take several times as long. Raises CutError."""
        for _ in range(_WARM_UP):
            self.detect(np.zeros_like(self._input))

    def blob(self, rgb: np.ndarray) -> np.ndarray:
        """Return the network's input (1, 3, H, W) float32; overwritten by the next call. Raises CutError."""
        check_picture(rgb)
        Letterbox.of((rgb.shape[1], rgb.shape[0]), self.model.input_px).place(rgb, self._input)
        np.multiply(self._input.transpose(2, 0, 1), self._scale, out=self._blob[0])
        np.subtract(self._blob[0], self._shift, out=self._blob[0])
        return self._blob

    def detect(self, rgb: np.ndarray) -> list[Detection]:
        """Return the detections in a picture, best first, in its own pixels. Raises CutError."""
        logits, offsets = self.backend.forward(self.blob(rgb))
        return decode(self.model, logits, offsets, (rgb.shape[1], rgb.shape[0]), self.threshold)


def check_picture(rgb: np.ndarray) -> None:
    """Raise CutError unless this is a colour picture of 8 bits."""
    shape, dtype = getattr(rgb, "shape", None), getattr(rgb, "dtype", None)
    if shape is None or len(shape) != 3 or shape[2] != 3 or dtype != np.uint8:
        raise CutError(f"detect: a picture (height, width, 3) of uint8 is needed, not {shape} of {dtype}")
    if min(shape[:2]) < 8 or max(shape[:2]) > 16384:
        raise CutError(f"detect: a picture of {shape[1]} x {shape[0]} pixels; 8 to 16384 each way can be taken")
