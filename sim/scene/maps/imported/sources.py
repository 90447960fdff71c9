"""Files of other programs as sources of a scene's map: make the map of them, and copy them to a run.

All reading and making is done in a process with limits (sim/scene/limited_process.py): GEOS, OpenCV and Python's own
containers can need any memory and time for a file that was made for it.
"""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

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


class ImportSource(Protocol):
    """The files of one imported map."""

    @property
    def budget(self) -> Budget:
        """Rest of the limits of the map, after what was made so far."""
        ...

    def key(self) -> str:
        """Return a hash of the files. Raises ConfigError."""
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

    path: Path
    section: GltfMap
    budget: Budget
    _key: list[str] = field(default_factory=list)

    def key(self) -> str:
        if not self._key:
            self._key.append(limited(f"{_GLTF}:key", self.path, self.budget, budget=self.budget, what="reading it"))
        return self._key[0]

    def make(self, surfaces: dict[str, Surface]) -> ImportedMap:
        arguments = (self.path, self.section, surfaces, self.budget)
        return limited(f"{_GLTF}:made", *arguments, budget=self.budget, what="making its map")

    def save(self, folder: Path) -> dict[str, Any]:
        arguments = (self.path, (folder / "map.glb").absolute(), self.budget)
        limited(f"{_GLTF}:pack", *arguments, budget=self.budget, what="copying it")
        return {"gltf": "map.glb"}


@dataclass(frozen=True)
class OsmSource:
    """An OpenStreetMap extract, with heights if the section names them."""

    path: Path
    elevation: Path | None
    section: OsmMap
    site: Site
    budget: Budget

    def key(self) -> str:
        state = hashlib.sha256(self.site.model_dump_json().encode())
        for path in (self.path, self.elevation):
            if path is not None:
                state.update(_digest(path))
        return state.hexdigest()

    def make(self, surfaces: dict[str, Surface]) -> ImportedMap:  # noqa: ARG002
        arguments = (self.path, self.elevation, self.section, self.site, self.budget)
        return limited(f"{_OSM}:made", *arguments, budget=self.budget, what="making its map")

    def save(self, folder: Path) -> dict[str, Any]:
        names = {"osm": "map.osm.pbf" if self.path.suffix == ".pbf" else "map.osm"}
        shutil.copyfile(self.path, folder / names["osm"])
        if self.elevation is not None:
            names["elevation"] = "elevation.tif"
            shutil.copyfile(self.elevation, folder / names["elevation"])
        return names


@dataclass(frozen=True)
class ElevationSource:
    """A GeoTIFF of heights."""

    path: Path
    section: ElevationMap
    site: Site
    budget: Budget

    def key(self) -> str:
        return hashlib.sha256(self.site.model_dump_json().encode() + _digest(self.path)).hexdigest()

    def make(self, surfaces: dict[str, Surface]) -> ImportedMap:  # noqa: ARG002
        arguments = (self.path, self.section, self.site, self.budget)
        return limited(f"{_ELEVATION}:made", *arguments, budget=self.budget, what="making its map")

    def save(self, folder: Path) -> dict[str, Any]:
        shutil.copyfile(self.path, folder / "elevation.tif")
        return {"elevation": "elevation.tif"}


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
    if isinstance(section, OsmMap):
        path = named_file(scene, "osm", section.osm)
        elevation = None
        if section.elevation is not None:
            elevation = named_file(scene, "elevation", section.elevation)
        return OsmSource(path, elevation, section, scene.site, Budget(shown_path(path)))
    if isinstance(section, ElevationMap):
        path = named_file(scene, "elevation", section.elevation)
        return ElevationSource(path, section, scene.site, Budget(shown_path(path)))
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
