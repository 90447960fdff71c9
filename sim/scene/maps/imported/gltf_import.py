"""Work on a glTF file in the process with limits."""

from __future__ import annotations

from pathlib import Path

from sim.scene.budget import Budget
from sim.scene.imports.gltf_file import read_gltf
from sim.scene.map_section import GltfMap
from sim.scene.maps.imported.gltf_map import GltfOptions, map_of_gltf
from sim.scene.maps.imported.imported_map import ImportedMap
from sim.scene.scene_map import Surface


def key(path: Path, budget: Budget) -> str:
    """Return a hash of the file and of all files that it names. Raises ConfigError, as the others do."""
    return read_gltf(path, budget).key()


def made(path: Path, section: GltfMap, surfaces: dict[str, Surface], budget: Budget) -> ImportedMap:
    """Return the map of the file."""
    options = GltfOptions(
        section.scale, section.yaw_deg, section.origin_m, section.ground, section.classes, surfaces,
        section.contact_error_m,
    )  # fmt: skip
    return map_of_gltf(read_gltf(path, budget), options)


def pack(path: Path, packed: Path, budget: Budget) -> None:
    """Write the file with everything that it names as one GLB."""
    packed.write_bytes(read_gltf(path, budget).packed())
