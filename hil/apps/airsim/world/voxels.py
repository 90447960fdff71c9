"""Triangles, extents and voxels of the scene with its objects, in AirSim's axes; vehicles are left out.

A cell of the voxel grid is occupied where one of the three lines through its middle, along the axes, meets a surface or
is inside an object: between the first and the second hit of the same geom, the third and the fourth, and so on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from sim.frame.geometry import FrameGeometry
from sim.frame.meshes import mesh_triangles
from sim.frame.source import VEHICLE_CLASS, SharedFrames
from sim.scene.maps.meshes import Mesh, box_with_tiles, revolve
from sim.scene.placed.geoms import pose_geoms
from sim.scene.world import World

_G = mujoco.mjtGeom
_SIDES, _RINGS = 24, 12
_STEP_M = 1e-4  # past a hit
_MOST_HITS = 200  # along one line


class Solid(NamedTuple):
    """Triangles of one geom in W."""

    name: str  # of its object
    p_W: Vec3
    R_WG: NDArray[np.float64]
    vertices_W: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)


def solids(world: World, t_ns: int) -> list[Solid]:
    """Return the visible geoms with an end, without the ground's planes and height fields."""
    model, data = _posed(world, t_ns)
    found = []
    for geom in np.flatnonzero(world.geom_visible).tolist():
        vertex, triangle = _triangles(model, geom)
        if len(triangle) == 0:
            continue
        p, R = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        name = world.instance_names[world.geom_instance[geom]]
        x, y, z = p.tolist()
        found.append(Solid(name, (x, y, z), R.copy(), vertex @ R.T + p, triangle))
    return found


def extents_W(world: World, t_ns: int) -> tuple[Vec3, Vec3]:
    """Return the corners of the box around all visible geoms with an end; two equal points if there are none."""
    model, data = _posed(world, t_ns)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for geom in np.flatnonzero(world.geom_visible & (model.geom_type != int(_G.mjGEOM_PLANE))).tolist():
        R, box = data.geom_xmat[geom].reshape(3, 3), model.geom_aabb[geom]
        middle, half = data.geom_xpos[geom] + R @ box[:3], np.abs(R) @ box[3:]
        if np.abs(middle).max() < 1e6:  # objects that were taken away are outside the world
            low, high = np.minimum(low, middle - half), np.maximum(high, middle + half)
    if not np.all(np.isfinite(low)):
        low = high = np.zeros(3)
    (a, b, c), (d, e, f) = low.tolist(), high.tolist()
    return (a, b, c), (d, e, f)


def is_clear(frames: SharedFrames, start_W: Vec3, end_W: Vec3) -> bool:
    """Return True if nothing that `frames` shows is between two points, at its present time."""
    way = np.subtract(end_W, start_W)
    length_m = float(np.linalg.norm(way))
    if length_m < 1e-6:
        return True
    geometry = frames.geometry
    geometry.pose_within()
    range_m, _ = _cast(geometry, np.array([start_W]), way[None] / length_m, np.array([length_m]))
    return bool(range_m[0] >= length_m - 1e-6)


