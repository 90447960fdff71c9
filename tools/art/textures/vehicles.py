"""Textures of vehicles: number plates, what paint reflects, panes, the box body of a lorry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.scene.maps.texture_tools import Image, clouds
from sim.scene.maps.vehicles.paints import BOXES, PLATES
from tools.art.textures.dot_font import write
from tools.art.textures.layers import step
from tools.art.vehicles.lofts import at_knots

__all__ = ["BOXES", "PLATES", "box_body", "glass", "plate", "reflection"]

# Brightness of what the paint of an upright side reflects, by the share of the height: the shade below the car, the
# road, what stands along it, and from the shoulder on the sky.
_REFLECTED = (
    (0.0, 0.36), (0.12, 0.45), (0.28, 0.78), (0.40, 0.60), (0.46, 1.0), (0.52, 0.86), (0.60, 1.0), (1.0, 1.0),
)  # fmt: skip
_SHAPES = (
    (0.0, 0.10),
    (0.5, 0.16),
    (0.6, 0.34),
    (0.8, 0.14),
    (0.93, 0.03),
    (1.0, 0.03),
)  # share of the light that reflected shapes take
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
        image = np.stack([16.0 + 26.0 * v * v, 18.0 + 29.0 * v * v, 20.0 + 32.0 * v * v], axis=-1)
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


# Liveries of lorries: name, its row and column, its colour, and those of the wide band and of the narrow one.
_LIVERIES = (
    ("TRANSPORT", (22, 126), (33, 66, 112), (0.13, 0.26, 0.44), (0.85, 0.45, 0.14)),
    ("PARCELS", (22, 150), (22, 84, 60), (0.10, 0.36, 0.26), (0.90, 0.70, 0.15)),
    ("MARKET", (22, 170), (140, 28, 26), (0.58, 0.11, 0.10), (0.36, 0.36, 0.38)),
)


def box_body(number: int) -> NDArray[np.uint8]:
    """Return the body of a lorry, 512 x 256 pixels: a side above; rear doors (left) and roof (right) below.

    White panels of a plywood or plastic body: smooth, with a thin joint between them, dirt thrown up along the lower
    edge, a livery of two bands, and the reflecting tape of the lower edge. Bodies all of one dark colour were found
    less often by networks trained on photographs.
    """
    side, half = (128, 512), (128, 256)
    sheets = []
    for name, size, panels in (("side", side, 5), ("doors", half, 2), ("roof", half, 4)):
        rows, columns = size
        u = np.broadcast_to((np.arange(columns) + 0.5) / columns, size)
        v = np.broadcast_to((1.0 - (np.arange(rows) + 0.5) / rows)[:, None], size)
        dirt = 0.6 * clouds(f"lorry.{name}", 40, 3, size) + 0.4 * clouds(f"lorry.fine.{name}", 24, 10, size)
        light: Image = 0.84 - 0.03 * step(0.45, 0.8, dirt) - 0.22 * step(0.30, 0.0, v) * dirt
        if name == "roof":  # its front is where v is 0; weathered, and without dirt from the road
            light = 0.82 - 0.06 * clouds("lorry.weather", 7, 9, size)
        place, count = ((v * panels) % 1.0, rows) if name == "roof" else ((u * panels) % 1.0, columns)
        joint = np.minimum(place, 1.0 - place) < 0.8 * panels / count
        light = np.where(joint, 0.66, light)
        sheets.append(np.stack([light, 1.005 * light, 1.01 * light], axis=-1))
    whole, doors, roof = sheets
    up = 1.0 - (np.arange(128) + 0.5) / 128.0
    along = (np.arange(512) + 0.5) / 512.0
    # A wide band and a narrow one that rise towards the cab, and the name above them.
    text, place_px, text_rgb, wide, narrow = _LIVERIES[number]
    rise = up[:, None] - 0.10 * np.maximum(0.0, 1.0 - 2.4 * along[None, :])
    for low, high, rgb in ((0.20, 0.40, wide), (0.42, 0.47, narrow)):
        inside = (rise > low) & (rise < high)
        whole[inside] = np.array(rgb) * (whole[inside] / 0.8)
    tape = (up > 0.02) & (up < 0.055)
    red = (np.arange(512) // 16) % 2 == 0
    for sheet, width in ((whole, 512), (doors, 256)):
        sheet[tape] = np.where(red[None, :width, None], (0.62, 0.10, 0.10), (0.80, 0.80, 0.80))
    doors[(up > 0.60) & (up < 0.64)] *= 0.82  # shade below the hinges' rail
    for sheet in (whole, doors):
        sheet[up > 0.965] *= 0.72  # shade of the upper rail
    image = np.concatenate([whole, np.concatenate([doors, roof], axis=1)]) * 255.0 + 0.5
    pixels = np.clip(image, 0.0, 255.0).astype(np.uint8)
    write(pixels, text, place_px, (5, 4), 29, text_rgb)
    return pixels
