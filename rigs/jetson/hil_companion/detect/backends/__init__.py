"""Libraries that can run the network, each in a module of its own that is only loaded when it is asked for.

Each has a class `Backend(model, threads)` with `name` and `forward(blob) -> (logits, offsets)`; what is made of these
is the same for all (`detect.decode`), so that they differ by rounding alone.
"""

from __future__ import annotations

import importlib
from typing import Any

from hil_companion.detect.model_file import ModelFile
from hil_companion.errors import OptionError

# Name on the command line: module, and what to install where it is missing.
BACKENDS = {
    "opencv": ("opencv_dnn", "opencv-python-headless"),
    "onnxruntime": ("onnx_runtime", "onnxruntime, or onnxruntime-gpu"),
    "pytorch": ("pytorch", "torch"),
}


def open_backend(name: str, model: ModelFile, threads: int | None = None) -> Any:
    """`threads`: of processor work, None: as many as the library takes. OptionError."""
    if name not in BACKENDS:
        raise OptionError(f"no back end {name!r}; there are {', '.join(BACKENDS)}")
    if threads is not None and threads < 1:
        raise OptionError(f"{threads} threads: at least 1 is needed")
    module, package = BACKENDS[name]
    try:
        found = importlib.import_module(f"{__name__}.{module}")
    except ImportError as error:
        raise OptionError(f"back end {name} is not installed here ({error}); pip install {package}") from None
    return found.Backend(model, threads)
