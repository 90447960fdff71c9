"""Back ends: libraries that run the network, each in a module that is imported only when it is used.

Each module has `LIBRARY`, its name for messages, `ERRORS`, the exceptions it may raise, and `load(model, threads)`,
which returns a function from the network's input to its output maps. The decoding of the maps is common to all, so
that their detections differ by rounding only.
"""

from __future__ import annotations

import importlib

import numpy as np

from hil_companion.detect.model_file import ModelFile, by_anchor
from hil_companion.errors import CutError, OptionError

# Name on the command line -> module, and the package to install if it is missing.
BACKENDS = {
    "opencv": ("opencv_dnn", "opencv-python-headless"),
    "onnxruntime": ("onnx_runtime", "onnxruntime, or onnxruntime-gpu"),
    "pytorch": ("pytorch", "torch onnx"),
}


class Backend:
    """A model loaded into one library. `threads`: CPU threads, None: the library's default. Raises OptionError."""

    def __init__(self, name: str, model: ModelFile, threads: int | None) -> None:
        self.name, self._model = name, model
        module, package = BACKENDS[name]
        try:
            self._library = importlib.import_module(f"{__name__}.{module}")
        except ImportError as error:
            raise OptionError(f"back end {name} is not installed here ({error}); pip install {package}") from None
        try:
            self._run = self._library.load(model, threads)
        except self._library.ERRORS as error:
            raise OptionError(f"{model.path}: {self._library.LIBRARY} cannot read it ({_first(error)})") from None

    def forward(self, blob: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return logits (N, classes) and offsets (N, 4) for an input (1, 3, H, W) float32. Raises CutError."""
        model = self._model
        try:
            return by_anchor(model.levels, model.input_px, self._run(blob), len(model.classes))
        except (ValueError, *self._library.ERRORS) as error:
            raise CutError(f"{model.path}: {self._library.LIBRARY} cannot run it ({_first(error)})") from None


def open_backend(name: str, model: ModelFile, threads: int | None = None) -> Backend:
    """Load a model into the named back end. Raises OptionError."""
    if name not in BACKENDS:
        raise OptionError(f"no back end {name!r}; there are {', '.join(BACKENDS)}")
    if threads is not None and threads < 1:
        raise OptionError(f"{threads} threads: at least 1 is needed")
    return Backend(name, model, threads)


def _first(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
