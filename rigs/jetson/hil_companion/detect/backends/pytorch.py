"""The network run by PyTorch, from the TorchScript file beside the .onnx; on a GPU where PyTorch sees one."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from hil_companion.detect.anchors import by_anchor
from hil_companion.detect.model_file import ModelFile
from hil_companion.errors import CutError, OptionError


class Backend:
    name = "pytorch"

    def __init__(self, model: ModelFile, threads: int | None = None) -> None:
        self._model = model
        if threads is not None:
            torch.set_num_threads(threads)  # one number for the whole process
        if not model.torch_path.is_file():
            raise OptionError(f"{model.torch_path}: not there; PyTorch reads this file, `hil detect train` writes it")
        self._device = "cuda" if torch.cuda.is_available() else "cpu"
        try:
            self._net: Any = torch.jit.load(str(model.torch_path), map_location=self._device).eval()
        except (RuntimeError, ValueError, OSError) as error:
            raise OptionError(f"{model.torch_path}: PyTorch cannot read it ({_first(error)})") from None

    def forward(self, blob: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logits (N, classes) and offsets (N, 4) for a blob (1, 3, H, W) float32. CutError."""
        try:
            with torch.inference_mode():
                maps = [m.cpu().numpy() for m in self._net(torch.from_numpy(blob).to(self._device))]
            return by_anchor(self._model.levels, self._model.input_px, maps, len(self._model.classes))
        except (RuntimeError, ValueError) as error:
            raise CutError(f"{self._model.torch_path}: PyTorch cannot run it ({_first(error)})") from None


def _first(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
