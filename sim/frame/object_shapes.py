"""Shapes of the objects of a world: the geoms of an instance at a time, and how far they reach along a direction.

The support of a shape along a unit direction u in its own frame G is h(u) = max u . p over its points p, exactly:

    sphere r                     r
    capsule r, h along z         r + h |u_z|
    cylinder r, h along z        r sqrt(u_x^2 + u_y^2) + h |u_z|
    ellipsoid a                  |(a_x u_x, a_y u_y, a_z u_z)|
    box a                        a_x |u_x| + a_y |u_y| + a_z |u_z|
    rectangle a (a plane)        a_x |u_x| + a_y |u_y|
    mesh, height field           max u . v over its vertices v

For all but the last h(-u) = h(u). Sizes are MuJoCo's. Only visible geoms count: what pictures and LiDARs show.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.rotation import matrix_of
from sim.frame.meshes import height_field_triangles
from sim.scene import semantics
from sim.scene.scene_map import Actor, actor_pose
from sim.scene.world import World

Float64 = NDArray[np.float64]

_PLANE, _HFIELD, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = range(8)  # mjtGeom
_HULL_FROM = 64  # vertices of a mesh; only those of its convex hull can be the farthest


@dataclass(frozen=True, eq=False)
class PosedObject:
    """The visible geoms of an instance at a time, in W; frame O has the object's own axes, x forward."""

    instance: int
    geoms: NDArray[np.int32]  # (n,)
    p_WG: Float64  # (n, 3) [m]
    R_WG: Float64  # (n, 3, 3)
    R_WO: Float64  # (3, 3)
    p_WO: Float64  # (3,) [m]
    v_WO_W: Float64  # (3,) [m/s] of O's origin
    w_WO_W: Float64  # (3,) [rad/s]


@dataclass(frozen=True, eq=False)
class _Parts:
    """Geoms of an instance, and what moves them: an actor with its bodies, or nothing."""

    geoms: NDArray[np.int32]
    actor: Actor | None
    body: NDArray[np.int32]  # (n,) index in the actor's bodies


