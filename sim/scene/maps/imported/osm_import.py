"""Work on an OpenStreetMap extract in the process with limits."""

from __future__ import annotations

from pathlib import Path

from signals.geodesy import Site
from sim.scene.budget import Budget
from sim.scene.imports.elevation import make_terrain, read_geotiff
from sim.scene.imports.osm_file import read_osm
from sim.scene.map_section import OsmMap
from sim.scene.maps.imported.imported_map import ImportedMap
from sim.scene.maps.imported.osm_map import OsmOptions, map_of_osm, take_off_place


def made(paths: dict[str, Path], section: OsmMap, site: Site, budget: Budget) -> ImportedMap:
    """Return the map of an extract, on the ground of a GeoTIFF if there is one. Raises ConfigError."""
    heights = read_geotiff(paths["elevation"], budget) if "elevation" in paths else None
    data = read_osm(paths["osm"], budget)
    terrain = make_terrain(heights, site, section.radius_m) if heights is not None else None
    options = OsmOptions(
        section.radius_m, section.seed, section.ground, section.max_trees, section.objects, section.classes
    )
    return map_of_osm(data, site, options, terrain, budget)


def free_place(path: Path, radius_m: float, budget: Budget) -> tuple[float, float]:
    """Return latitude and longitude of free ground close to the middle of an extract. Raises ConfigError."""
    return take_off_place(read_osm(path, budget), radius_m)
