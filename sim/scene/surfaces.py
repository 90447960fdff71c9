"""Surfaces by name, which a scene assigns to the materials of its MJCF. Sources: `sim.scene.maps.surfaces`."""

from __future__ import annotations

from sim.scene.maps import surfaces
from sim.scene.maps.scene_map import Surface

_NAMES = """
    concrete brick wood metal glass asphalt soil grass water plastic plaster roof_tile stone painted_metal gravel sand
    rubber
"""
SURFACES: dict[str, Surface] = {name: getattr(surfaces, name.upper()) for name in _NAMES.split()}
SURFACES |= {"foliage": surfaces.LEAVES, "skin_clothes": surfaces.CLOTH}
NO_SURFACE = Surface(lidar_reflectivity=0.0, relative_permittivity=1.0, conductivity_s_per_m=0.0, roughness_m=0.0)
DEFAULT_SURFACE = SURFACES["concrete"]  # of geoms without a material, or with one that has no surface
MAX_SURFACES = 256  # a surface id is one byte
