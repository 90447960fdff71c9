"""Coloured triangles as a binary glTF 2.0 file, which Foxglove's 3-D panel takes as one model.

glTF has y up, W has z up: (x, y, z) in W is (x, z, -y) in the file. Its vertex colours are linear, a scene's are sRGB.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.frame.scene_mesh import Piece

_FLOAT, _UINT16, _ARRAY_BUFFER, _TRIANGLES = 5126, 5123, 34962, 4
_JSON, _BIN = b"JSON", b"BIN\0"


def glb(pieces: Sequence[Piece]) -> bytes:
    """Return the file. There is at least one triangle."""
    corner = np.concatenate([piece.corner for piece in pieces]).astype("<f4")
    position = np.ascontiguousarray(np.stack((corner[:, 0], corner[:, 2], -corner[:, 1]), axis=1))
    srgb = np.repeat([piece.colour / 255.0 for piece in pieces], [len(piece.corner) for piece in pieces], axis=0)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    linear[:, 3] = srgb[:, 3]
    colour = np.round(linear * 65535.0).astype("<u2")
    data = position.tobytes() + colour.tobytes()
    count = len(position)

    def view(offset: int, length: int) -> dict[str, Any]:
        return {"buffer": 0, "byteOffset": offset, "byteLength": length, "target": _ARRAY_BUFFER}

    head = {
        "asset": {"version": "2.0", "generator": "hil-bench"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "material": 0, "mode": _TRIANGLES}]}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}, "doubleSided": True}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _FLOAT,
                "count": count,
                "type": "VEC3",
                "min": position.min(axis=0).tolist(),
                "max": position.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": _UINT16, "normalized": True, "count": count, "type": "VEC4"},
        ],
        "bufferViews": [view(0, position.nbytes), view(position.nbytes, colour.nbytes)],
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(head, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), _JSON) + text + struct.pack("<I4s", len(data), _BIN) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
