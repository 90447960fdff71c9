"""Geometry of a world for the native kernels: static geoms are prepared once, actors are posed at a time.

Actors are functions of time (sim.scene.scene_map.Actor); their geoms move with their bodies. The vehicles of a run
are actors whose states are placed at every tick (sim/physics/vehicle_bodies.py).
"""

from __future__ import annotations

import copy
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim._kernels import Geometry, RayCaster, Reach, SceneActors, Scenery
from sim.frame.meshes import height_field_triangles, mesh_triangles
from sim.frame.scenery import alpha_masks, make_scenery
from sim.frame.wet_surface import soaks, wetness
from sim.scene.scene_map import Actor
from sim.scene.world import World

_HFIELD, _MESH = int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_MESH)
_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_SHAPES = frozenset({0, 2, 3, 4, 5, 6, _MESH})


class FrameGeometry:
    """Native geometry and scenery of a world.

    `native` and `scenery` are shared by all cameras and LiDARs of a run. `pose` poses all actors at once. `expect` only
    sets the time; each camera or LiDAR then poses the actors that it may see, and actors out of sight are not posed.
    `left_out`: number of the actor that this view does not show, -1 for none.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.native = Geometry()
        self.posed = 0  # actors posed so far
        self._skipped = 0  # actors not posed at earlier times
        self._absent = 0  # actors not posed at this time
        self._was_used = False  # True if a sensor has used the geometry at this time
        self.left_out = -1
        self.prepared: dict[Any, Any] = {}  # shared by all views: shadow maps, the ray caster
        model = world.model
        self.scenery: Scenery = make_scenery(model, appearances=world.geom_appearance, wet=_wet(world))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        actor_geoms = [_geoms_of(actor, model) for actor in world.map.actors]
        is_moving = np.zeros(model.ngeom, bool)
        for geoms in actor_geoms:
            is_moving[geoms] = True
        add_geoms(self.native, world, data, is_moving)
        self.native.finish()
        self._actors = SceneActors(self.native)
        for actor, geoms in zip(world.map.actors, actor_geoms, strict=True):
            _add_actor(self._actors, actor, geoms[world.geom_visible[geoms]], model)
        self.t_ns = 0
        self.pose(0)

    @cached_property
    def plain_scenery(self) -> Scenery:
        """Scenery without textures: each surface has its mean colour."""
        return self.scenery.without_textures()

    @property
    def caster(self) -> RayCaster:
        """Caster of all LiDARs."""
        if RayCaster not in self.prepared:
            self.prepared[RayCaster] = RayCaster(self.native)
        caster: RayCaster = self.prepared[RayCaster]
        return caster

    def without(self, actor: str) -> FrameGeometry:
        """Return a view that does not show one actor. It shares everything but its time and counters."""
        view = copy.copy(self)
        view.left_out = [known.name for known in self.world.map.actors].index(actor)
        view.posed = view._skipped = view._absent = 0
        view._was_used = False
        return view

    def forget(self, actor: int) -> None:
        """Hide an actor until it is posed again, because its poses have changed."""
        self._actors.hide(actor)

    def forget_all(self) -> None:
        """Hide all actors until they are posed again."""
        for actor in range(len(self.world.map.actors)):
            self._actors.hide(actor)
        self._was_used = False

    def pose(self, t_ns: int) -> None:
        """Pose all actors at `t_ns`. A pose that is not finite hides its geoms."""
        self.expect(t_ns)
        self.pose_within()

    def expect(self, t_ns: int) -> None:
        """Set the time to `t_ns`; each sensor then poses the actors that it may see."""
        if t_ns != self.t_ns:
            self._skipped, self._was_used = self.unposed, False
        self.t_ns = t_ns

    @property
    def settled(self) -> bool:
        """True if all actors are posed at this time and a sensor has used them."""
        self._actors.leave_out(self.left_out)
        return self._was_used and self._actors.absent(self.t_ns) == 0

    @property
    def unposed(self) -> int:
        """Number of actor poses skipped so far because no sensor could see the actor."""
        return self._skipped + (self._absent if self._was_used else 0)

    def pose_within(self, reach: Reach | None = None) -> None:
        """Pose the actors within `reach` (None: all) that are not yet posed at this time.

        Actors out of reach are hidden until a later call poses them.
        """
        self._was_used = True
        self._actors.leave_out(self.left_out)
        self.posed += self._actors.pose_within(self.t_ns, reach)
        self._absent = self._actors.absent(self.t_ns)


def _wet(world: World) -> list[float]:
    """Return the share of the wet look of each geom; empty without rain."""
    share = wetness(world.scene.weather.rain_mm_per_h)
    if share == 0.0:
        return []
    by_surface = [share if soaks(surface) else 0.0 for surface in world.surfaces]
    return [by_surface[surface] for surface in world.geom_surface.tolist()]


def add_geoms(native: Geometry, world: World, data: mujoco.MjData, is_moving: NDArray[np.bool_]) -> None:
    """Add all geoms of a world to `native`, in the order of its model; `data` has the poses of those that stand still.

    `is_moving`: (ngeom,) the geoms that `native.move` may move.
    """
    model = world.model
    meshes: dict[tuple[int, int], int] = {}
    mask_of_geom = alpha_masks(model, native)
    for geom in range(model.ngeom):
        kind = int(model.geom_type[geom])
        mesh = -1
        if kind in (_HFIELD, _MESH):
            source = (kind, int(model.geom_dataid[geom]))
            if source not in meshes:
                make = height_field_triangles if kind == _HFIELD else mesh_triangles
                meshes[source] = native.add_mesh(*make(model, source[1]))
            mesh, kind = meshes[source], _MESH
        is_known = kind in _SHAPES
        native.add_geom(
            shape=kind if is_known else _SPHERE,
            size=tuple(model.geom_size[geom].tolist()),
            p_WG=tuple(data.geom_xpos[geom].tolist()),
            R_WG=tuple(data.geom_xmat[geom].tolist()),
            mesh=mesh,
            moving=bool(is_moving[geom]),
            visible=is_known and bool(world.geom_visible[geom]),
            class_id=int(world.geom_class[geom]),
            instance=int(world.geom_instance[geom]),
            surface=int(world.geom_surface[geom]),
            mask=mask_of_geom.get(geom, -1),
        )


def _geoms_of(actor: Actor, model: mujoco.MjModel) -> NDArray[np.int32]:
    bodies = [model.body(name).id for name in actor.bodies]
    return np.flatnonzero(np.isin(model.geom_bodyid, bodies)).astype(np.int32)


def _add_actor(actors: SceneActors, actor: Actor, geoms: NDArray[np.int32], model: mujoco.MjModel) -> None:
    index = {model.body(name).id: i for i, name in enumerate(actor.bodies)}
    R_BG = np.empty((len(geoms), 9))
    for row, geom in zip(R_BG, geoms, strict=True):
        mujoco.mju_quat2Mat(row, model.geom_quat[geom])
    actors.add(
        actor,
        geoms,
        np.array([index[int(body)] for body in model.geom_bodyid[geoms]], np.int32),
        model.geom_pos[geoms],
        R_BG.reshape(-1, 3, 3),
    )
