"""The boxes that a network's outputs count from: a few shapes at each place of each of its levels.

Numbering, which weights are trained for: levels in order, in each row by row, in a row from left to right, at a place
one box per shape; shapes size by size, in each ratio by ratio.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import numpy as np


@dataclass(frozen=True)
class Level:
    """One map of outputs: a place every `stride_px`, at each boxes of these areas (size squared) and ratios."""

    stride_px: int
    sizes_px: tuple[float, ...]
    aspect_ratios: tuple[float, ...]  # width / height

    @property
    def per_place(self) -> int:
        return len(self.sizes_px) * len(self.aspect_ratios)

    def places(self, input_px: tuple[int, int]) -> tuple[int, int]:
        """Columns and rows of the map, for an input of this width and height."""
        return -(-input_px[0] // self.stride_px), -(-input_px[1] // self.stride_px)

    def anchors_px(self, input_px: tuple[int, int]) -> np.ndarray:
        """(N, 4) float32: centre x, centre y, width, height."""
        columns, rows = self.places(input_px)
        shapes = [(s * math.sqrt(r), s / math.sqrt(r)) for s in self.sizes_px for r in self.aspect_ratios]
        out = np.empty((rows, columns, self.per_place, 4), np.float32)
        out[..., 0] = ((np.arange(columns) + 0.5) * self.stride_px)[None, :, None]
        out[..., 1] = ((np.arange(rows) + 0.5) * self.stride_px)[:, None, None]
        out[..., 2:] = np.array(shapes, np.float32)
        return out.reshape(-1, 4)


def all_anchors_px(levels: Sequence[Level], input_px: tuple[int, int]) -> np.ndarray:
    """Of all levels, (N, 4)."""
    return np.concatenate([level.anchors_px(input_px) for level in levels])


def by_anchor(
    levels: Sequence[Level], input_px: tuple[int, int], maps: Sequence[np.ndarray], classes: int
) -> tuple[np.ndarray, np.ndarray]:
    """A network's maps (1, per_place * (classes + 4), rows, columns) as logits (N, classes) and offsets (N, 4).

    Channels of a map: the classes of the first shape at the place, its four offsets, then the next shape.
    ValueError for maps of another network.
    """
    if len(maps) != len(levels):
        raise ValueError(f"{len(maps)} maps come out of the network, but {len(levels)} levels are described")
    flat: list[np.ndarray] = []
    for level, values in zip(levels, maps):
        columns, rows = level.places(input_px)
        expected = (1, level.per_place * (classes + 4), rows, columns)
        if tuple(values.shape) != expected:
            raise ValueError(f"a map of shape {tuple(values.shape)} comes out of the network, {expected} is described")
        flat.append(values.reshape(level.per_place, classes + 4, rows, columns).transpose(2, 3, 0, 1))
    joined = np.concatenate([f.reshape(-1, classes + 4) for f in flat])
    return joined[:, :classes], joined[:, classes:]
