"""Materials of vehicles: paints, glass, dark trim, rims, lamps, number plates."""

from __future__ import annotations

from functools import cache

import numpy as np

from sim.scene.maps import surfaces
from sim.scene.maps.dot_font import write
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.texture_tools import encoded_png
from sim.scene.random_generator import RandomGenerator

PAINTS = {
    "silver": (0.66, 0.68, 0.70), "black": (0.05, 0.05, 0.06), "white": (0.90, 0.90, 0.89), "red": (0.56, 0.06, 0.06),
    "blue": (0.08, 0.18, 0.42), "green": (0.10, 0.25, 0.18), "grey": (0.30, 0.31, 0.33), "olive": (0.31, 0.33, 0.20),
    "yellow": (0.90, 0.68, 0.08), "orange": (0.85, 0.36, 0.06), "sand": (0.62, 0.55, 0.42),
}  # fmt: skip
# Shares of the paints of new cars, rounded: white, grey, black and silver are three quarters.
_COMMON = ("white", "white", "grey", "grey", "black", "black", "silver", "silver", "blue", "blue", "red", "green")
PLATES = 3

_TEXTS = ("ZH 40712", "BL 17358", "TK 85240")


@cache
def _plate_png(number: int) -> bytes:
    """Return a white plate, 256 x 64 pixels, with a blue band and dark characters."""
    image = np.full((64, 256, 3), 235, np.uint8)
    image[:, :20] = (160, 60, 20)  # BGR
    image[:2] = image[-2:] = image[:, -2:] = (40, 40, 40)
    write(image, _TEXTS[number], (11, 32), (6, 4), 27, (25, 25, 25))
    return encoded_png(image)


@cache
def _glass_png() -> bytes:
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
    image = np.concatenate(halves)[:, :, ::-1] + 0.5
    return encoded_png(image.astype(np.uint8))


def vehicle_materials(builder: MapBuilder) -> None:
    """Add the materials that all vehicles share."""
    builder.texture("vehicle_glass", _glass_png())
    builder.material("vehicle_glass", surfaces.GLASS, texture="vehicle_glass", specular=0.9, shininess=0.9)
    builder.material("vehicle_trim", surfaces.BLACK_PLASTIC, rgb=(0.035, 0.035, 0.038), specular=0.05, shininess=0.1)
    builder.material("vehicle_tyre", surfaces.RUBBER, rgb=(0.035, 0.035, 0.038), specular=0.05, shininess=0.1)
    builder.material("vehicle_rim", surfaces.METAL, rgb=(0.60, 0.61, 0.63), specular=0.5, shininess=0.5)
    builder.material("vehicle_head_lamp", surfaces.GLASS, rgb=(0.88, 0.90, 0.92), specular=0.8, shininess=0.8)
    builder.material("vehicle_tail_lamp", surfaces.GLASS, rgb=(0.60, 0.03, 0.03), specular=0.6, shininess=0.7)
    builder.material("vehicle_lit", surfaces.PLASTIC, rgb=(0.98, 0.62, 0.12), specular=0.1)
    builder.material("vehicle_box", surfaces.PAINTED_METAL, rgb=(0.86, 0.87, 0.88), specular=0.3, shininess=0.4)
    builder.material("vehicle_skin", surfaces.SKIN, rgb=(0.62, 0.44, 0.34), specular=0.0)
    builder.material("vehicle_hair", surfaces.HAIR, rgb=(0.10, 0.07, 0.05), specular=0.0)
    for i in range(PLATES):
        builder.texture(f"plate_{i}", _plate_png(i))
        builder.material(f"vehicle_plate_{i}", surfaces.PLASTIC, texture=f"plate_{i}", specular=0.2)


def paint_material(builder: MapBuilder, paint: str) -> str:
    return builder.material(
        f"paint_coat_{paint}", surfaces.PAINTED_METAL, rgb=PAINTS[paint], specular=0.5, shininess=0.6
    )


def draw_paint(rng: RandomGenerator) -> str:
    return rng.pick(_COMMON)
