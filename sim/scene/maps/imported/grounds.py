"""Materials of the ground of imported maps."""

from __future__ import annotations

from typing import NamedTuple

from sim.scene import surfaces
from sim.scene.scene_map import Surface


class Ground(NamedTuple):
    """Surface, texture of `textures`, and the edge of the texture's tile."""

    surface: Surface
    texture: str
    tile_m: float
    specular: float = 0.0


GROUNDS = {
    "grass": Ground(surfaces.GRASS, "grass", 16.0),
    "gravel": Ground(surfaces.GRAVEL, "gravel", 4.0),
    "asphalt": Ground(surfaces.ASPHALT, "asphalt", 6.0),
    "paving": Ground(surfaces.CONCRETE, "paving", 4.8),
    "soil": Ground(surfaces.SOIL, "earth", 16.0),
    "sand": Ground(surfaces.SAND, "earth", 16.0),
    "water": Ground(surfaces.WATER, "water", 5.0, specular=0.9),
    "wood": Ground(surfaces.WOOD, "wood", 0.6),
}
