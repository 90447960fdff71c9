"""A model from the user's own glTF file, in place of a shipped one.

Triangles are grouped by the names of nodes and of materials. A material with the name of one of ours ("paint", "glass",
"tyre" of vehicles) looks as ours does; others keep their colour and texture. Nodes whose names begin with "contact" are
solid, each as its convex hull; without such a node the hull of everything is.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.scene.imports.gltf_file import GltfFile, read_gltf
from sim.scene.imports.gltf_geometry import Notes, placed_meshes, surfaces_of
from sim.scene.maps.imported.gltf_materials import decoded, look_of, png_of
from sim.scene.maps.model import CONTACT, Look, Model
from sim.scene.maps.shipped_mesh import ShippedMesh, joined

_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_WHOLE = f"{CONTACT}_whole"
_ANY_PIECES = frozenset({"body", "chassis"})  # of vehicles that may have any pieces
_SIZES = {"box": 3, "cylinder": 2}


def read_own_model(path: Path, shipped: Model) -> Model:
    """Return the model of a file, in place of a shipped one. Raises ConfigError that names the file."""
    file = read_gltf(path)
    found: dict[str, dict[str, list[ShippedMesh]]] = {}
    looks: dict[str, Look] = {}
    for node, material, mesh in _meshes(file, looks):
        found.setdefault(node, {}).setdefault(material, []).append(mesh)
    if not found:
        raise file.error("", "shows no mesh: its scene has no node with triangles")
    pieces = {node: {key: joined(meshes) for key, meshes in parts.items()} for node, parts in found.items()}
    facts = _facts(file)
    if _ANY_PIECES.isdisjoint(shipped.pieces):
        missing = [piece for piece in shipped.pieces if piece not in pieces]
        if missing:
            raise file.error("", f"lacks nodes that {shipped.name}.glb has: {', '.join(missing)}")
        facts = {**shipped.facts, **facts}
        if "radius" in facts:  # of people: how far each part reaches
            facts["radius"] = {piece: _radius(list(parts.values())) for piece, parts in pieces.items()}
    if "contact" not in facts:
        if not any(node.startswith(CONTACT) for node in pieces):
            pieces[_WHOLE] = {"": joined([mesh for parts in pieces.values() for mesh in parts.values()])}
        facts["contact"] = [{"kind": "hull", "piece": node} for node in pieces if node.startswith(CONTACT)]
    points = np.concatenate([mesh.vertices for parts in pieces.values() for mesh in parts.values()])
    length_m, width_m, height_m = (float(v) for v in np.ptp(points, axis=0))
    facts = {"length_m": length_m, "width_m": width_m, "height_m": height_m, **facts}
    made = Model(shipped.name, pieces, facts, looks, is_own=True)
    try:
        solid = [contact.hull is not None or _SIZES[contact.kind] == len(contact.size) for contact in made.contacts]
    except (KeyError, TypeError, ValueError):
        solid = [False]
    if not all(solid):
        hint = f"as in {shipped.name}.glb, or leave it out"
        raise file.error("extras.contact of its scene", "is not a list of boxes, cylinders and hulls", hint)
    return made


def _radius(meshes: list[ShippedMesh]) -> float:
    return max(float(np.sqrt((mesh.vertices.astype(np.float64) ** 2).sum(axis=1).max())) for mesh in meshes)


def _facts(file: GltfFile) -> dict[str, Any]:
    scenes = file.raw.get("scenes") or [{}]
    extras = scenes[file.gltf.scene or 0].get("extras")
    return dict(extras) if isinstance(extras, dict) else {}


def _meshes(file: GltfFile, looks: dict[str, Look]) -> Iterator[tuple[str, str, ShippedMesh]]:
    """Yield each primitive with the names of its node and of its material; the looks of materials are added."""
    notes = Notes()
    for placed in placed_meshes(file, 1.0, np.eye(3), notes):
        linear = placed.R @ placed.scales @ _Z_UP
        mirrored = np.linalg.det(linear) < 0.0
        for part in surfaces_of(file, placed.mesh, notes):
            look = look_of(file, part.material)
            if look.name not in looks:
                png, holes = b"", False
                if look.texture is not None:
                    png, holes = png_of(decoded(file, look.texture), look.holes)
                looks[look.name] = Look(look.rgb, png, holes, look.specular, look.shininess, look.surface)
            uv = part.uv[look.uv_set] if look.uv_set < 2 else None
            uv = np.zeros((len(part.vertex), 2)) if uv is None else look.uv(uv)
            yield (
                placed.name,
                look.name,
                ShippedMesh(
                    (part.vertex @ linear.T + placed.position).astype(np.float32),
                    uv.astype(np.float32),
                    _turned(part.normal, linear),
                    part.triangle[:, ::-1] if mirrored else part.triangle,
                ),
            )


def _turned(normals: NDArray[np.float64] | None, linear: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Return unit normals after a linear map of the vertices; None if it flattens them."""
    if normals is None or np.linalg.det(linear) == 0.0:
        return None
    turned = normals @ np.linalg.inv(linear)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return None if (length < 1e-12).any() else (turned / length).astype(np.float32)
