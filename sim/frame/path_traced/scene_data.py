"""A world as the path tracer needs it: triangles of static and moving geoms, materials, textures and the sun.

All arrays are plain numpy, so that they can be sent to the child process. Positions are relative to `origin_W`, near
the middle of the scene, because the tracer computes in single precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.frame.meshes import Triangles, height_field_triangles, mesh_triangles
from sim.frame.mujoco_backend import WorldPose
from sim.frame.path_traced.looks import Looks, corner_uv, make_looks
from sim.frame.tessellation import Facets, flat_normals, primitive
from sim.scene.world import World

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

_SHAPES = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")): name for name in
           ("PLANE", "HFIELD", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")}  # fmt: skip
_FLAT = ("HFIELD", "MESH")
_LEAST_SMOOTH = 0.76  # cosine between the normals of a corner and of its triangle


class TriangleSoup(NamedTuple):
    """Triangles without shared vertices."""

    corner: Float32  # (n, 3, 3) [m], of static geoms in W - origin_W, of moving ones in their geom's frame
    normal: Float32  # (n, 3, 3) unit
    uv: Float32  # (n, 3, 2)
    geom: NDArray[np.int32]  # (n,)


@dataclass(frozen=True)
class SceneData:
    """Everything that does not change from picture to picture."""

    static: TriangleSoup
    moving: TriangleSoup
    looks: Looks
    origin_W: Float64

    def message(self) -> dict[str, Any]:
        """Return plain arrays for the child process."""
        return {
            "static": tuple(self.static),
            "moving": tuple(self.moving),
            "material": self.looks.material,
            "plain_material": self.looks.plain(),
            "textures": self.looks.textures,
        }


class MovingGeoms:
    """Poses of the geoms that belong to actors, at a time."""

    def __init__(self, world: World, origin_W: Float64) -> None:
        self._posed = WorldPose(world)
        self._geoms = np.flatnonzero((world.geom_actor >= 0) & world.geom_visible)
        self._origin_W = origin_W

    def at(self, t_ns: int, left_out: int) -> tuple[NDArray[np.int32], Float32, Float32]:
        """Return the geoms (n,), their positions (n, 3) relative to the origin, and rotations (n, 3, 3)."""
        data = self._posed.at(t_ns, left_out)
        p = data.geom_xpos[self._geoms] - self._origin_W
        R = data.geom_xmat[self._geoms].reshape(-1, 3, 3)
        # A geom far outside, or whose pose is not finite, is not shown: it becomes a point below the ground.
        shown = (
            np.isfinite(p).all(axis=1) & np.isfinite(R).all(axis=(1, 2)) & (np.abs(p).max(axis=1, initial=0.0) < 1e6)
        )
        p = np.where(shown[:, None], p, [0.0, 0.0, -1e4])
        R = np.where(shown[:, None, None], R, 0.0)
        return self._geoms.astype(np.int32), p.astype(np.float32), R.astype(np.float32)


def make_scene_data(world: World) -> SceneData:
    """Return the triangles and materials of a world's visible geoms."""
    model = world.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    looks = make_looks(world)
    shown = np.flatnonzero(world.geom_visible)
    origin_W = _middle(data.geom_xpos[shown]) if len(shown) else np.zeros(3)
    meshes: dict[tuple[str, int], Triangles] = {}
    static: list[TriangleSoup] = []
    moving: list[TriangleSoup] = []
    for geom in shown.tolist():
        name = _SHAPES.get(int(model.geom_type[geom]))
        if name is None:
            continue
        facets, mesh_uv, edge_m = _facets(model, geom, name, meshes)
        if not len(facets.corner):
            continue
        texture, relief = (int(looks.material[geom, column]) for column in (3, 10))
        uv = np.zeros((*facets.corner.shape[:2], 2))
        if max(texture, relief) >= 0:
            uv = corner_uv(
                facets.corner,
                edge_m,
                looks.repeat[geom],
                per_metre=bool(looks.per_metre[geom]),
                cube=texture >= 0 and looks.is_cube[texture],
                mesh_uv=mesh_uv,
            )
        corner, normal = facets
        number = np.full(len(corner), geom, np.int32)
        if world.geom_actor[geom] >= 0:
            moving.append(_soup(corner, normal, uv, number))
        else:
            R_WG = data.geom_xmat[geom].reshape(3, 3)
            placed = corner @ R_WG.T + (data.geom_xpos[geom] - origin_W)
            static.append(_soup(placed, normal @ R_WG.T, uv, number))
    return SceneData(_joined(static), _joined(moving), looks, origin_W)


def _middle(p_W: Float64) -> Float64:
    finite = p_W[np.isfinite(p_W).all(axis=1)]
    return np.round(np.median(finite, axis=0)) if len(finite) else np.zeros(3)


def _facets(
    model: mujoco.MjModel, geom: int, name: str, meshes: dict[tuple[str, int], Triangles]
) -> tuple[Facets, Float64 | None, tuple[float, float, float]]:
    """Return the triangles of a geom in its frame, the mesh's own coordinates, and the edges of its box."""
    a, b, c = (float(v) for v in model.geom_size[geom])
    if name in _FLAT:
        key = (name, int(model.geom_dataid[geom]))
        if key not in meshes:
            meshes[key] = (height_field_triangles if name == "HFIELD" else mesh_triangles)(model, key[1])
        mesh = meshes[key]
        corner = mesh.vertex[mesh.triangle].astype(np.float64)
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        kept = np.isfinite(area) & (area > 0.0)
        flat = flat_normals(corner)
        normal = flat if mesh.corner_normal is None else mesh.corner_normal.astype(np.float64)
        usable = np.einsum("nki,nki->nk", normal, flat)[..., None] > _LEAST_SMOOTH  # else a sharp edge, smoothed over
        size = np.ptp(mesh.vertex, axis=0) if len(mesh.vertex) else np.zeros(3)
        uv = None if mesh.uv is None else np.nan_to_num(mesh.uv[kept].astype(np.float64))
        edge = (float(size[0]), float(size[1]), float(size[2]))
        return Facets(corner[kept], np.where(usable, normal, flat)[kept]), uv, edge
    edges = {
        "PLANE": (2.0 * a, 2.0 * b, 0.0),
        "SPHERE": (2.0 * a, 2.0 * a, 2.0 * a),
        "CAPSULE": (2.0 * a, 2.0 * a, 2.0 * b),
        "CYLINDER": (2.0 * a, 2.0 * a, 2.0 * b),
    }
    return primitive(int(model.geom_type[geom]), (a, b, c)), None, edges.get(name, (2.0 * a, 2.0 * b, 2.0 * c))


def _soup(corner: Float64, normal: Float64, uv: Float64, geom: NDArray[np.int32]) -> TriangleSoup:
    return TriangleSoup(corner.astype(np.float32), normal.astype(np.float32), uv.astype(np.float32), geom)


def _joined(parts: list[TriangleSoup]) -> TriangleSoup:
    if not parts:
        empty = np.zeros((0, 3, 3), np.float32)
        return TriangleSoup(empty, empty, np.zeros((0, 3, 2), np.float32), np.zeros(0, np.int32))
    return TriangleSoup(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
