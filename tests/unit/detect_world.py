"""A detector's description without a network: one small level, and outputs put there by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.unit.companion_bench import CLIENT

from hil_companion.detect.model_file import ModelFile  # isort: skip
import hashlib

assert CLIENT

CLASSES = ("person", "vehicle")
NEVER = -20.0  # a logit


def description(sha256: str) -> dict[str, Any]:
    return {
        "format": 1,
        "sha256": sha256,
        "classes": list(CLASSES),
        "input_px": [64, 48],
        "levels": [
            {"stride_px": 8, "sizes_px": [8.0, 16.0], "aspect_ratios": [0.5, 2.0]},
            {"stride_px": 16, "sizes_px": [32.0], "aspect_ratios": [1.0]},
        ],
        "mean": [0.5, 0.5, 0.5],
        "std": [0.25, 0.25, 0.25],
        "score_threshold": 0.5,
        "nms_iou": 0.45,
    }


def write_model(folder: Path, onnx: bytes = b"not read here", **changes: Any) -> Path:
    """NAME.onnx and its description, keys replaced; None leaves one out."""
    path = folder / "small.onnx"
    path.write_bytes(onnx)
    data = {**description(hashlib.sha256(onnx).hexdigest()), **changes}
    path.with_suffix(".json").write_text(json.dumps({k: v for k, v in data.items() if v is not None}))
    return path


def silent(model: ModelFile) -> tuple[np.ndarray, np.ndarray]:
    """Outputs that say nothing: logits (N, classes) and offsets (N, 4)."""
    n = len(model.anchors_px)
    return np.full((n, len(model.classes)), NEVER, np.float32), np.zeros((n, 4), np.float32)


def offsets_to(anchor: np.ndarray, box_px: tuple[float, float, float, float]) -> np.ndarray:
    """The offsets by which an anchor becomes this box of the input: SSD's encoding, the other way round."""
    x0, y0, x1, y1 = box_px
    x, y, w, h = (float(v) for v in anchor)
    centre = ((0.5 * (x0 + x1) - x) / w / 0.1, (0.5 * (y0 + y1) - y) / h / 0.1)
    return np.array([*centre, np.log((x1 - x0) / w) / 0.2, np.log((y1 - y0) / h) / 0.2], np.float32)
