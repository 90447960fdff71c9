"""Boxes around the objects of a world, and around all of them, as they stand at a time."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.samples import Quat, Vec3
from sim.scene.compile.actor_geoms import pose_geoms
from sim.scene.scene_map import actor_pose
from sim.scene.world import World

_OUTSIDE_M = 1e6  # objects that were taken away are outside the world


class Box(NamedTuple):
    """Box along the axes of W around an object, and the object's own pose."""

    low_W: Vec3
    high_W: Vec3
    p_WO: Vec3
    q_WO: Quat

    @property
    def corners_W(self) -> NDArray[np.float64]:
        """(8, 3) Corners."""
        (x0, y0, z0), (x1, y1, z1) = self.low_W, self.high_W
        return np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])


class Bounds:
    """Boxes of one world. Geoms of actors are placed as the actor stands."""

    def __init__(self, world: World) -> None:
        self._world, self._model = world, world.model
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)

    def of(self, instance: int, t_ns: int) -> Box:
        """Return the box of an instance at a time."""
        world, model, data = self._world, self._model, self._data
        geoms = np.flatnonzero((world.geom_instance == instance) & world.geom_visible)
        number = int(world.geom_actor[geoms[0]])
        top = int(model.geom_bodyid[geoms[0]])
        while top and model.body_parentid[top]:
            top = int(model.body_parentid[top])
        if number >= 0:
            actor = world.map.actors[number]
            pose_geoms(model, data, actor, t_ns)
            p, q, _, _ = actor_pose(actor, t_ns)
            p_WO, q_WO = p[0], q[0]
        elif top:
            p_WO, q_WO = data.xpos[top], data.xquat[top]
        else:  # a geom of the ground
            p_WO, q_WO = data.geom_xpos[geoms[0]], np.empty(4)
            mujoco.mju_mat2Quat(q_WO, data.geom_xmat[geoms[0]])
        low, high = self._corners(geoms)
        return Box(
            tuple(low.min(axis=0).tolist()),
            tuple(high.max(axis=0).tolist()),
            tuple(p_WO.tolist()),
            tuple(q_WO.tolist()),
        )

    def extents(self, t_ns: int) -> tuple[Vec3, Vec3]:
        """Return the corners of the box around all visible geoms with an end; two equal points if there are none."""
        world, model = self._world, self._model
        for actor in world.map.actors:
            pose_geoms(model, self._data, actor, t_ns)
        low, high = self._corners(
            np.flatnonzero(world.geom_visible & (model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE)))
        )
        inside = (np.abs(low + high) < 2.0 * _OUTSIDE_M).all(axis=1)
        if not inside.any():
            return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        return tuple(low[inside].min(axis=0).tolist()), tuple(high[inside].max(axis=0).tolist())

    def _corners(self, geoms: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the least and the greatest coordinates of each geom, (n, 3)."""
        R_WG, boxes = self._data.geom_xmat[geoms].reshape(-1, 3, 3), self._model.geom_aabb[geoms]
        centre = self._data.geom_xpos[geoms] + np.einsum("nij,nj->ni", R_WG, boxes[:, :3])
        reach = np.einsum("nij,nj->ni", np.abs(R_WG), boxes[:, 3:])
        return centre - reach, centre + reach
