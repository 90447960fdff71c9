"""Mask of a radar's pixels: by class, by windows of angles, and by range.

Azimuth is atan2(y, x), to the left; elevation is atan2(z, sqrt(x^2 + y^2)), upwards; (x, y, z) is a direction in R.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from signals.documents.validate import StrictModel, nearest
from signals.units import RAD_PER_DEG
from sim._kernels import azimuth_elevation

_NONE = "none"  # the class of nothing
_Azimuth = Annotated[float, Field(ge=-180.0, le=180.0)]
_Elevation = Annotated[float, Field(ge=-90.0, le=90.0)]


class Mask(StrictModel):
    """Limits of the pixels that give echoes; None: no limit."""

    classes: tuple[str, ...] | None = None
    azimuth_deg: tuple[_Azimuth, _Azimuth] | None = None  # from, to
    elevation_deg: tuple[_Elevation, _Elevation] | None = None
    max_range_m: Annotated[float, Field(gt=0.0, le=1e5)] | None = None  # None: also echoes that alias in range

    @model_validator(mode="after")
    def _leaves_pixels(self) -> Mask:
        for name in ("azimuth_deg", "elevation_deg"):
            window = getattr(self, name)
            if window is not None and not window[0] < window[1]:
                raise ValueError(f"{name} [{window[0]:g}, {window[1]:g}] is empty: the first must be below the second")
        if self.classes is not None and not [name for name in self.classes if name != _NONE]:
            raise ValueError("classes holds no visible class: name a class, or leave `classes` out for all")
        return self

    def kept_classes(self, class_names: tuple[str, ...]) -> NDArray[np.uint8] | None:
        """Return 1 for each class id that is kept, (256,); None: all. Raises ValueError for an unknown class."""
        if self.classes is None:
            return None
        kept = np.zeros(256, np.uint8)
        for name in self.classes:
            if name not in class_names:
                raise ValueError(f"the mask names an unknown class: {name!r}; {nearest(name, class_names)}")
            kept[class_names.index(name)] = 1
        kept[0] = 0
        return kept

    def in_window(self, direction_R: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return True for unit directions (n, 3) within the windows of angles, (n,)."""
        inside = np.ones(len(direction_R), np.bool_)
        if self.azimuth_deg is None and self.elevation_deg is None:
            return inside
        azimuth, elevation = np.empty(len(direction_R)), np.empty(len(direction_R))
        azimuth_elevation(np.ascontiguousarray(direction_R, np.float64), azimuth, elevation)
        for angle, window in ((azimuth, self.azimuth_deg), (elevation, self.elevation_deg)):
            if window is not None:
                inside &= (angle >= window[0] * RAD_PER_DEG) & (angle <= window[1] * RAD_PER_DEG)
        return inside
