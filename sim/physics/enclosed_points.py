"""Points inside solid things of a scene: a sensor there sees nothing of it. What moves (people, traffic) is left out.

Only solids of the contact model count, meshes as their convex pieces: the air between the walls of a room is free. What
lies below a height field is inside it, however deep: the field's own solid ends some metres below its lowest place.
"""

from __future__ import annotations

import mujoco
import numpy as np

from signals.rotation import applied, conjugate, matrix_of
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
        fields = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD) & (model.geom_bodyid == 0))
        self._fields = [(int(geom), matrix_of(conjugate(model.geom_quat[geom].tolist()))) for geom in fields]

    def around(self, p_W: Vec3) -> str:
        """Return the name of what encloses a point; "": it is free."""
        geom = self._field_above(p_W)
        if geom < 0 and self._tree.distance(p_W) <= _POINT_M:
            self._data.qpos[:] = (*p_W, 1.0, 0.0, 0.0, 0.0)
            geom = touched(self._model, self._data, self._body)
        return "" if geom < 0 else solid_name(self._world, self._model, geom)

    def _field_above(self, p_W: Vec3) -> int:
        """Return the height field below whose solid a point lies; -1: none."""
        model = self._model
        for geom, R_GW in self._fields:
            ex, ey, ez = model.geom_pos[geom].tolist()
            x, y, z = applied(R_GW, (p_W[0] - ex, p_W[1] - ey, p_W[2] - ez))
            half_x, half_y, _, base = model.hfield_size[model.geom_dataid[geom]].tolist()
            if abs(x) <= half_x and abs(y) <= half_y and z <= -base:
                return geom
        return -1
