"""A scene as signals from satellites meet it: its static solids, its foliage, and its large faces.

    solid    blocks: all static, visible geoms but foliage, terrain too
    foliage  attenuates: geoms of the classes tree, hedge, bush and vegetation, trunks included, which are thinner than
             the first Fresnel zone, and whatever has the surface of leaves
    moving   is passed: people, road vehicles and other drones neither block nor reflect

A face reflects if it is plane, of a static solid, at least `smallest_face_m2` large, and steeper than 60 degrees. Faces
that look up (ground, roofs) are left out: the errors by the ground below an antenna belong to a preset's figures in the
open. Triangles of a mesh in one plane are one face; the sides of boxes are faces.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.rotation import applied_to_rows, cross, dot
from sim.frame.geometry import FrameGeometry
from sim.frame.meshes import height_field_triangles, mesh_triangles
from sim.scene.surfaces import LEAVES
from sim.scene.world import World

Float64 = NDArray[np.float64]

FOLIAGE_CLASSES = ("tree", "vegetation", "hedge", "bush", "potted_plant")
_PLANE, _HFIELD, _BOX, _MESH = (
    int(kind)
    for kind in (
        mujoco.mjtGeom.mjGEOM_PLANE,
        mujoco.mjtGeom.mjGEOM_HFIELD,
        mujoco.mjtGeom.mjGEOM_BOX,
        mujoco.mjtGeom.mjGEOM_MESH,
    )
)
_STEEPEST_RISE = 0.5  # |n_z| of a face at 60 degrees
_CONDUCTS_S_PER_M = 1e4  # above: a metal
_SAME_NORMAL, _SAME_PLANE_M = 2e-3, 0.02  # grid on which triangles of one plane meet


class Surroundings:
    """The static part of a world as signals from satellites meet it."""

    @classmethod
    def of(cls, geometry: FrameGeometry, *, smallest_face_m2: float) -> Surroundings:
        """Return those of a geometry, which all receivers in it share."""
        key = (cls, smallest_face_m2)
        if key not in geometry.prepared:
            geometry.prepared[key] = cls(geometry, smallest_face_m2=smallest_face_m2)
        shared: Surroundings = geometry.prepared[key]
        return shared

    def __init__(self, geometry: FrameGeometry, *, smallest_face_m2: float) -> None:
        self.caster = geometry.caster
        world = geometry.world
        model, surfaces = world.model, world.surfaces
        leaves = [number for number, surface in enumerate(surfaces) if surface == LEAVES]
        classes = [number for number, name in enumerate(world.class_names) if name in FOLIAGE_CLASSES]
        self.geom_foliage: NDArray[np.bool_] = np.isin(world.geom_class, classes) | np.isin(world.geom_surface, leaves)
        self.geom_moving: NDArray[np.bool_] = world.geom_actor >= 0
        self.geom_instance = world.geom_instance
        permittivity = np.array([max(surface.relative_permittivity, 1.0) for surface in surfaces])
        conducts = np.array([surface.conductivity_s_per_m > _CONDUCTS_S_PER_M for surface in surfaces])
        self.permittivity: Float64 = permittivity[world.geom_surface]
        self.conducts: NDArray[np.bool_] = conducts[world.geom_surface]
        fixed = world.geom_visible & ~self.geom_moving
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self.boxes = _boxes(model, data, np.flatnonzero(fixed & (model.geom_type != _PLANE)))
        solid = np.flatnonzero(fixed & ~self.geom_foliage)
        self.faces = _faces(world, data, solid, smallest_face_m2)


def _boxes(model: Any, data: Any, geoms: NDArray[np.int64]) -> Float64:
    """Return the boxes of geoms in W, (n, 6): low x y z, high x y z."""
    centre, half = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    R = data.geom_xmat[geoms].reshape(-1, 3, 3)
    middle = data.geom_xpos[geoms] + applied_to_rows(R, centre)
    reach = applied_to_rows(np.abs(R), half)
    return np.ascontiguousarray(np.concatenate([middle - reach, middle + reach], axis=1))


def _faces(world: World, data: Any, geoms: NDArray[np.int64], smallest_m2: float) -> Float64:
    """Return the large steep faces, (n, 7): centre, normal, radius."""
    model = world.model
    rows: list[tuple[float, ...]] = []
    of_mesh: dict[tuple[int, int], Float64] = {}
    for geom in geoms.tolist():
        kind = int(model.geom_type[geom])
        R, p = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
        if kind == _BOX:
            rows += _box_faces(R, p, model.geom_size[geom], smallest_m2)
        elif kind in (_MESH, _HFIELD):
            source = (kind, int(model.geom_dataid[geom]))
            if source not in of_mesh:
                make = height_field_triangles if kind == _HFIELD else mesh_triangles
                mesh = make(model, source[1])
                of_mesh[source] = mesh.vertex.astype(np.float64)[mesh.triangle]
            rows += _mesh_faces(R, p, of_mesh[source], smallest_m2)
    return np.array(rows, np.float64).reshape(-1, 7)


def _box_faces(R: Float64, p: Float64, half: Float64, smallest_m2: float) -> list[tuple[float, ...]]:
    rows: list[tuple[float, ...]] = []
    for axis in range(3):
        a, b = (float(half[k]) for k in range(3) if k != axis)
        normal = R[:, axis]
        if 4.0 * a * b < smallest_m2 or abs(normal[2]) > _STEEPEST_RISE:
            continue
        radius = float(np.sqrt(a * a + b * b))
        for side in (1.0, -1.0):
            centre = p + side * float(half[axis]) * normal
            rows.append((*centre.tolist(), *(side * normal).tolist(), radius))
    return rows


def _mesh_faces(R: Float64, p: Float64, corners: Float64, smallest_m2: float) -> list[tuple[float, ...]]:
    """Return the faces of a mesh; `corners` (m, 3, 3) in its own frame."""
    if len(corners) == 0:
        return []
    v = p + corners[:, :, :1] * R[:, 0] + corners[:, :, 1:2] * R[:, 1] + corners[:, :, 2:] * R[:, 2]
    a, b = v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]
    across = np.stack(cross(a.T, b.T), axis=1)
    twice = np.sqrt(dot(across.T, across.T))
    known = twice > 1e-9
    v, twice, normal = v[known], twice[known], across[known] / twice[known, None]
    steep = np.abs(normal[:, 2]) <= _STEEPEST_RISE
    v, twice, normal = v[steep], twice[steep], normal[steep]
    if len(v) == 0:
        return []
    # Both sides of a wall that is a single sheet are one plane: the sign of the normal is not part of it.
    sign = np.where(np.abs(normal[:, 0]) > 1e-6, np.sign(normal[:, 0]), np.where(normal[:, 1] < 0.0, -1.0, 1.0))
    normal = normal * sign[:, None]
    offset = dot(normal.T, v[:, 0].T)
    key = np.concatenate([np.round(normal / _SAME_NORMAL), np.round(offset / _SAME_PLANE_M)[:, None]], axis=1)
    _, plane = np.unique(key.astype(np.int64), axis=0, return_inverse=True)
    order = np.argsort(plane, kind="stable")
    edges = np.flatnonzero(np.diff(plane[order], prepend=-1))
    rows: list[tuple[float, ...]] = []
    for begin, end in zip(edges.tolist(), [*edges[1:].tolist(), len(order)], strict=True):
        part = order[begin:end]
        if 0.5 * math.fsum(twice[part].tolist()) < smallest_m2:
            continue
        points = v[part].reshape(-1, 3)
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        n = normal[part[0]]
        # Onto the plane, from which the middle of a box of tilted points is off by rounding only.
        centre = centre + dot(points[0] - centre, n) * n
        away = (points - centre).T
        rows.append((*centre.tolist(), *n.tolist(), float(np.sqrt(dot(away, away).max()))))
    return rows
