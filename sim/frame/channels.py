"""Channels of a frame: contents, type and unit of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


@dataclass(frozen=True)
class Channel:
    """Channel of a frame."""

    dtype: DTypeLike
    components: int  # values per pixel
    unit: str
    meaning: str

    def shape(self, height: int, width: int) -> tuple[int, ...]:
        return (height, width) if self.components == 1 else (height, width, self.components)

    def empty(self, height: int, width: int) -> NDArray[Any]:
        """Return an array of the channel's shape and type, with undefined content."""
        return np.empty(self.shape(height, width), self.dtype)


CHANNELS: dict[str, Channel] = {
    "rgb": Channel(np.uint8, 3, "sRGB", "colour"),
    "depth": Channel(np.float32, 1, "m", "distance along the optical axis; +inf for no surface"),
    "range": Channel(np.float32, 1, "m", "distance along the ray; +inf for no surface"),
    "segmentation": Channel(np.uint8, 1, "class", "class id; 0 for no surface"),
    "instance": Channel(np.uint16, 1, "instance", "instance id; 0 for no surface"),
    "geom": Channel(np.int32, 1, "geom", "index of the geom; -1 for no surface"),
    "normal": Channel(np.float32, 3, "1", "unit normal in C, on the camera's side; 0 for no surface"),
    "radial_velocity": Channel(
        np.float32, 1, "m/s", "of the surface point along the ray, + receding; 0 for no surface"
    ),
    "material": Channel(np.uint8, 1, "surface", "surface id; 0 for no surface"),
}