def occupied(frames: SharedFrames, middle_W: Vec3, counts: tuple[int, int, int], edge_m: float) -> NDArray[np.bool_]:
    """Return the cells (east, north, up) about `middle_W` that are occupied; their middles are multiples of the edge.

    Cell i of n along an axis has its middle at (i - n // 2) edges from `middle_W`, as in AirSim.
    """
    geometry = frames.geometry
    geometry.pose_within()
    world = frames.world
    is_vehicle = world.geom_class == world.class_names.index(VEHICLE_CLASS)
    cells = np.zeros(counts, bool)
    middles = [middle_W[a] + edge_m * (np.arange(n) - n // 2) for a, n in enumerate(counts)]
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        grid = np.stack(np.meshgrid(middles[a], middles[b], indexing="ij"), axis=-1).reshape(-1, 2)
        begin = middles[axis][0] - 0.5 * edge_m
        length_m = counts[axis] * edge_m
        origins = np.empty((len(grid), 3))
        origins[:, a], origins[:, b], origins[:, axis] = grid[:, 0], grid[:, 1], begin
        lines = np.moveaxis(cells, axis, 2).reshape(len(grid), counts[axis])  # a copy
        for row, geom, near, far in _spans(geometry, origins, axis, length_m):
            if is_vehicle[geom]:
                continue
            first = min(max(int(near / edge_m), 0), counts[axis] - 1)
            last = min(max(int(far / edge_m), 0), counts[axis] - 1)
            lines[row, first : last + 1] = True
        shape = (counts[a], counts[b], counts[axis])
        cells |= np.moveaxis(lines.reshape(shape), 2, axis)
    return cells


def binvox(cells: NDArray[np.bool_], size_m: Vec3) -> bytes:
    """Return a voxel grid (north, east, up) as a binvox file, with the header and the order of cells of AirSim."""
    x, y, z = cells.shape
    header = (
        f"#binvox 1\ndim {x} {z} {y}\n"
        f"translate {-0.5 * size_m[0]:g} {-0.5 * size_m[1]:g} {-0.5 * size_m[2]:g}\n"
        f"scale {1.0 / size_m[0]:g}\ndata\n"
    )
    # Cell (i, j, k) is number i + x (k + z j).
    values = cells.transpose(1, 2, 0).ravel().astype(np.uint8)
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    lengths = np.diff(np.concatenate([starts, [len(values)]]))
    runs = bytearray()
    for value, length in zip(values[starts].tolist(), lengths.tolist(), strict=True):
        full, rest = divmod(length, 255)
        runs += bytes((value, 255)) * full
        if rest:
            runs += bytes((value, rest))
    return header.encode() + bytes(runs)


def _spans(
    geometry: FrameGeometry, origins: NDArray, axis: int, length_m: float
) -> list[tuple[int, int, float, float]]:
    """Return (line, geom, from, to) [m] of what each line along an axis meets; a single hit spans nothing."""
    direction = np.zeros(3)
    direction[axis] = 1.0
    rows, travelled = np.arange(len(origins)), np.zeros(len(origins))
    entered: dict[tuple[int, int], float] = {}
    spans: list[tuple[int, int, float, float]] = []
    for _ in range(_MOST_HITS):
        if len(rows) == 0:
            break
        starts = origins[rows] + travelled[:, None] * direction
        range_m, geoms = _cast(geometry, starts, np.tile(direction, (len(rows), 1)), length_m - travelled)
        hit = range_m <= length_m - travelled
        rows, at, geoms = rows[hit], (travelled + range_m)[hit], geoms[hit]
        for row, geom, where in zip(rows.tolist(), geoms.tolist(), at.tolist(), strict=True):
            begin = entered.pop((row, geom), None)
            if begin is None:
                entered[row, geom] = where
            else:
                spans.append((row, geom, begin, where))
        travelled = at + _STEP_M
        kept = travelled < length_m
        rows, travelled = rows[kept], travelled[kept]
    return spans + [(row, geom, where, where) for (row, geom), where in entered.items()]


def _cast(
    geometry: FrameGeometry, origins_W: NDArray, directions_W: NDArray, most_m: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    n = len(origins_W)
    range_m, geom = np.empty(n), np.empty(n, np.int32)
    geometry.caster.cast(
        np.ascontiguousarray(origins_W, np.float64),
        np.ascontiguousarray(directions_W, np.float64),
        0.0,
        float(most_m.max()),
        range_m,
        geom,
    )
    return range_m, geom


def _posed(world: World, t_ns: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    data = mujoco.MjData(world.model)
    mujoco.mj_kinematics(world.model, data)
    for actor in world.map.actors:
        pose_geoms(world.model, data, actor, t_ns)
    return world.model, data


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


def mesh_buffers(found: list[Solid], from_W: Any) -> list[dict[str, Any]]:
    """Return AirSim's structs of meshes: Unreal's axes (north, east, up), in cm from the origin of `from_W`."""
    buffers = []
    for solid in found:
        x, y, z = from_W(solid.p_W)
        offset = np.array(from_W((0.0, 0.0, 0.0)))
        vertices = 100.0 * (solid.vertices_W[:, [1, 0, 2]] + offset * (1.0, 1.0, -1.0))
        buffers.append(
            {
                "position": {"x_val": 100.0 * x, "y_val": 100.0 * y, "z_val": -100.0 * z},
                "orientation": {"w_val": 1.0, "x_val": 0.0, "y_val": 0.0, "z_val": 0.0},
                "vertices": vertices.astype(np.float32).ravel(),
                "indices": solid.triangles.astype(np.uint32).ravel(),
                "name": solid.name,
            }
        )
    return buffers
