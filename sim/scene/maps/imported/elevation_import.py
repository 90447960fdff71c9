"""Work on a GeoTIFF of heights in the process with limits: bare ground of one material."""

from __future__ import annotations

from pathlib import Path

from sim.scene import surfaces
from sim.scene.budget import Budget
from sim.scene.imports.elevation import make_terrain, read_geotiff
from sim.scene.map_section import ElevationMap
from sim.scene.maps import textures
from sim.scene.maps.imported.imported_map import ImportedMap
from sim.scene.maps.imported.terrain import add_terrain
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.scene import Site

# Of each ground: surface, texture, edge of its tile [m].
_GROUNDS = {
    "grass": (surfaces.GRASS, "grass", 16.0),
    "paving": (surfaces.CONCRETE, "paving", 4.8),
    "gravel": (surfaces.GRAVEL, "gravel", 4.0),
    "soil": (surfaces.SOIL, "earth", 16.0),
    "asphalt": (surfaces.ASPHALT, "asphalt", 6.0),
    "sand": (surfaces.SAND, "earth", 16.0),
}


def made(path: Path, section: ElevationMap, site: Site, budget: Budget) -> ImportedMap:
    """Return the ground round a site. Raises ConfigError."""
    terrain = make_terrain(read_geotiff(path, budget), site, section.radius_m)
    surface, texture, tile_m = _GROUNDS[section.ground]
    builder = MapBuilder("elevation", flat_meshes=True)
    builder.texture(texture, textures.png(texture))
    builder.material("ground", surface, texture=texture, tile_m=tile_m, specular=0.0)
    add_terrain(builder, terrain, material="ground")
    builder.classify("ground", "ground")
    return ImportedMap(builder.build())


def middle(path: Path, budget: Budget) -> tuple[float, float, float]:
    """Return latitude, longitude and height of the known height nearest to the middle of a file. Raises ConfigError."""
    return read_geotiff(path, budget).middle()
