"""Triangles of all objects, as AirSim gives meshes: vehicles, the ground's planes and height fields are left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from sim.frame.meshes import mesh_triangles
from sim.frame.tessellation import primitive
from sim.scene.compile.actor_geoms import posed
from sim.scene.world import World

_G = mujoco.mjtGeom
_SEGMENTS = 24  # of a circle


def mesh_buffers(world: World, t_ns: int, ned: Callable[[Vec3], Vec3]) -> list[dict[str, Any]]:
    """Return AirSim's structs of meshes: Unreal's axes (north, east, up), in cm from the origin of `ned`.

    `ned`: north, east and down of a point of W.
    """
    model, data = posed(world, t_ns)
    offset = np.array(ned((0.0, 0.0, 0.0))) * (1.0, 1.0, -1.0)
    buffers = []
    for geom in np.flatnonzero(world.geom_visible).tolist():
        vertices_G, triangles = _triangles(model, geom)
        if len(triangles) == 0:
            continue
        p_WG, R_WG = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        vertices_W = vertices_G @ R_WG.T + p_WG
        x, y, z = ned(tuple(p_WG.tolist()))
        buffers.append(
            {
                "position": {"x_val": 100.0 * x, "y_val": 100.0 * y, "z_val": -100.0 * z},
                "orientation": {"w_val": 1.0, "x_val": 0.0, "y_val": 0.0, "z_val": 0.0},
                "vertices": (100.0 * (vertices_W[:, [1, 0, 2]] + offset)).astype(np.float32).ravel(),
                "indices": triangles.astype(np.uint32).ravel(),
                "name": world.instance_names[world.geom_instance[geom]],
            }
        )
    return buffers


def _triangles(model: mujoco.MjModel, geom: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices and triangles of a geom in its own frame; none for planes and height fields."""
    kind = int(model.geom_type[geom])
    if kind == _G.mjGEOM_MESH:
        mesh = mesh_triangles(model, int(model.geom_dataid[geom]))
        return mesh.vertex.astype(np.float64), mesh.triangle
    if kind == _G.mjGEOM_PLANE:
        return np.empty((0, 3)), np.empty((0, 3), np.int32)
    vertices = primitive(kind, tuple(model.geom_size[geom].tolist()), segments=_SEGMENTS).corner.reshape(-1, 3)
    return vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
