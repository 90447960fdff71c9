"""Boxes around the objects of a world, as they stand at a time."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from sim.scene.world import World

Float64 = NDArray[np.float64]


class Box(NamedTuple):
    """Box along the axes of W around an object, and the object's own pose."""

    low_W: Vec3
    high_W: Vec3
    p_WO: Vec3
    q_WO: tuple[float, float, float, float]

    @property
    def corners_W(self) -> Float64:
        """(8, 3) Corners."""
        (x0, y0, z0), (x1, y1, z1) = self.low_W, self.high_W
        return np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])


class Bounds:
    """Boxes of one world. Geoms of actors are placed as the actor stands."""

    def __init__(self, world: World) -> None:
        self._world = world
        data = mujoco.MjData(world.model)
        mujoco.mj_kinematics(world.model, data)
        self._p_WG, self._R_WG = data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()
        self._p_WB, self._q_WB = data.xpos.copy(), data.xquat.copy()

    def of(self, instance: int, t_ns: int) -> Box:
        """Return the box of an instance at a time."""
        world, model = self._world, self._world.model
        geoms = np.flatnonzero((world.geom_instance == instance) & world.geom_visible)
        p_WG, R_WG = self._p_WG[geoms], self._R_WG[geoms]
        top = int(model.geom_bodyid[geoms[0]])
        while top and model.body_parentid[top]:
            top = int(model.body_parentid[top])
        p_WO, q_WO = self._p_WB[top], self._q_WB[top]
        actor = int(world.geom_actor[geoms[0]])
        if actor >= 0:
            bodies = world.map.actors[actor].bodies
            p_WB, q_WB = np.empty((len(bodies), 3)), np.empty((len(bodies), 4))
            world.map.actors[actor].pose(t_ns, p_WB, q_WB, np.empty_like(p_WB), np.empty_like(p_WB))
            place = {model.body(name).id: number for number, name in enumerate(bodies)}
            p_WG, R_WG = np.empty((len(geoms), 3)), np.empty((len(geoms), 3, 3))
            for row, geom in enumerate(geoms):
                body = place[int(model.geom_bodyid[geom])]
                R_WB, R_BG = _matrix(q_WB[body]), _matrix(model.geom_quat[geom])
                p_WG[row], R_WG[row] = p_WB[body] + R_WB @ model.geom_pos[geom], R_WB @ R_BG
            p_WO, q_WO = p_WB[0], q_WB[0]
        elif top == 0:  # a geom of the ground
            q_WO = np.empty(4)
            mujoco.mju_mat2Quat(q_WO, R_WG[0].ravel())
            p_WO = p_WG[0]
        boxes = model.geom_aabb[geoms]
        centre = p_WG + np.einsum("nij,nj->ni", R_WG, boxes[:, :3])
        reach = np.einsum("nij,nj->ni", np.abs(R_WG), boxes[:, 3:])
        low, high = (centre - reach).min(axis=0).tolist(), (centre + reach).max(axis=0).tolist()
        return Box(tuple(low), tuple(high), tuple(p_WO.tolist()), tuple(q_WO.tolist()))


def _matrix(q: Float64) -> Float64:
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, q)
    return R.reshape(3, 3)
