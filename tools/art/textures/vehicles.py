"""Textures of vehicles: number plates, what paint reflects, panes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.scene.maps.texture_tools import clouds
from sim.scene.maps.vehicles.paints import PLATES
from tools.art.textures.dot_font import write
from tools.art.textures.layers import step
from tools.art.vehicles.lofts import at_knots

__all__ = ["PLATES", "glass", "plate", "reflection"]

# Brightness of what the paint of an upright side reflects, by the share of the height: the shade below the car, the
# road, what stands along it, and from the shoulder on the sky.
_REFLECTED = (
    (0.0, 0.36), (0.12, 0.45), (0.28, 0.78), (0.40, 0.60), (0.46, 1.0), (0.52, 0.86), (0.60, 1.0), (1.0, 1.0),
)  # fmt: skip
_SHAPES = ((0.0, 0.10), (0.5, 0.16), (0.6, 0.40), (1.0, 0.40))  # share of the light that reflected shapes take
_SIDE_PX = 128
_TEXTS = ("ZH 40712", "BL 17358", "TK 85240")


def plate(number: int) -> NDArray[np.uint8]:
    """Return a white plate, 256 x 64 pixels, with a blue band and dark characters."""
    image = np.full((64, 256, 3), 235, np.uint8)
    image[:, :20] = (160, 60, 20)  # BGR
    image[:2] = image[-2:] = image[:, -2:] = (40, 40, 40)
    write(image, _TEXTS[number], (11, 32), (6, 4), 27, (25, 25, 25))
    return image[:, :, ::-1]


def reflection() -> NDArray[np.uint8]:
    """Return what paint reflects, all round (u) and from the ground to the roof (v), with soft shapes in the sky."""
    size = (_SIDE_PX, _SIDE_PX)
    heights = [1.0 - (k + 0.5) / _SIDE_PX for k in range(_SIDE_PX)]
    light, depth = (np.array([at_knots(knots, v) for v in heights])[:, None] for knots in (_REFLECTED, _SHAPES))
    shapes = step(0.3, 0.7, 0.7 * clouds("paint", 5, 6, size) + 0.3 * clouds("paint_fine", 11, 14, size))
    image = (255.0 * light * (1.0 - depth * shapes) + 0.5).astype(np.uint8)
    return np.stack([image] * 3, axis=-1)


def glass() -> NDArray[np.uint8]:
    """Return panes, 128 pixels square: a windscreen above, a side window below.

    Both are dark, lighter towards the top, where they reflect the sky; behind them stand dashboard and seats.
    """
    u = (np.arange(128) + 0.5) / 128.0
    v = 1.0 - (np.arange(64) + 0.5) / 64.0  # upwards
    u, v = np.broadcast_to(u, (64, 128)), np.broadcast_to(v[:, None], (64, 128))
    halves = []
    for seats, dashboard in (((0.28, 0.72), 0.16), ((0.38,), 0.0)):
        image = np.stack([20.0 + 44.0 * v * v, 23.0 + 52.0 * v * v, 27.0 + 60.0 * v * v], axis=-1)
        for seat in seats:
            wide = 0.06 if dashboard else 0.12
            head = (np.abs(u - seat) < wide) & (np.abs(v - 0.56) < 0.13)
            back = (np.abs(u - seat) < 2.1 * wide) & (v < 0.38)
            image[head | back] += 16.0
        if dashboard:
            image[v < dashboard] = (58.0, 57.0, 56.0)
            image[(np.abs(u - 0.5) < 0.06) & (np.abs(v - 0.90) < 0.045)] = 8.0  # mirror
        halves.append(image)
    image = np.concatenate(halves) + 0.5
    return image.astype(np.uint8)
