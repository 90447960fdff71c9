"""A colour picture in linear light, to draw on it what mixes as light does: rain, drops on the window."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim._kernels import accumulate_linear, expose
from sim.frame.camera_model import CameraModel


class LinearPicture:
    """Buffers of one camera. `light`: (height, width, 3), as the latest `load` and what was drawn since made it."""

    def __init__(self, camera: CameraModel) -> None:
        shape = (camera.height, camera.width, 3)
        self.light, self._codes = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)

    def load(self, rgb: NDArray[np.uint8]) -> None:
        """Take the light of a picture."""
        self.light.fill(0.0)
        accumulate_linear(rgb, 1.0, self.light)

    def store(self, rgb: NDArray[np.uint8], where: NDArray[np.bool_]) -> None:
        """Write the codes of the light to the pixels `where` (height, width); the others keep their bits."""
        expose(
            self.light,
            None,
            gain=1.0,
            electrons_at_white=1.0,
            read_noise_electrons=0.0,
            noisy=False,
            key=(0, 0),
            index=0,
            rgb=self._codes,
        )
        np.copyto(rgb, self._codes, where=where[:, :, None])
