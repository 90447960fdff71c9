"""Work on a GeoTIFF of heights in the process with limits: bare ground of one material."""

from __future__ import annotations

from pathlib import Path

from sim.scene.budget import Budget
from sim.scene.imports.elevation import make_terrain, read_geotiff
from sim.scene.map_section import ElevationMap
from sim.scene.maps import textures
from sim.scene.maps.imported.grounds import GROUNDS
from sim.scene.maps.imported.imported_map import ImportedMap
from sim.scene.maps.imported.terrain import add_terrain
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.scene import Site


def made(paths: dict[str, Path], section: ElevationMap, site: Site, budget: Budget) -> ImportedMap:
    """Return the ground round a site. Raises ConfigError."""
    terrain = make_terrain(read_geotiff(paths["elevation"], budget), site, section.radius_m)
    surface, texture, tile_m, specular = GROUNDS[section.ground]
    builder = MapBuilder("elevation", flat_meshes=True)
    builder.texture(texture, textures.png(texture))
    builder.material("ground", surface, texture=texture, tile_m=tile_m, specular=specular)
    add_terrain(builder, terrain, material="ground")
    builder.classify("ground", "ground")
    return ImportedMap(builder.build())


def middle(path: Path, budget: Budget) -> tuple[float, float, float]:
    """Return latitude, longitude and height of the known height nearest to the middle of a file. Raises ConfigError."""
    return read_geotiff(path, budget).middle()
