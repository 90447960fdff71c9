"""Writer of models: pieces of meshes as one GLB file, in the layout that sim/scene/maps/models.py reads."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.scene.maps.meshes import Mesh
from tools.art.people.loft import SmoothMesh
from tools.art.plants.cards import CardMesh

Pieces = Mapping[str, Mapping[str, Mesh]]  # by piece and by material; "": without a material
_GLB, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_ARRAYS, _INDICES = 34962, 34963  # targets of buffer views
# From z up, x forward, y left to glTF's y up: (x, y, z) -> (x, z, -y), in columns.
_Y_UP = (1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1)
# Colours (linear) for programs that show the file; the bench has its own.
_SHOWN = {
    "paint": (0.45, 0.45, 0.47), "box": (0.7, 0.7, 0.7), "glass": (0.02, 0.03, 0.04), "trim": (0.01, 0.01, 0.01),
    "tyre": (0.01, 0.01, 0.01), "rim": (0.35, 0.35, 0.36), "head_lamp": (0.8, 0.8, 0.8), "tail_lamp": (0.4, 0.0, 0.0),
    "lit": (0.9, 0.35, 0.01), "plate": (0.85, 0.85, 0.85), "skin": (0.35, 0.16, 0.1), "cloth": (0.1, 0.1, 0.2),
    "hair": (0.01, 0.005, 0.004),
}  # fmt: skip


def arrays_of(mesh: Mesh) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32] | None]:
    """Return vertices, texture coordinates (v downwards) and normals, in the precision of MuJoCo.

    Values of people are rounded to 6, 5 and 4 decimals.
    """
    vertices, uvs = np.array(mesh.vertices, np.float64), np.array(mesh.uvs, np.float64)
    normals = None
    if isinstance(mesh, SmoothMesh):
        vertices, uvs, normals = (
            np.array([[float(f"{v:.{digits}f}") for v in row] for row in rows])
            for rows, digits in ((mesh.vertices, 6), (mesh.uvs, 5), (mesh.normals(), 4))
        )
    elif isinstance(mesh, CardMesh):
        normals = np.array(mesh.normals, np.float64)
    down = uvs.astype(np.float32)
    down[:, 1] = np.float32(1.0) - down[:, 1]
    return vertices.astype(np.float32), down, None if normals is None else normals.astype(np.float32)


class _Body:
    """Binary part of the file under construction."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: NDArray[Any], kind: str, *, limits: bool = False) -> int:
        """Append an array and return the number of its accessor."""
        codes = {"<f4": 5126, "<u2": 5123, "<u4": 5125}
        target = _INDICES if kind == "SCALAR" else _ARRAYS
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes, "target": target})
        accessor = {
            "bufferView": len(self.views) - 1, "componentType": codes[values.dtype.str],
            "count": values.size if kind == "SCALAR" else len(values), "type": kind,
        }  # fmt: skip
        if limits:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self.accessors.append(accessor)
        self.data += values.tobytes()
        self.data += b"\0" * (-len(self.data) % 4)
        return len(self.accessors) - 1


def glb(name: str, pieces: Pieces, facts: Mapping[str, Any]) -> bytes:
    """Return a model as GLB; empty meshes are left out, and so are pieces without any."""
    body, materials = _Body(), list[str]()
    nodes: list[dict[str, Any]] = [{"name": name, "matrix": _Y_UP, "children": []}]
    meshes: list[dict[str, Any]] = []
    for piece, by_material in pieces.items():
        primitives = []
        for material, mesh in by_material.items():
            if not mesh.triangles:
                continue
            vertices, uvs, normals = arrays_of(mesh)
            attributes = {"POSITION": body.add(vertices, "VEC3", limits=True), "TEXCOORD_0": body.add(uvs, "VEC2")}
            if normals is not None:
                attributes["NORMAL"] = body.add(normals, "VEC3")
            corners = np.array(mesh.triangles, "<u2" if len(vertices) < 0xFFFF else "<u4")
            primitive = {"attributes": attributes, "indices": body.add(corners, "SCALAR")}
            if material:
                if material not in materials:
                    materials.append(material)
                primitive["material"] = materials.index(material)
            primitives.append(primitive)
        if primitives:
            nodes[0]["children"].append(len(nodes))
            nodes.append({"name": piece, "mesh": len(meshes)})
            meshes.append({"name": piece, "primitives": primitives})
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "hil-bench tools/art"}, "scene": 0,
        "scenes": [{"nodes": [0], "extras": facts}], "nodes": nodes, "meshes": meshes,
        "accessors": body.accessors, "bufferViews": body.views, "buffers": [{"byteLength": len(body.data)}],
    }  # fmt: skip
    if materials:
        document["materials"] = [_material(material) for material in materials]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), _JSON) + text + struct.pack("<II", len(body.data), _BIN) + bytes(body.data)
    return struct.pack("<III", _GLB, 2, 12 + len(chunks)) + chunks


def _material(name: str) -> dict[str, Any]:
    colour = (*_SHOWN[name], 1.0)
    return {
        "name": name, "doubleSided": True,
        "pbrMetallicRoughness": {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.5},
    }  # fmt: skip
