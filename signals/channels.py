"""Channels of a camera: type, unit, frame and look of each. Everything that handles pictures reads this table.

A channel with sources (`of`) is computed from channels before it in the table, by sim/frame/derived/NAME.py; one
without is drawn by the raster (sim/native/frame/resolve.hpp).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

# How a channel is shown: as it is; by its distance, from near to far; by its sign and size; a unit vector in C by its
# components; by the colours of the scene's classes; by a colour for each id; by its value, from least to greatest.
Look = Literal["colour", "distance", "speed", "direction", "classes", "ids", "value"]


@dataclass(frozen=True)
class Channel:
    """Channel of a camera."""

    dtype: DTypeLike
    components: int  # values per pixel
    unit: str
    frame: str  # "-" if it has none
    look: Look
    title: str  # in reports
    nothing: float | None = None  # value of a pixel without a surface; None: the sky's
    of: tuple[str, ...] = ()

    def shape(self, height: int, width: int) -> tuple[int, ...]:
        return (height, width) if self.components == 1 else (height, width, self.components)

    def empty(self, height: int, width: int) -> NDArray[Any]:
        """Return an array of the channel's shape and type, with undefined content."""
        return np.empty(self.shape(height, width), self.dtype)


_INF = float("inf")

CHANNELS: dict[str, Channel] = {
    "rgb": Channel(np.uint8, 3, "sRGB, 0 to 255", "-", "colour", "colour"),
    "depth": Channel(np.float32, 1, "m", "z of C", "distance", "depth, along the axis", _INF),
    "range": Channel(np.float32, 1, "m", "along the ray", "distance", "range, along the ray", _INF),
    "segmentation": Channel(np.uint8, 1, "class id", "-", "classes", "classes", 0),
    "instance": Channel(np.uint16, 1, "instance id", "-", "ids", "instances", 0),
    "geom": Channel(np.int32, 1, "geom id", "-", "ids", "geoms", -1),
    "normal": Channel(np.float32, 3, "1", "C", "direction", "surface normals", 0),  # towards the camera
    "radial_velocity": Channel(np.float32, 1, "m/s", "along the ray", "speed", "radial velocity", 0),  # + recedes
    "material": Channel(np.uint8, 1, "surface id", "-", "ids", "surfaces", 0),
    # Of the black body that sends as much light in 8 to 14 um; and as a thermal camera gives it.
    "temperature": Channel(np.float32, 1, "K", "-", "value", "apparent temperature", of=("range", "geom", "normal")),
    "infrared": Channel(np.uint16, 1, "counts", "-", "value", "thermal camera", of=("temperature",)),
}
