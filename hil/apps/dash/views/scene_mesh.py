"""Mesh of a scene in the bytes that the page's 3-D view reads."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from sim.frame.scene_mesh import Piece, scene_mesh


def scene_triangles(world: Any) -> bytes:
    """Encode a scene: the mesh of everything static, uint32 number of people and vehicles, then a moving mesh for each.

    A mesh is a uint32 count, then per corner three float32 [m] and four uint8 (red, green, blue, 255). The static mesh
    is in W. Before a moving mesh comes its place at the start, four float32: x, y, z [m] and yaw [rad]. The mesh is in
    the frame of that place.
    `world`: sim.scene.world.World.
    """
    mesh = scene_mesh(world)
    encoded = [_packed(mesh.still), struct.pack("<I", len(mesh.moving))]
    for place, pieces in mesh.moving:
        encoded += [struct.pack("<4f", *place), _packed(pieces)]
    return b"".join(encoded)


def _packed(pieces: list[Piece]) -> bytes:
    count = sum(len(piece.corner) for piece in pieces)
    mesh = np.zeros(count, np.dtype([("at", "<f4", 3), ("colour", "u1", 4)]))
    start = 0
    for piece in pieces:
        mesh["at"][start : start + len(piece.corner)] = piece.corner
        mesh["colour"][start : start + len(piece.corner)] = piece.colour
        start += len(piece.corner)
    return struct.pack("<I", count) + mesh.tobytes()
