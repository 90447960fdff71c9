"""Writer of small glTF files."""

from __future__ import annotations

import json
import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray


class GlbFile:
    """A glTF file under construction; `json` may be changed before `glb` is called."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [],
        }  # fmt: skip
        self.body = bytearray()

    def view(self, data: bytes) -> int:
        self.body += b"\0" * (-len(self.body) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.body), "byteLength": len(data)})
        self.body += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: NDArray) -> int:
        codes = {"f4": 5126, "u2": 5123, "u4": 5125, "u1": 5121}
        kinds = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
        table = np.atleast_2d(values.T).T
        self.json["accessors"].append(
            {
                "bufferView": self.view(np.ascontiguousarray(table).tobytes()),
                "componentType": codes[values.dtype.str[1:]],
                "count": len(table),
                "type": kinds[table.shape[1]],
            }
        )
        return len(self.json["accessors"]) - 1

    def image(self, image: NDArray[np.uint8]) -> int:
        """Add a picture (blue first) as a texture; return the number of the texture."""
        png = bytes(cv2.imencode(".png", image)[1].tobytes())
        self.json.setdefault("images", []).append({"bufferView": self.view(png), "mimeType": "image/png"})
        self.json.setdefault("textures", []).append({"source": len(self.json["images"]) - 1})
        return len(self.json["textures"]) - 1

    def material(
        self, name: str, rgba: tuple[float, ...] = (1, 1, 1, 1), *, texture: int | None = None, **more: Any
    ) -> int:
        pbr: dict[str, Any] = {"baseColorFactor": list(rgba), "metallicFactor": 0.0, "roughnessFactor": 0.9}
        if texture is not None:
            pbr["baseColorTexture"] = {"index": texture}
        self.json.setdefault("materials", []).append({"name": name, "pbrMetallicRoughness": pbr, **more})
        return len(self.json["materials"]) - 1

    def mesh(self, name: str, *parts: tuple[NDArray, NDArray, int | None, NDArray | None]) -> int:
        """Add a mesh of (vertices, triangles, material, texture coordinates), y up."""
        primitives = []
        for vertex, triangle, material, uv in parts:
            attributes = {"POSITION": self.accessor(np.asarray(vertex, "f4"))}
            own = self.json["accessors"][attributes["POSITION"]]
            stored = np.asarray(vertex, "f4").astype(float)
            own["min"], own["max"] = stored.min(axis=0).tolist(), stored.max(axis=0).tolist()
            if uv is not None:
                attributes["TEXCOORD_0"] = self.accessor(np.asarray(uv, "f4"))
            kind = "u2" if len(vertex) < 65536 else "u4"
            primitive: dict[str, Any] = {
                "attributes": attributes,
                "indices": self.accessor(triangle.astype(kind).ravel()),
            }
            if material is not None:
                primitive["material"] = material
            primitives.append(primitive)
        self.json["meshes"].append({"name": name, "primitives": primitives})
        return len(self.json["meshes"]) - 1

    def node(self, name: str, mesh: int, **more: Any) -> None:
        self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]))
        self.json["nodes"].append({"name": name, "mesh": mesh, **more})

    def glb(self) -> bytes:
        if self.body:
            self.json["buffers"] = [{"byteLength": len(self.body)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        body = bytes(self.body) + b"\0" * (-len(self.body) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        if body:
            chunks += struct.pack("<II", len(body), 0x004E4942) + body
        return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def box(low: tuple[float, ...], high: tuple[float, ...]) -> tuple[NDArray, NDArray, NDArray]:
    """Return vertices (24, 3), triangles (12, 3) and texture coordinates in metres of a box."""
    a, b = np.array(low, float), np.array(high, float)
    vertices, triangles, uvs = [], [], []
    for axis in range(3):
        for side in (0, 1):
            u, v = [(2, 1), (0, 2), (0, 1)][axis]
            corners = []
            for s, t in ((0, 0), (1, 0), (1, 1), (0, 1)):
                point = np.empty(3)
                point[axis] = (a, b)[side][axis]
                point[u], point[v] = (a, b)[s][u], (a, b)[t][v]
                corners.append(point)
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])[axis]
            order = (0, 1, 2, 3) if (normal > 0) == bool(side) else (3, 2, 1, 0)
            first = len(vertices)
            vertices += [corners[k] for k in order]
            uvs += [(p[u], -p[v]) for p in (corners[k] for k in order)]
            triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return np.array(vertices), np.array(triangles), np.array(uvs)


def joined(*shapes: tuple[NDArray, NDArray, NDArray]) -> tuple[NDArray, NDArray, NDArray]:
    """Return several shapes as one."""
    starts = np.cumsum([0, *(len(shape[0]) for shape in shapes)])
    triangles = [shape[1] + start for shape, start in zip(shapes, starts, strict=False)]
    return np.concatenate([s[0] for s in shapes]), np.concatenate(triangles), np.concatenate([s[2] for s in shapes])
