"""Back end PyTorch: runs the TorchScript file beside the .onnx, on a GPU if PyTorch finds one."""

from __future__ import annotations

from typing import Any, Callable

import numpy as np
import torch

from hil_companion.detect.model_file import ModelFile
from hil_companion.errors import OptionError

LIBRARY = "PyTorch"
ERRORS = (RuntimeError, ValueError, OSError)


def load(model: ModelFile, threads: int | None) -> Callable[[np.ndarray], Any]:
    if threads is not None:
        torch.set_num_threads(threads)  # applies to the whole process
    if not model.torch_path.is_file():
        raise OptionError(f"{model.torch_path}: not there; PyTorch reads this file, `hil detect train` writes it")
    device = "cuda" if torch.cuda.is_available() else "cpu"
    net: Any = torch.jit.load(str(model.torch_path), map_location=device).eval()

    def run(blob: np.ndarray) -> Any:
        with torch.inference_mode():
            return [m.cpu().numpy() for m in net(torch.from_numpy(blob).to(device))]

    return run
