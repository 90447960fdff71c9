"""A trained model on disk: NAME.onnx, and NAME.json beside it that says what goes in and what comes out.

The description is a file of its own because OpenCV shows nothing of what an ONNX file says about itself. It names the
digest of the model it belongs to, so that the two cannot be mixed up.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hil_companion.detect.anchors import Level, all_anchors_px
from hil_companion.errors import OptionError

SHIPPED = Path(__file__).resolve().parent / "weights" / "hil_ssdlite.onnx"
FORMAT = 1


@dataclass(frozen=True)
class ModelFile:
    """What a back end and the decoding need to know. Blob = (rgb / 255 - mean) / std, planes of red, green, blue."""

    path: Path  # of the .onnx
    sha256: str
    classes: tuple[str, ...]  # without background
    input_px: tuple[int, int]  # width, height
    levels: tuple[Level, ...]
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    score_threshold: float
    nms_iou: float
    anchors_px: np.ndarray  # (N, 4) float32: centre x, y, width, height in pixels of the input

    @classmethod
    def load(cls, path: str | Path | None = None) -> ModelFile:
        """None: the shipped one. OptionError."""
        onnx = SHIPPED if path is None else Path(path)
        if onnx.suffix != ".onnx":
            raise OptionError(f"{onnx}: weights are a .onnx file with its .json beside it")
        description = onnx.with_suffix(".json")
        texts = {}
        for file in (onnx, description):
            try:
                texts[file] = file.read_bytes()
            except OSError as error:
                hint = "" if path is None else "; `hil detect train` writes both, or leave --weights out"
                raise OptionError(f"{file}: cannot be read ({error.strerror or error}){hint}") from None
        digest = hashlib.sha256(texts[onnx]).hexdigest()
        try:
            data = json.loads(texts[description].decode("utf-8"))
        except ValueError as error:
            raise OptionError(f"{description}: is not JSON ({error})") from None
        model = _described(description, data, onnx, digest)
        if data["sha256"] != digest:
            digests = f"sha256 {str(data['sha256'])[:12]}, not {digest[:12]}"
            raise OptionError(
                f"{description}: describes another model than {onnx.name} ({digests}); copy both files of one training"
            )
        return model

    @property
    def torch_path(self) -> Path:
        """The same model for PyTorch."""
        return self.path.with_suffix(".pt")

    def description(self) -> dict[str, Any]:
        """What NAME.json says; `load` reads it."""
        return {
            "format": FORMAT,
            "sha256": self.sha256,
            "classes": list(self.classes),
            "input_px": list(self.input_px),
            "levels": [
                {"stride_px": v.stride_px, "sizes_px": list(v.sizes_px), "aspect_ratios": list(v.aspect_ratios)}
                for v in self.levels
            ],
            "mean": list(self.mean),
            "std": list(self.std),
            "score_threshold": self.score_threshold,
            "nms_iou": self.nms_iou,
        }


def _described(file: Path, data: Any, onnx: Path, digest: str) -> ModelFile:
    """OptionError that names the key which is missing or cannot be."""
    try:
        if data["format"] != FORMAT:
            raise OptionError(f"{file}: format {data['format']!r}; this program reads {FORMAT}")
        classes = tuple(data["classes"])
        if not classes or len(set(classes)) != len(classes) or not all(isinstance(c, str) and c for c in classes):
            raise OptionError(f"{file}: classes: names are needed, each once")
        width, height = data["input_px"]
        if not all(isinstance(n, int) and 16 <= n <= 4096 for n in (width, height)):
            raise OptionError(f"{file}: input_px {data['input_px']!r}: two whole numbers from 16 to 4096 are needed")
        levels = tuple(
            Level(int(v["stride_px"]), _numbers(v["sizes_px"]), _numbers(v["aspect_ratios"])) for v in data["levels"]
        )
        if not levels or not all(
            v.stride_px > 0 and v.per_place and min(v.sizes_px + v.aspect_ratios) > 0 for v in levels
        ):
            raise OptionError(f"{file}: levels: strides, sizes and aspect ratios above 0 are needed")
        mean, std = _numbers(data["mean"]), _numbers(data["std"])
        if len(mean) != 3 or len(std) != 3 or min(std) <= 0.0:
            raise OptionError(f"{file}: mean and std: three numbers each are needed, std above 0")
        threshold, iou = float(data["score_threshold"]), float(data["nms_iou"])
        if not (0.0 <= threshold <= 1.0 and 0.0 < iou <= 1.0):
            raise OptionError(f"{file}: score_threshold and nms_iou lie between 0 and 1")
        data["sha256"]
    except KeyError as error:
        raise OptionError(f"{file}: key {error} is missing") from None
    except (TypeError, ValueError) as error:
        raise OptionError(f"{file}: is no description of a detector ({error})") from None
    return ModelFile(
        path=onnx,
        sha256=digest,
        classes=classes,
        input_px=(width, height),
        levels=levels,
        mean=(mean[0], mean[1], mean[2]),
        std=(std[0], std[1], std[2]),
        score_threshold=threshold,
        nms_iou=iou,
        anchors_px=all_anchors_px(levels, (width, height)),
    )


def _numbers(values: Any) -> tuple[float, ...]:
    numbers = tuple(float(v) for v in values)
    if not all(math.isfinite(n) for n in numbers):
        raise ValueError("a number is not finite")
    return numbers
