"""Mesh of a scene for 3-D views: a limited number of coloured triangles, with coarse curves."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

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
Place = tuple[float, float, float, float]  # x, y, z [m, W] and yaw [rad]


class Piece(NamedTuple):
    """Triangles of one colour."""

    size_m: float  # greatest extent
    corner: NDArray[np.float32]  # (3 n, 3) [m]
    colour: NDArray[np.uint8]  # red, green, blue, 255


class SceneMesh(NamedTuple):
    """Triangles of a scene. `still` is in W; a moving mesh in the frame of its place, here that at the start."""

    still: list[Piece]  # the largest first
    moving: list[tuple[Place, list[Piece]]]  # people and vehicles, in the order of `Actors`


class Actors:
    """Positions and yaw of a scene's people and vehicles. The 3-D view shows each as a rigid body."""

    def __init__(self, world: Any) -> None:
        """`world`: sim.scene.world.World."""
        self._actors = world.map.actors
        self._arrays = [tuple(np.zeros((len(actor.bodies), width)) for width in (3, 4, 3, 3)) for actor in self._actors]

    def places(self, t_ns: int) -> list[Place]:
        """Return x, y, z [m, W] and yaw [rad] of each."""
        places = []
        for actor, arrays in zip(self._actors, self._arrays, strict=True):
            actor.pose(t_ns, *arrays)
            x, y, z = arrays[0][0].tolist()
            yaw = yaw_of(arrays[1][0].tolist())
            places.append((round(x, 3), round(y, 3), round(z, 3), round(yaw, 4)))
        return places


def into_frame(corners: NDArray[np.float32], place: Place) -> NDArray[np.float32]:
    """Transform points from W to the frame at `place`: x, y, z [m, W] and yaw [rad]."""
    x, y, z, yaw = place
    moved = corners - np.array((x, y, z), np.float32)
    cos, sin = math.cos(yaw), math.sin(yaw)
    rotation = np.array(((cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)), np.float32)
    return np.asarray(moved @ rotation.T, np.float32)


def scene_mesh(world: Any) -> SceneMesh:
    """Return the triangles of a scene. `world`: sim.scene.world.World."""
    model = world.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    places = Actors(world).places(0)
    pieces: list[Piece] = []
    moving: list[list[Piece]] = [[] for _ in places]
    for geom in np.flatnonzero(world.geom_visible).tolist():
        corners = _corners(model, geom)
        if not len(corners):
            continue
        placed: NDArray[np.float64] = corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        size = float(np.ptp(placed, axis=0).max())
        piece = Piece(size, placed.astype(np.float32), _colour(model, geom))
        (pieces if world.geom_actor[geom] < 0 else moving[world.geom_actor[geom]]).append(piece)
    pieces.sort(key=lambda piece: -piece.size_m)
    kept, triangles = [], 0
    for piece in pieces:
        triangles += len(piece.corner) // 3
        if triangles > _MAX_TRIANGLES:
            break
        kept.append(piece)
    in_own_frame = [
        (place, [piece._replace(corner=into_frame(piece.corner, place)) for piece in actor_pieces])
        for place, actor_pieces in zip(places, moving, strict=True)
    ]
    return SceneMesh(kept, in_own_frame)


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
