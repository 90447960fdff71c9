"""Materials of vehicles: paints, glass, dark trim, rims, lamps, number plates."""

from __future__ import annotations

from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.random_generator import RandomGenerator

PAINTS = {
    "silver": (0.66, 0.68, 0.70), "black": (0.16, 0.16, 0.17), "white": (0.79, 0.79, 0.78), "red": (0.56, 0.10, 0.09),
    "blue": (0.17, 0.25, 0.40), "green": (0.17, 0.28, 0.23), "grey": (0.39, 0.40, 0.42), "olive": (0.31, 0.33, 0.20),
    "yellow": (0.90, 0.68, 0.08), "orange": (0.85, 0.36, 0.06), "sand": (0.62, 0.55, 0.42),
}  # fmt: skip
# Shares of the paints of new cars, rounded: white, grey, black and silver are three quarters.
_COMMON = ("white", "white", "grey", "grey", "black", "black", "silver", "silver", "blue", "blue", "red", "green")
PLATES = 3
BOXES = 3  # liveries of lorries
# Clear coat: a refractive index of 1.5 to 1.55 mirrors 0.045 of the light head on, here 0.08 _COAT _GLOSS. With more
# gloss, faces at grazing incidence below the sills would be brighter than the road.
_COAT, _GLOSS = 0.8, 0.7


def vehicle_materials(builder: MapBuilder) -> None:
    """Add the materials that all vehicles share."""
    builder.texture("vehicle_glass", textures.png("vehicle_glass"))
    builder.material("vehicle_glass", surfaces.GLASS, texture="vehicle_glass", specular=0.9, shininess=0.9)
    builder.material("vehicle_trim", surfaces.BLACK_PLASTIC, rgb=(0.12, 0.12, 0.125), specular=0.05, shininess=0.1)
    builder.material("vehicle_tyre", surfaces.RUBBER, rgb=(0.16, 0.16, 0.16), specular=0.05, shininess=0.1)
    builder.material("vehicle_rim", surfaces.METAL, rgb=(0.60, 0.61, 0.63), specular=0.5, shininess=0.5)
    builder.material("vehicle_head_lamp", surfaces.GLASS, rgb=(0.82, 0.84, 0.86), specular=0.8, shininess=0.8)
    builder.material("vehicle_tail_lamp", surfaces.GLASS, rgb=(0.60, 0.03, 0.03), specular=0.6, shininess=0.7)
    builder.material("vehicle_lit", surfaces.PLASTIC, rgb=(0.98, 0.62, 0.12), specular=0.1)
    for i in range(BOXES):
        builder.texture(f"vehicle_box_{i}", textures.png(f"vehicle_box_{i}"))
        builder.material(
            f"vehicle_box_{i}", surfaces.PAINTED_METAL, texture=f"vehicle_box_{i}", specular=0.3, shininess=0.4
        )
    builder.material("vehicle_skin", surfaces.SKIN, rgb=(0.62, 0.44, 0.34), specular=0.0)
    builder.material("vehicle_hair", surfaces.HAIR, rgb=(0.10, 0.07, 0.05), specular=0.0)
    for i in range(PLATES):
        builder.texture(f"plate_{i}", textures.png(f"plate_{i}"))
        builder.material(f"vehicle_plate_{i}", surfaces.NUMBER_PLATE, texture=f"plate_{i}", specular=0.2)


def paint_material(builder: MapBuilder, paint: str) -> str:
    """Return the paint of a body; its meshes have texture coordinates for what it reflects."""
    red, green, blue = (min(1.0, 1.12 * value) for value in PAINTS[paint])
    texture = builder.texture("paint_reflection", textures.png("paint_reflection"))
    return builder.material(
        f"paint_coat_{paint}", surfaces.PAINTED_METAL, rgb=(red, green, blue), texture=texture, specular=_COAT,
        shininess=_GLOSS,
    )  # fmt: skip


def draw_paint(rng: RandomGenerator) -> str:
    return rng.pick(_COMMON)
