"""Triangles of all objects, as AirSim gives meshes: vehicles, the ground's planes and height fields are left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from sim.frame.meshes import mesh_triangles
from sim.scene.maps.meshes import Mesh, box_with_tiles, revolve
from sim.scene.placed.geoms import posed
from sim.scene.world import World

_G = mujoco.mjtGeom
_SIDES, _RINGS = 24, 12


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
    kind, (a, b, c) = int(model.geom_type[geom]), model.geom_size[geom].tolist()
    mesh: Mesh
    if kind == int(_G.mjGEOM_MESH):
        found = mesh_triangles(model, int(model.geom_dataid[geom]))
        return found.vertex.astype(np.float64), found.triangle
    if kind == int(_G.mjGEOM_BOX):
        mesh = box_with_tiles((a, b, c), (1.0, 1.0))
    elif kind == int(_G.mjGEOM_CYLINDER):
        mesh = revolve([(a, -b), (a, b)], _SIDES)
    elif kind in (int(_G.mjGEOM_SPHERE), int(_G.mjGEOM_ELLIPSOID), int(_G.mjGEOM_CAPSULE)):
        radii = (a, b, c) if kind == int(_G.mjGEOM_ELLIPSOID) else (a, a, a)
        angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _RINGS + 2)[1:-1]
        mesh = revolve([(float(np.cos(angle)), float(np.sin(angle))) for angle in angles], _SIDES)
        vertex = np.array(mesh.vertices) * radii
        if kind == int(_G.mjGEOM_CAPSULE):
            vertex[:, 2] += np.where(vertex[:, 2] > 0.0, b, -b)
        return vertex, np.array(mesh.triangles, np.int32)
    else:
        return np.empty((0, 3)), np.empty((0, 3), np.int32)
    return np.array(mesh.vertices), np.array(mesh.triangles, np.int32)
