"""Files of other programs as sources of a scene's map: read them, make the map, and copy them to a run."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from signals.errors import ConfigError
from sim.scene.imports.imported_map import ImportedMap
from sim.scene.map_section import GltfMap, OsmMap
from sim.scene.maps.scene_map import Surface
from sim.scene.scene import Scene, Site

if TYPE_CHECKING:
    from sim.scene.imports.elevation import GeoTiff
    from sim.scene.imports.gltf_file import GltfFile
    from sim.scene.imports.osm_file import OsmData

# The readers are imported where they are used, because most flights need none of them.


class ImportSource(Protocol):
    """The files of one imported map."""

    def key(self) -> str:
        """Return a hash of the files."""
        ...

    def make(self, surfaces: dict[str, Surface]) -> ImportedMap:
        """Return the map; `surfaces` by pattern of material names. Raises ConfigError."""
        ...

    def save(self, folder: Path) -> dict[str, Any]:
        """Copy the files to a folder; return the keys of section `map` that name them, relative to `folder`."""
        ...


@dataclass(frozen=True)
class GltfSource:
    """A glTF file."""

    file: GltfFile
    section: GltfMap

    def key(self) -> str:
        state = hashlib.sha256(json.dumps(self.file.raw).encode())
        for data in (*self.file.buffers, *self.file.images.values()):
            state.update(len(data).to_bytes(8, "little"))
            state.update(data)
        return state.hexdigest()

    def make(self, surfaces: dict[str, Surface]) -> ImportedMap:
        from sim.scene.imports.gltf_map import GltfOptions, map_of_gltf

        section = self.section
        options = GltfOptions(
            section.scale, section.yaw_deg, section.origin_m, section.ground, section.classes, surfaces,
            section.contact_error_m,
        )  # fmt: skip
        return map_of_gltf(self.file, options)

    def save(self, folder: Path) -> dict[str, Any]:
        (folder / "map.glb").write_bytes(self.file.packed())
        return {"gltf": "map.glb"}


@dataclass(frozen=True)
class OsmSource:
    """An OpenStreetMap extract, with heights if the section names them."""

    path: Path
    data: OsmData
    heights: GeoTiff | None
    section: OsmMap
    site: Site

    def key(self) -> str:
        state = hashlib.sha256(self.path.read_bytes())
        state.update(self.heights.data if self.heights is not None else b"")
        state.update(self.site.model_dump_json().encode())
        return state.hexdigest()

    def make(self, surfaces: dict[str, Surface]) -> ImportedMap:  # noqa: ARG002
        from sim.scene.imports.elevation import make_terrain
        from sim.scene.imports.osm_map import OsmOptions, map_of_osm

        section = self.section
        terrain = make_terrain(self.heights, self.site, section.radius_m) if self.heights is not None else None
        options = OsmOptions(section.radius_m, section.seed, section.ground, section.max_trees, section.classes)
        return map_of_osm(self.data, self.site, options, terrain)

    def save(self, folder: Path) -> dict[str, Any]:
        name = "map.osm.pbf" if self.path.suffix == ".pbf" else "map.osm"
        (folder / name).write_bytes(self.path.read_bytes())
        if self.heights is None:
            return {"osm": name}
        (folder / "elevation.tif").write_bytes(self.heights.data)
        return {"osm": name, "elevation": "elevation.tif"}


def import_source(scene: Scene) -> ImportSource | None:
    """Read the files of a scene's map; None for a map that is not imported. Raises ConfigError."""
    section = scene.map
    if isinstance(section, GltfMap):
        from sim.scene.imports.gltf_file import read_gltf

        return GltfSource(read_gltf(named_file(scene, "gltf", section.gltf)), section)
    if isinstance(section, OsmMap):
        from sim.scene.imports.elevation import read_geotiff
        from sim.scene.imports.osm_file import read_osm

        path = named_file(scene, "osm", section.osm)
        data = scene.file.cache.get("osm")
        if data is None:
            data = scene.file.cache["osm"] = read_osm(path)
        heights = None
        if section.elevation is not None:
            heights = read_geotiff(named_file(scene, "elevation", section.elevation))
        return OsmSource(path, data, heights, section, scene.site)
    return None


def named_file(scene: Scene, key: str, name: str) -> Path:
    """Return the path of a file that the key of section `map` names. Raises ConfigError if there is none."""
    path = scene.file.folder / name
    try:
        path = path.expanduser()
        exists = path.is_file()
    except (OSError, RuntimeError, ValueError):
        exists = False
    if not exists:
        message = f"names a file that does not exist: {name}"
        raise ConfigError([scene.file.problem(("map", key), message, f"looked beside {scene.file.document.source}")])
    return path
