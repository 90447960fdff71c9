"""The geometry of a world for the native kernels: static part prepared once, what moves posed at a time.

    T_WG(t) = T_WB(t) T_BG

B are the actors' bodies, whose poses and velocities are pure functions of time (sim.scene.maps.scene_map.Actor).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim._kernels import Geometry, Scenery
from sim.frame.meshes import height_field_triangles, mesh_triangles
from sim.frame.scenery import make_scenery
from sim.scene.maps.scene_map import Actor
from sim.scene.world import World

_HFIELD, _MESH = int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_MESH)
_SHAPES = frozenset({0, 2, 3, 4, 5, 6, _MESH})
_UNPOSED = -1

# Whether nothing within a sphere (centre [m, W], radius [m]) can be seen.
OutOfReach = Callable[[tuple[float, float, float], float], bool]


class FrameGeometry:
    """Native geometry and scenery of a world.

    `native` and `scenery` are shared by all cameras and LiDARs of a run. `pose` moves everything at once; `expect` says
    what time it is, and each camera or LiDAR then brings what can be within its sight: actors that nobody can see are
    never posed.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.native = Geometry()
        self.posed = 0  # actors posed so far
        self._left_out = 0  # of moments that are over
        self._looked = False  # somebody, at this moment
        self._settled = False
        model = world.model
        self.scenery: Scenery = make_scenery(model, looks=world.geom_look)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        actors = world.map.actors
        moving = np.zeros(model.ngeom, bool)
        self._actors = [_PosedActor(actor, model) for actor in actors]
        for posed in self._actors:
            moving[posed.geoms] = True
        meshes: dict[tuple[int, int], int] = {}
        for geom in range(model.ngeom):
            kind = int(model.geom_type[geom])
            mesh = -1
            if kind in (_HFIELD, _MESH):
                source = (kind, int(model.geom_dataid[geom]))
                if source not in meshes:
                    make = height_field_triangles if kind == _HFIELD else mesh_triangles
                    meshes[source] = self.native.add_mesh(*make(model, source[1]))
                mesh, kind = meshes[source], _MESH
            known = kind in _SHAPES
            self.native.add_geom(
                shape=kind if known else 2,
                size=tuple(model.geom_size[geom].tolist()),
                p_WG=tuple(data.geom_xpos[geom].tolist()),
                R_WG=tuple(data.geom_xmat[geom].tolist()),
                mesh=mesh,
                moving=bool(moving[geom]),
                visible=known and bool(world.geom_visible[geom]),
                class_id=int(world.geom_class[geom]),
                instance=int(world.geom_instance[geom]),
                surface=int(world.geom_surface[geom]),
            )
        self.native.finish()
        self.t_ns = 0
        self.pose(0)

    @cached_property
    def plain_scenery(self) -> Scenery:
        """The same without textures: each surface in the mean colour of its own."""
        return self.scenery.without_textures()

    def pose(self, t_ns: int) -> None:
        """Everything that moves, at `t_ns`. A pose that is not finite hides its geoms."""
        self.expect(t_ns)
        self.bring()

    def expect(self, t_ns: int) -> None:
        """From now on the time is `t_ns`; whoever looks brings what it may see."""
        if t_ns != self.t_ns:
            self._left_out, self._looked, self._settled = self.unposed, False, False
        self.t_ns = t_ns

    @property
    def settled(self) -> bool:
        """Whether everything is where it is at this time, and somebody looked."""
        return self._settled

    @property
    def unposed(self) -> int:
        """Actors so far that nobody could see at a moment when somebody looked."""
        return self._left_out + (sum(actor.t_ns != self.t_ns for actor in self._actors) if self._looked else 0)

    def bring(self, out_of_reach: OutOfReach | None = None) -> None:
        """Pose the actors that are not yet where they are at this time.

        Those for which `out_of_reach` is true are hidden instead, until somebody brings them.
        """
        self._looked = self._settled = True
        for actor in self._actors:
            if actor.t_ns == self.t_ns:
                continue
            if out_of_reach is not None and out_of_reach(*actor.actor.bound(self.t_ns)):
                actor.hide(self.native)
                self._settled = False
            else:
                actor.move(self.native, self.t_ns)
                self.posed += 1


class _PosedActor:
    """One actor, its geoms, and room for its poses."""

    def __init__(self, actor: Actor, model: mujoco.MjModel) -> None:
        self.actor = actor
        self.t_ns = _UNPOSED
        bodies = {model.body(name).id: index for index, name in enumerate(actor.bodies)}
        geoms = [geom for geom in range(model.ngeom) if int(model.geom_bodyid[geom]) in bodies]
        self.geoms: NDArray[np.int32] = np.array(geoms, np.int32)
        self._bodies = np.array([bodies[int(model.geom_bodyid[geom])] for geom in geoms], np.int32)
        self._p_BG = np.array([model.geom_pos[geom] for geom in geoms], np.float64).reshape(-1, 3)
        rotation = np.empty(9)
        self._R_BG = np.empty((len(geoms), 3, 3))
        for row, geom in enumerate(geoms):
            mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
            self._R_BG[row] = rotation.reshape(3, 3)
        n = len(actor.bodies)
        self._p_WB, self._q_WB = np.zeros((n, 3)), np.zeros((n, 4))
        self._v_WB_W, self._w_WB_W = np.zeros((n, 3)), np.zeros((n, 3))

    def hide(self, native: Geometry) -> None:
        if self.t_ns != _UNPOSED:
            native.hide(self.geoms)
            self.t_ns = _UNPOSED

    def move(self, native: Geometry, t_ns: int) -> None:
        self.actor.pose(t_ns, self._p_WB, self._q_WB, self._v_WB_W, self._w_WB_W)
        native.move_bodies(
            self.geoms, self._bodies, self._p_BG, self._R_BG, self._p_WB, self._q_WB, self._v_WB_W, self._w_WB_W
        )
        self.t_ns = t_ns
