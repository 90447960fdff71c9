"""Layers of the textures: colours over a picture, soft steps, cracks."""

from __future__ import annotations

import numpy as np

from sim.scene.maps.texture_tools import Image, Rgb, Size, clouds


def over(image: Image, rgb: Rgb, share: Image) -> Image:
    """Lay `rgb` over the picture, opaque where `share` is 1, and return the same picture."""
    share = np.clip(share, 0.0, 1.0).astype(np.float32, copy=False)
    for value, channel in zip(rgb, image, strict=True):
        channel += (np.float32(value) - channel) * share
    return image


def step(low: float, high: float, x: Image) -> Image:
    """Return 0 below `low`, 1 above `high`, and the smoothstep between them; also downwards."""
    u: Image = x - low
    u /= high - low
    np.clip(u, 0.0, 1.0, out=u)
    slope = -2.0 * u
    slope += 3.0
    u *= u
    u *= slope
    return u


def cracks(name: str, cells: int, size: Size, width: float) -> Image:
    """Return 1 on thin winding lines: where smooth noise passes its middle."""
    field = 0.7 * clouds(name, cells, cells, size) + 0.3 * clouds(f"{name}.fine", 4 * cells, 4 * cells, size)
    return np.clip(1.0 - np.abs(field - 0.5) / width, 0.0, 1.0)
