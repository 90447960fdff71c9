"""A trained model on disk: NAME.onnx, and beside it NAME.json with the description of its input and outputs.

The description is a separate file because OpenCV gives no access to the metadata of an ONNX file. It holds the digest
of its model, so that the two cannot be mixed up.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Sequence

import numpy as np

from hil_companion.errors import OptionError

_WEIGHTS = Path(__file__).resolve().parent / "weights"
FAST, GOOD = "fast", "good"
SHIPPED = {FAST: _WEIGHTS / "hil_ssdlite.onnx", GOOD: _WEIGHTS / "hil_ssdlite_good.onnx"}  # MODEL_CARD.md
FORMAT = 1


@dataclass(frozen=True)
class Level:
    """One output map: a cell every `stride_px`, with an anchor box for each size (area = size^2) and aspect ratio.

    The weights are trained for this order of anchors: level by level, row by row, from left to right, then size by
    size, then ratio by ratio.
    """

    stride_px: int
    sizes_px: tuple[float, ...]
    aspect_ratios: tuple[float, ...]  # width / height

    @property
    def anchors_per_position(self) -> int:
        return len(self.sizes_px) * len(self.aspect_ratios)

    def map_size(self, input_px: tuple[int, int]) -> tuple[int, int]:
        """Return columns and rows of the map for an input of this width and height."""
        return -(-input_px[0] // self.stride_px), -(-input_px[1] // self.stride_px)

    def anchors_px(self, input_px: tuple[int, int]) -> np.ndarray:
        """Return the anchors (N, 4) float32: centre x, centre y, width, height."""
        columns, rows = self.map_size(input_px)
        shapes = [(s * math.sqrt(r), s / math.sqrt(r)) for s in self.sizes_px for r in self.aspect_ratios]
        out = np.empty((rows, columns, self.anchors_per_position, 4), np.float32)
        out[..., 0] = ((np.arange(columns) + 0.5) * self.stride_px)[None, :, None]
        out[..., 1] = ((np.arange(rows) + 0.5) * self.stride_px)[:, None, None]
        out[..., 2:] = np.array(shapes, np.float32)
        return out.reshape(-1, 4)


def all_anchors_px(levels: Sequence[Level], input_px: tuple[int, int]) -> np.ndarray:
    """Return the anchors of all levels, (N, 4)."""
    return np.concatenate([level.anchors_px(input_px) for level in levels])


def by_anchor(
    levels: Sequence[Level], input_px: tuple[int, int], maps: Sequence[np.ndarray], classes: int
) -> tuple[np.ndarray, np.ndarray]:
    """Convert a network's maps to logits (N, classes) and offsets (N, 4).

    A map is (1, anchors_per_position * (classes + 4), rows, columns).
    Its channels are the classes of the first anchor shape, its four offsets, then the next shape. Raises ValueError for
    maps of another network.
    """
    if len(maps) != len(levels):
        raise ValueError(f"{len(maps)} maps come out of the network, but {len(levels)} levels are described")
    flat: list[np.ndarray] = []
    for level, values in zip(levels, maps):
        columns, rows = level.map_size(input_px)
        expected = (1, level.anchors_per_position * (classes + 4), rows, columns)
        if tuple(values.shape) != expected:
            raise ValueError(f"a map of shape {tuple(values.shape)} comes out of the network, {expected} is described")
        flat.append(values.reshape(level.anchors_per_position, classes + 4, rows, columns).transpose(2, 3, 0, 1))
    joined = np.concatenate([f.reshape(-1, classes + 4) for f in flat])
    return joined[:, :classes], joined[:, classes:]


@dataclass(frozen=True)
class ModelFile:
    """Description of a model for back ends and decoding. Input = (rgb / 255 - mean) / std, in planes."""

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
        """Read a model's description and check its digest. Raises OptionError.

        `path`: a .onnx file or the name of a shipped model; None: the fast one.
        """
        onnx = SHIPPED[FAST] if path is None else SHIPPED.get(str(path), Path(path))
        if onnx.suffix != ".onnx":
            names = " or ".join(SHIPPED)
            raise OptionError(f"{path}: weights are {names}, or a .onnx file with its .json beside it")
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

    def description(self) -> dict[str, Any]:
        """Return the entries of NAME.json, which `load` reads."""
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
    """Make the model from its description. Raises OptionError that names the missing or invalid key."""
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
            v.stride_px > 0 and v.anchors_per_position and min(v.sizes_px + v.aspect_ratios) > 0 for v in levels
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
        raise OptionError(f"{file}: is not a description of a detector ({error})") from None
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
