"""Models of vehicles, people, plants and objects: the GLB files of sim/scene/assets/models, made by tools/art.

A file holds pieces, one node each, below a node that turns them from z up to glTF's y up; arrays are in the precision
of MuJoCo. `extras` of the scene are facts that the maps need besides the meshes. A user's own file (asset_files.py) may
be any glTF 2.0 file: own_model.py.
"""

from __future__ import annotations

import json
import struct
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.scene.maps.asset_files import asset_file, shipped_file
from sim.scene.maps.model import Model
from sim.scene.maps.shipped_mesh import ShippedMesh

_TYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
_BIN_HEADER_BYTES = 8


@cache
def model(name: str) -> Model:
    """Return the model `name`, such as vehicles/sedan_a, read once in a process.

    Raises ConfigError if a user's own file cannot be used.
    """
    path, is_own = asset_file(f"models/{name}.glb")
    if not is_own:
        return _read(name, path)
    # Imported here because hardly anybody has models of their own.
    from sim.scene.maps.own_model import read_own_model

    return read_own_model(path, _read(name, shipped_file(f"models/{name}.glb")))


def _read(name: str, path: Path) -> Model:
    data = path.read_bytes()
    (text_bytes,) = struct.unpack_from("<I", data, 12)
    start = 20 + text_bytes
    document = json.loads(data[20:start])
    body = memoryview(data)[start + _BIN_HEADER_BYTES :]
    views, accessors = document["bufferViews"], document["accessors"]
    materials = [material["name"] for material in document.get("materials", [])]

    def array(index: int) -> NDArray[Any]:
        accessor, width = accessors[index], _WIDTHS[accessors[index]["type"]]
        values = np.frombuffer(
            body, _TYPES[accessor["componentType"]], accessor["count"] * width,
            views[accessor["bufferView"]]["byteOffset"],
        )  # fmt: skip
        return values.reshape(-1, 3) if width == 1 else values.reshape(-1, width)

    pieces: dict[str, dict[str, ShippedMesh]] = {}
    for node in document["nodes"][1:]:
        meshes = pieces[node["name"]] = {}
        for primitive in document["meshes"][node["mesh"]]["primitives"]:
            at = primitive["attributes"]
            normals = array(at["NORMAL"]) if "NORMAL" in at else None
            material = materials[primitive["material"]] if "material" in primitive else ""
            meshes[material] = ShippedMesh(
                array(at["POSITION"]), array(at["TEXCOORD_0"]), normals, array(primitive["indices"])
            )
    return Model(name, pieces, document["scenes"][0].get("extras", {}))
