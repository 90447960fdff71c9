"""Materials of vehicles: paints, glass, dark trim, rims, lamps, number plates."""

from __future__ import annotations

from functools import cache

import numpy as np

from sim.scene.maps import surfaces
from sim.scene.maps.dot_font import write
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.texture_tools import clouds, encoded_png, step
from sim.scene.maps.vehicles.lofts import at_knots
from sim.scene.random_generator import RandomGenerator

PAINTS = {
    "silver": (0.66, 0.68, 0.70), "black": (0.05, 0.05, 0.06), "white": (0.90, 0.90, 0.89), "red": (0.42, 0.07, 0.07),
    "blue": (0.10, 0.15, 0.26), "green": (0.08, 0.16, 0.13), "grey": (0.30, 0.31, 0.33), "olive": (0.31, 0.33, 0.20),
    "yellow": (0.90, 0.68, 0.08), "orange": (0.85, 0.36, 0.06), "sand": (0.62, 0.55, 0.42),
}  # fmt: skip
# Shares of the paints of new cars, rounded: white, grey, black and silver are three quarters.
_COMMON = ("white", "white", "grey", "grey", "black", "black", "silver", "silver", "blue", "blue", "red", "green")
# Brightness of what the paint of an upright side reflects, by the share of the height: the shade below the car, the
# road, what stands along it, and from the shoulder on the sky.
_REFLECTED = (
    (0.0, 0.36), (0.12, 0.45), (0.28, 0.78), (0.40, 0.60), (0.46, 1.0), (0.52, 0.86), (0.60, 1.0), (1.0, 1.0),
)  # fmt: skip
_SHAPES = ((0.0, 0.10), (0.5, 0.16), (0.6, 0.40), (1.0, 0.40))  # share of the light that reflected shapes take
_SIDE_PX = 128
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
def _reflection_png() -> bytes:
    """Return what paint reflects, all round (u) and from the ground to the roof (v), with soft shapes in the sky."""
    size = (_SIDE_PX, _SIDE_PX)
    heights = [1.0 - (k + 0.5) / _SIDE_PX for k in range(_SIDE_PX)]
    light, depth = (np.array([at_knots(knots, v) for v in heights])[:, None] for knots in (_REFLECTED, _SHAPES))
    shapes = step(0.3, 0.7, 0.7 * clouds("paint", 5, 6, size) + 0.3 * clouds("paint_fine", 11, 14, size))
    image = (255.0 * light * (1.0 - depth * shapes) + 0.5).astype(np.uint8)
    return encoded_png(np.stack([image] * 3, axis=-1))


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
    """Return the paint of a body; its meshes have `reflecting` texture coordinates."""
    red, green, blue = (min(1.0, 1.12 * value) for value in PAINTS[paint])
    texture = builder.texture("paint_reflection", _reflection_png())
    return builder.material(
        f"paint_coat_{paint}", surfaces.PAINTED_METAL, rgb=(red, green, blue), texture=texture, specular=0.5,
        shininess=0.6,
    )  # fmt: skip


def reflecting(mesh: Mesh) -> Mesh:
    """Return a painted mesh with texture coordinates for what paint reflects: once along 4 m, and up to its top."""
    high = max((z for _, _, z in mesh.vertices), default=1.0)
    uvs = [((x + 0.35 * y) / 4.0, min(0.99, max(0.01, z / high))) for x, y, z in mesh.vertices]
    return Mesh(mesh.vertices, uvs, mesh.triangles)


def draw_paint(rng: RandomGenerator) -> str:
    return rng.pick(_COMMON)
