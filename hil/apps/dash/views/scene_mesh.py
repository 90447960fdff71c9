"""Mesh of a scene for the page's 3-D view: a limited number of coloured triangles, with coarse curves."""

from __future__ import annotations

import math
import struct
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.rotation import yaw_of
from sim.frame.meshes import height_field_triangles, mesh_triangles
from sim.frame.scenery import rgb_texture, texels_of
from sim.frame.tessellation import primitive

_MAX_TRIANGLES = 250_000  # beyond this the smallest objects are left out
_GROUND_M = 600.0  # half an edge of an infinite plane
_SEGMENTS = 12  # of a circle
_GEOM = mujoco.mjtGeom
_Piece = tuple[float, NDArray[np.float32], NDArray[np.uint8]]  # size [m], corners, colour


class Actors:
    """Positions and yaw of a scene's people and vehicles. The 3-D view shows each as a rigid body."""

    def __init__(self, world: Any) -> None:
        """`world`: sim.scene.world.World."""
        self._actors = world.map.actors
        self._arrays = [tuple(np.zeros((len(actor.bodies), width)) for width in (3, 4, 3, 3)) for actor in self._actors]

    def places(self, t_ns: int) -> list[tuple[float, float, float, float]]:
        """Return x, y, z [m, W] and yaw [rad] of each."""
        places = []
        for actor, arrays in zip(self._actors, self._arrays, strict=True):
            actor.pose(t_ns, *arrays)
            x, y, z = arrays[0][0].tolist()
            yaw = yaw_of(arrays[1][0].tolist())
            places.append((round(x, 3), round(y, 3), round(z, 3), round(yaw, 4)))
        return places


def into_frame(corners: NDArray[np.float32], place: tuple[float, float, float, float]) -> NDArray[np.float32]:
    """Transform points from W to the frame at `place`: x, y, z [m, W] and yaw [rad]."""
    x, y, z, yaw = place
    moved = corners - np.array((x, y, z), np.float32)
    cos, sin = math.cos(yaw), math.sin(yaw)
    rotation = np.array(((cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)), np.float32)
    return np.asarray(moved @ rotation.T, np.float32)


def scene_triangles(world: Any) -> bytes:
    """Encode a scene: the mesh of everything static, uint32 number of people and vehicles, then a moving mesh for each.

    A mesh is a uint32 count, then per corner three float32 [m] and four uint8 (red, green, blue, 255). The static mesh
    is in W. Before a moving mesh comes its place at the start, four float32: x, y, z [m] and yaw [rad]. The mesh is in
    the frame of that place.
    `world`: sim.scene.world.World.
    """
    model = world.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    places = Actors(world).places(0)
    pieces: list[_Piece] = []
    moving: list[list[_Piece]] = [[] for _ in places]
    for geom in np.flatnonzero(world.geom_visible).tolist():
        corners = _corners(model, geom)
        if not len(corners):
            continue
        placed: NDArray[np.float64] = corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        size = float(np.ptp(placed, axis=0).max())
        piece = (size, placed.astype(np.float32), _colour(model, geom))
        (pieces if world.geom_actor[geom] < 0 else moving[world.geom_actor[geom]]).append(piece)
    pieces.sort(key=lambda piece: -piece[0])
    kept, triangles = [], 0
    for piece in pieces:
        triangles += len(piece[1]) // 3
        if triangles > _MAX_TRIANGLES:
            break
        kept.append(piece)
    encoded = [_packed(kept), struct.pack("<I", len(moving))]
    for place, actor_pieces in zip(places, moving, strict=True):
        in_own_frame = [(size, into_frame(corners, place), colour) for size, corners, colour in actor_pieces]
        encoded += [struct.pack("<4f", *place), _packed(in_own_frame)]
    return b"".join(encoded)


def _packed(pieces: list[_Piece]) -> bytes:
    count = sum(len(corners) for _, corners, _ in pieces)
    mesh = np.zeros(count, np.dtype([("at", "<f4", 3), ("colour", "u1", 4)]))
    start = 0
    for _, corners, colour in pieces:
        mesh["at"][start : start + len(corners)] = corners
        mesh["colour"][start : start + len(corners)] = colour
        start += len(corners)
    return struct.pack("<I", count) + mesh.tobytes()


def _corners(model: Any, geom: int) -> NDArray[np.float64]:
    """Return the corners of a geom in its frame, three rows per triangle."""
    kind = int(model.geom_type[geom])
    if kind in (_GEOM.mjGEOM_MESH, _GEOM.mjGEOM_HFIELD):
        make = mesh_triangles if kind == _GEOM.mjGEOM_MESH else height_field_triangles
        mesh = make(model, int(model.geom_dataid[geom]))
        return mesh.vertex[mesh.triangle.ravel()].astype(np.float64)
    size = tuple(model.geom_size[geom].tolist())
    return primitive(kind, size, segments=_SEGMENTS, infinite_m=_GROUND_M).corner.reshape(-1, 3)


def _colour(model: Any, geom: int) -> NDArray[np.uint8]:
    """Return the colour of a geom: of its material times the mean of the texture, or else the geom's own."""
    material = int(model.geom_matid[geom])
    rgb = np.array(model.geom_rgba[geom][:3], np.float64)
    if material >= 0:
        rgb = np.array(model.mat_rgba[material][:3], np.float64)
        texture = rgb_texture(model, material)
        if texture >= 0:
            texels = texels_of(model, texture).reshape(-1, 3)
            rgb *= texels[:: max(1, len(texels) // 4096)].mean(axis=0) / 255.0
    return np.array([*(np.clip(rgb, 0.0, 1.0) * 255.0), 255], np.uint8)
