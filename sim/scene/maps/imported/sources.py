"""Files of other programs as sources of a scene's map: make the map of them, and copy them to a run.

All reading and making is done in a process with limits (sim/scene/limited_process.py): GEOS, OpenCV and Python's own
containers can need any memory and time for a file that was made for it.
"""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from signals.documents.document import shown_path
from signals.errors import ConfigError
from sim.scene.budget import Budget
from sim.scene.limited_process import limited
from sim.scene.map_section import ElevationMap, GltfMap, OsmMap
from sim.scene.maps.imported.imported_map import ImportedMap
from sim.scene.scene import Scene, Site
from sim.scene.scene_map import Surface

# Modules with what is done in the process; the bench itself does not import the readers.
_GLTF, _OSM = "sim.scene.maps.imported.gltf_import", "sim.scene.maps.imported.osm_import"
_ELEVATION = "sim.scene.maps.imported.elevation_import"


@dataclass(frozen=True)
class GltfSource:
    """A glTF file."""

    path: Path
    section: GltfMap
    budget: Budget  # rest of the limits of the map, after what was made so far
    _key: list[str] = field(default_factory=list)

    def key(self) -> str:
        """Return a hash of the files. Raises ConfigError."""
        if not self._key:
            self._key.append(limited(f"{_GLTF}:key", self.path, self.budget, budget=self.budget, what="reading it"))
        return self._key[0]

    def make(self, surfaces: dict[str, Surface]) -> ImportedMap:
        """Return the map; `surfaces` by pattern of material names. Raises ConfigError."""
        arguments = (self.path, self.section, surfaces, self.budget)
        return limited(f"{_GLTF}:made", *arguments, budget=self.budget, what="making its map")

    def save(self, folder: Path) -> dict[str, Any]:
        """Copy the files to a folder; return the keys of section `map` that name them, relative to `folder`."""
        arguments = (self.path, (folder / "map.glb").absolute(), self.budget)
        limited(f"{_GLTF}:pack", *arguments, budget=self.budget, what="copying it")
        return {"gltf": "map.glb"}


@dataclass(frozen=True)
class SiteSource:
    """An OpenStreetMap extract, a GeoTIFF of heights, or both, round a site: paths by their keys of section `map`."""

    paths: dict[str, Path]
    section: OsmMap | ElevationMap
    site: Site
    budget: Budget

    def key(self) -> str:
        state = hashlib.sha256(self.site.model_dump_json().encode())
        for path in self.paths.values():
            state.update(_digest(path))
        return state.hexdigest()

    def make(self, surfaces: dict[str, Surface]) -> ImportedMap:  # noqa: ARG002
        module = _OSM if "osm" in self.paths else _ELEVATION
        arguments = (self.paths, self.section, self.site, self.budget)
        return limited(f"{module}:made", *arguments, budget=self.budget, what="making its map")

    def save(self, folder: Path) -> dict[str, Any]:
        names = {}
        for key, path in self.paths.items():
            names[key] = "elevation.tif" if key == "elevation" else f"map.osm{'.pbf' * (path.suffix == '.pbf')}"
            shutil.copyfile(path, folder / names[key])
        return names


ImportSource = GltfSource | SiteSource


def _digest(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError as error:
        raise ConfigError.at(shown_path(path), f"cannot be read: {error.strerror or error}") from None


def import_source(scene: Scene) -> ImportSource | None:
    """Return the files of a scene's map; None for a map that is not imported. Raises ConfigError."""
    section = scene.map
    if isinstance(section, GltfMap):
        path = named_file(scene, "gltf", section.gltf)
        return GltfSource(path, section, Budget(shown_path(path)))
    if isinstance(section, OsmMap | ElevationMap):
        named = {key: getattr(section, key, None) for key in ("osm", "elevation")}
        paths = {key: named_file(scene, key, name) for key, name in named.items() if name is not None}
        return SiteSource(paths, section, scene.site, Budget(shown_path(next(iter(paths.values())))))
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


def files_root(scene: Scene, path: Path) -> Path:
    """Return the folder that holds all files of an MJCF map: that of the scene's file if it lies above the map."""
    folder = scene.file.folder
    return folder if path.resolve().is_relative_to(folder.resolve()) else path.parent
