"""Points inside solid things of a scene: a sensor there sees nothing of it. What moves (people, traffic) is left out.

Only solids of the contact model count, meshes as their convex pieces: the air between the walls of a room is free.
"""

from __future__ import annotations

import mujoco

from signals.samples import Vec3
from sim.physics.contact_model import build_model
from sim.physics.course import touched
from sim.physics.take_off import CONTACT_STEP_S, solid_name
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene
from sim.scene.solids import solid_tree
from sim.world_loader import load_world

_POINT_M = 1e-3  # radius of the ball that stands for a point


class EnclosedPoints:
    """Tells for points of one scene what encloses them; one near something takes some tenths of a millisecond."""

    def __init__(self, scene: Scene, vehicle: Vehicle) -> None:
        """`vehicle` lends the body that becomes the point. Raises ConfigError for a wrong scene."""
        self._world = load_world(scene)
        self._tree = solid_tree(self._world)
        model = self._model = build_model(scene, vehicle, contact_step_s=CONTACT_STEP_S)
        self._body = int(model.jnt_bodyid[0])
        balls = model.geom_bodyid == self._body
        model.geom_pos[balls] = 0.0
        model.geom_size[balls], model.geom_rbound[balls] = _POINT_M, _POINT_M
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE  # its boxes are those of the vehicle
        self._data = mujoco.MjData(model)

    def around(self, p_W: Vec3) -> str:
        """Return the name of what encloses a point; "": it is free."""
        if self._tree.distance(p_W) > _POINT_M:
            return ""
        self._data.qpos[:] = (*p_W, 1.0, 0.0, 0.0, 0.0)
        geom = touched(self._model, self._data, self._body)
        return "" if geom < 0 else solid_name(self._world, self._model, geom)
