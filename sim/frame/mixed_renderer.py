"""Colour from MuJoCo's renderer, every other channel from the raster: one camera, one pose, one moment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.frame.camera_pose import CameraPose
from sim.frame.mujoco_backend import MujocoColour
from sim.frame.renderer import FrameRenderer


class MixedRenderer:
    """Draws like a FrameRenderer; `rgb` is MuJoCo's."""

    def __init__(self, native: FrameRenderer, colour: MujocoColour) -> None:
        self._native, self._colour = native, colour
        self._rgb = np.empty((native.camera.height, native.camera.width, 3), np.uint8)

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        """Fill exactly the channels in `out`; `rows`: only these."""
        self._native.render(pose, {name: array for name, array in out.items() if name != "rgb"}, rows=rows)
        if "rgb" in out:
            self._colour.pose(self._native.geometry.t_ns)
            self._colour.render(pose, self._rgb)
            first, last = rows if rows is not None else (0, len(self._rgb))
            out["rgb"][first:last] = self._rgb[first:last]

    def close(self) -> None:
        """Give the graphics context back."""
        self._colour.close()
