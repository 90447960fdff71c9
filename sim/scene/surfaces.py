"""Surfaces by name, for a scene to lay on the materials of its MJCF. Values and sources: `sim.scene.maps.surfaces`."""

from __future__ import annotations

from sim.scene.maps import surfaces
from sim.scene.maps.scene_map import Surface

SURFACES: dict[str, Surface] = {
    "concrete": surfaces.CONCRETE,
    "brick": surfaces.BRICK,
    "wood": surfaces.WOOD,
    "metal": surfaces.METAL,
    "glass": surfaces.GLASS,
    "asphalt": surfaces.ASPHALT,
    "soil": surfaces.SOIL,
    "grass": surfaces.GRASS,
    "foliage": surfaces.LEAVES,
    "skin_clothes": surfaces.CLOTH,
    "water": surfaces.WATER,
    "plastic": surfaces.PLASTIC,
    "plaster": surfaces.PLASTER,
    "roof_tile": surfaces.ROOF_TILE,
    "stone": surfaces.STONE,
    "painted_metal": surfaces.PAINTED_METAL,
    "gravel": surfaces.GRAVEL,
    "sand": surfaces.SAND,
    "rubber": surfaces.RUBBER,
}
NO_SURFACE = Surface(lidar_reflectivity=0.0, relative_permittivity=1.0, conductivity_s_per_m=0.0, roughness_m=0.0)
DEFAULT_SURFACE = SURFACES["concrete"]  # of what has no material, or one that nobody described
MAX_SURFACES = 256  # a surface id is one byte
