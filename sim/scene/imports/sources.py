"""Files of other programs as sources of a scene's map: read them, make the map, and copy them to a run."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from signals.errors import ConfigError
from sim.scene.imports.imported_map import ImportedMap
from sim.scene.map_section import GltfMap
from sim.scene.maps.scene_map import Surface
from sim.scene.scene import Scene

if TYPE_CHECKING:
    from sim.scene.imports.gltf_file import GltfFile

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
        return hashlib.sha256(self.file.packed()).hexdigest()

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


def import_source(scene: Scene) -> ImportSource | None:
    """Read the files of a scene's map; None for a map that is not imported. Raises ConfigError."""
    section = scene.map
    if isinstance(section, GltfMap):
        from sim.scene.imports.gltf_file import read_gltf

        return GltfSource(read_gltf(named_file(scene, "gltf", section.gltf)), section)
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