class ObjectShapes:
    """Shapes of all instances of a world, prepared when they are first asked for."""

    def __init__(self, world: World) -> None:
        self.world = world
        model = self._model = world.model
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._p_WG = data.geom_xpos.copy()
        self._R_WG = data.geom_xmat.reshape(-1, 3, 3).copy()
        self._R_WB = data.xmat.reshape(-1, 3, 3).copy()
        self._p_WB = data.xpos.copy()
        self._top = semantics.Names.of(model).top
        self._R_BG = np.empty((model.ngeom, 9))
        for row, quaternion in zip(self._R_BG, model.geom_quat, strict=True):
            mujoco.mju_quat2Mat(row, quaternion)
        self._R_BG = self._R_BG.reshape(-1, 3, 3)
        shown = np.flatnonzero(world.geom_visible)
        order = shown[np.argsort(world.geom_instance[shown], kind="stable")].astype(np.int32)
        found, starts = np.unique(world.geom_instance[order], return_index=True)
        self._geoms = dict(zip(found.tolist(), np.split(order, starts[1:]), strict=True))
        self._parts: dict[int, _Parts] = {}
        self._still: dict[int, PosedObject] = {}
        self._vertices: dict[tuple[int, int], Float64] = {}

    def moves(self, instance: int) -> bool:
        """Return True if the instance is an actor."""
        return self._parts_of(instance).actor is not None

    def posed(self, instance: int, t_ns: int) -> PosedObject:
        """Return an instance at `t_ns`. Raises KeyError for one without a visible geom."""
        parts = self._parts_of(instance)
        if parts.actor is None:
            if instance not in self._still:
                self._still[instance] = self._at_rest(instance, parts.geoms)
            return self._still[instance]
        p, q, v, w = actor_pose(parts.actor, t_ns)
        R = np.moveaxis(np.reshape(matrix_of(q.T), (3, 3, -1)), -1, 0)  # (n, 3, 3)
        geoms, body = parts.geoms, parts.body
        p_WG = p[body] + np.einsum("nij,nj->ni", R[body], self._model.geom_pos[geoms])
        return PosedObject(instance, geoms, p_WG, R[body] @ self._R_BG[geoms], R[0], p[0], v[0], w[0])

    def _parts_of(self, instance: int) -> _Parts:
        parts = self._parts.get(instance)
        if parts is None:
            geoms = self._geoms[instance]
            number = int(self.world.geom_actor[geoms[0]])
            actor = self.world.map.actors[number] if number >= 0 else None
            body = np.zeros(len(geoms), np.int32)
            if actor is not None:
                index = {self._model.body(name).id: i for i, name in enumerate(actor.bodies)}
                body = np.array([index[int(b)] for b in self._model.geom_bodyid[geoms]], np.int32)
            parts = self._parts[instance] = _Parts(geoms, actor, body)
        return parts

    def _at_rest(self, instance: int, geoms: NDArray[np.int32]) -> PosedObject:
        first = int(geoms[0])
        body = self._top[int(self._model.geom_bodyid[first])]
        if body:
            R_WO, p_WO = self._R_WB[body], self._p_WB[body]
        else:  # one geom of the worldbody: its axes as the file has them, before MuJoCo turned its mesh
            R_WO, p_WO = self._R_WG[first], self._p_WG[first]
            if self._model.geom_type[first] == _MESH:
                turned = np.empty(9)
                mujoco.mju_quat2Mat(turned, self._model.mesh_quat[int(self._model.geom_dataid[first])])
                R_WO = R_WO @ turned.reshape(3, 3).T
        zero = np.zeros(3)
        return PosedObject(instance, geoms, self._p_WG[geoms], self._R_WG[geoms], R_WO, p_WO, zero, zero)

    def extents(self, objects: Sequence[PosedObject], axes_W: Float64) -> tuple[Float64, Float64]:
        """Return the least and greatest u . p (k, 3) of each object's points p [m] along its axes u.

        `axes_W`: (k, 3, 3), for each object the rows are three unit vectors.
        """
        counts = [len(posed.geoms) for posed in objects]
        geoms = np.concatenate([posed.geoms for posed in objects])
        axes = np.repeat(axes_W, counts, axis=0)
        kind = self._model.geom_type[geoms]
        u = axes @ np.concatenate([posed.R_WG for posed in objects])  # (n, 3 axes, 3): the axes in each G
        above = _symmetric_support(kind, self._model.geom_size[geoms], u)
        below = -above
        for i in np.flatnonzero((kind == _MESH) | (kind == _HFIELD)).tolist():
            along = self._mesh(int(kind[i]), int(self._model.geom_dataid[geoms[i]])) @ u[i].T
            above[i], below[i] = along.max(axis=0), along.min(axis=0)
        centre = np.einsum("nij,nj->ni", axes, np.concatenate([posed.p_WG for posed in objects]))
        starts = np.concatenate([[0], np.cumsum(counts[:-1])]).astype(np.intp)
        return (
            np.minimum.reduceat(centre + below, starts, axis=0),
            np.maximum.reduceat(centre + above, starts, axis=0),
        )

    def _mesh(self, kind: int, number: int) -> Float64:
        """Return the vertices of a mesh or height field that can be the farthest in some direction."""
        key = (kind, number)
        if key not in self._vertices:
            model = self._model
            if kind == _HFIELD:
                vertices = height_field_triangles(model, number).vertex.astype(np.float64)
            else:
                begin, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
                vertices = model.mesh_vert[begin : begin + count].astype(np.float64)
            if len(vertices) >= _HULL_FROM:
                from scipy.spatial import ConvexHull, QhullError  # slow to import, and seldom needed

                with contextlib.suppress(QhullError):  # of a flat mesh all vertices stay
                    vertices = vertices[ConvexHull(vertices).vertices]
            self._vertices[key] = np.ascontiguousarray(vertices)
        return self._vertices[key]


def _symmetric_support(kind: NDArray[np.int32], size: Float64, u: Float64) -> Float64:
    """Return the support (n, 3) of each geom along its three axes `u` (n, 3, 3); 0 for meshes."""
    support = np.zeros(u.shape[:2])
    along, a = np.abs(u), size[:, None, :]
    for number in np.unique(kind).tolist():
        of = kind == number
        v, b = along[of], a[of]
        if number == _SPHERE:
            support[of] = b[..., 0]
        elif number == _CAPSULE:
            support[of] = b[..., 0] + b[..., 1] * v[..., 2]
        elif number == _CYLINDER:
            support[of] = b[..., 0] * np.hypot(v[..., 0], v[..., 1]) + b[..., 1] * v[..., 2]
        elif number == _ELLIPSOID:
            support[of] = np.sqrt(((b * v) ** 2).sum(axis=-1))
        elif number == _BOX:
            support[of] = (b * v).sum(axis=-1)
        elif number == _PLANE:
            half = np.where(b[..., :2] > 0.0, b[..., :2], np.inf)
            with np.errstate(invalid="ignore"):
                support[of] = np.nan_to_num(half * v[..., :2], nan=0.0, posinf=np.inf).sum(axis=-1)
    return support
