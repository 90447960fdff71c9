"""Face of a stop sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.art.textures.dot_font import write


def stop_sign() -> NDArray[np.uint8]:
    """Return the face of the sign, 128 pixels square: red with a white rim and white letters."""
    side = 128
    line = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    u, v = np.abs(np.broadcast_to(line, (side, side))), np.abs(np.broadcast_to(line[:, None], (side, side)))
    # Distance from the middle across the sides of a regular octagon, 1 at its rim.
    reach = np.maximum(np.maximum(u, v), (u + v) * 0.7071067811865476)
    image = np.empty((side, side, 3), np.uint8)
    image[:] = (28, 20, 190)  # BGR
    image[reach > 0.90] = (240, 240, 240)
    write(image, "STOP", (43, 18), (6, 4), 24, (245, 245, 245))
    return image[:, :, ::-1]
