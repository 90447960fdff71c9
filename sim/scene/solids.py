"""Poses of a world's solid geoms: static ones in W, moving ones in the frame of their mocap body.

Poses are composed along the chain of bodies, with joints at their reference:

    R = R_parent R_own,   p = p_parent + R_parent p_own

and rounded to 1e-12, because the last bit of an angle's sine depends on the machine that compiles the map, and must not
influence a flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.rotation import applied_to_rows, matrix_of, product
from sim._kernels import SolidTree
from sim.scene.world import World

Float64 = NDArray[np.float64]
_DIGITS = 12
_G = mujoco.mjtGeom
_PRIMITIVES = frozenset(
    int(k)
    for k in (
        _G.mjGEOM_PLANE,
        _G.mjGEOM_SPHERE,
        _G.mjGEOM_CAPSULE,
        _G.mjGEOM_ELLIPSOID,
        _G.mjGEOM_CYLINDER,
        _G.mjGEOM_BOX,
    )
)
_MAX_HFIELD_TILES = 32  # boxes along each side of a height field


@dataclass(frozen=True)
class PlacedGeoms:
    """Geoms of `World.model` with their frames: W, or an actor's mocap body."""

    geom: NDArray[np.int64]
    body: NDArray[np.int64]  # the mocap body that each belongs to; 0: static in W
    position: Float64  # (n, 3)
    quaternion: Float64  # (n, 4)


def _matrices(q: Float64) -> Float64:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4)."""
    return np.stack(matrix_of(q.T), -1).reshape(-1, 3, 3)


def _unit(q: Float64) -> Float64:
    return q / np.sqrt(((q[:, :1] ** 2 + q[:, 1:2] ** 2) + q[:, 2:3] ** 2) + q[:, 3:] ** 2)


def place(world: World, geoms: NDArray[np.int64]) -> PlacedGeoms:
    """Return the poses of these geoms."""
    model = world.model
    moving = {name for actor in world.map.actors for name in actor.bodies}
    root = np.zeros(model.nbody, np.int64)
    position, quaternion = np.zeros((model.nbody, 3)), np.zeros((model.nbody, 4))
    quaternion[:, 0] = 1.0
    is_moving = [bool(moving) and model.body(body).name in moving for body in range(model.nbody)]
    parent = model.body_parentid.tolist()
    position[1:], quaternion[1:] = model.body_pos[1:], model.body_quat[1:]  # children of the world
    for body in range(1, model.nbody):
        p = parent[body]
        if is_moving[body]:
            root[body] = body
            position[body], quaternion[body] = 0.0, (1.0, 0.0, 0.0, 0.0)
            continue
        if p == 0:
            continue
        root[body] = root[p]
        position[body] = position[p] + applied_to_rows(_matrices(quaternion[p : p + 1])[0], model.body_pos[body])
        quaternion[body] = product(quaternion[p].tolist(), model.body_quat[body].tolist())
    body = model.geom_bodyid[geoms].astype(np.int64)
    geom_position = position[body] + applied_to_rows(_matrices(quaternion[body]), model.geom_pos[geoms])
    geom_quaternion = _unit(np.stack(product(quaternion[body].T, model.geom_quat[geoms].T), -1))
    return PlacedGeoms(geoms, root[body], np.round(geom_position, _DIGITS), np.round(geom_quaternion, _DIGITS))


def solid_geoms(world: World) -> PlacedGeoms:
    """Return the poses of all solid geoms of the world."""
    return place(world, np.flatnonzero(world.geom_solid))


def solid_tree(world: World) -> SolidTree:
    """Return the tree of static solid geoms, for `RigidBody.clearance_before`."""
    model, solids = world.model, solid_geoms(world)
    static = solids.body == 0
    geoms, position, R = solids.geom[static], solids.position[static], _matrices(_unit(solids.quaternion[static]))
    kinds = model.geom_type[geoms].astype(np.int32)
    is_primitive = np.isin(kinds, list(_PRIMITIVES))
    kind, center = [kinds[is_primitive]], [position[is_primitive]]
    frame, size = [R[is_primitive].reshape(-1, 9)], [model.geom_size[geoms[is_primitive]]]
    for index in np.flatnonzero(~is_primitive).tolist():
        geom = int(geoms[index])
        boxes = _hfield_boxes(model, geom) if kinds[index] == int(_G.mjGEOM_HFIELD) else model.geom_aabb[geom][None]
        middle = np.array([R[index] @ box[:3] for box in boxes]) + position[index]
        kind.append(np.full(len(boxes), int(_G.mjGEOM_BOX), np.int32))
        center.append(middle)
        frame.append(np.tile(R[index].reshape(1, 9), (len(boxes), 1)))
        # The model stores vertices as 32-bit floats, and their bounds as sums of these.
        size.append(boxes[:, 3:] * (1.0 + 1e-6) + 1e-6)
    pose = np.concatenate([np.concatenate(center), np.concatenate(frame)], axis=1)
    return SolidTree(
        kind=np.ascontiguousarray(np.concatenate(kind)),
        pose=np.ascontiguousarray(pose, dtype=np.float64),
        size=np.ascontiguousarray(np.concatenate(size), dtype=np.float64),
    )


def _hfield_boxes(model: mujoco.MjModel, geom: int) -> Float64:
    """Return boxes (centre, half edges) in the geom's frame that enclose a height field, tile by tile."""
    field = int(model.geom_dataid[geom])
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    half_x, half_y, height, base = model.hfield_size[field].tolist()
    start = int(model.hfield_adr[field])
    data = model.hfield_data[start : start + rows * columns].reshape(rows, columns) * height
    boxes = []
    for r0, r1 in pairwise(_tile_edges(rows)):
        for c0, c1 in pairwise(_tile_edges(columns)):
            top = float(data[r0 : r1 + 1, c0 : c1 + 1].max())
            x0, x1 = (2.0 * c / (columns - 1) - 1.0 for c in (c0, c1))
            y0, y1 = (2.0 * r / (rows - 1) - 1.0 for r in (r0, r1))
            boxes.append(
                [
                    0.5 * (x0 + x1) * half_x, 0.5 * (y0 + y1) * half_y, 0.5 * (top - base),
                    0.5 * (x1 - x0) * half_x, 0.5 * (y1 - y0) * half_y, 0.5 * (top + base),
                ]
            )  # fmt: skip
    return np.array(boxes)


def _tile_edges(count: int) -> list[int]:
    tiles = min(_MAX_HFIELD_TILES, count - 1)
    return [round(i * (count - 1) / tiles) for i in range(tiles + 1)]
