"""Distance from a sensor on the vehicle, along an axis of it, to the first surface."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Protocol

import mujoco
import numpy as np

from signals._kernel import rotate_into_world
from signals.samples import TruthState, Vec3
from sim._kernels import BoxScene
from sim.scene.compile.actor_geoms import pose_geoms
from sim.scene.scene import Scene
from sim.scene.scene_map import Actor
from sim.scene.world import World
from sim.world_loader import load_world


class Rays(Protocol):
    """Surfaces that can be hit by rays."""

    def ray_distance(self, origin_W: Vec3, direction_W: Vec3) -> float:
        """Return the distance [m] along a unit vector to the nearest surface; -1 if none is hit."""
        ...


DOWN_B: Vec3 = (0.0, 0.0, -1.0)


class GroundRange:
    """Distance to the static scene along `axis_B`, a unit vector in B, from `mount_m` in B.

    It is a single ray: beam width, slope of the surface, people and the vehicle's own legs are not modelled.
    """

    def __init__(self, scene: Scene, mount_m: Vec3, axis_B: Vec3) -> None:
        self._rays = rays_into(scene)
        self._axis_B = axis_B
        self._mount_m = mount_m
        self._at_origin = not any(mount_m)

    def distance_m(self, truth: TruthState) -> float:
        """Return the true distance [m]; -1 if the ray hits nothing."""
        origin_W = truth.p_WB
        if not self._at_origin:
            dx, dy, dz = rotate_into_world(truth.q_WB, self._mount_m)
            origin_W = (origin_W[0] + dx, origin_W[1] + dy, origin_W[2] + dz)
        return self._rays.ray_distance(origin_W, rotate_into_world(truth.q_WB, self._axis_B))


def rays_into(scene: Scene) -> Rays:
    """Return the surfaces of a scene: ground plane and boxes in closed form, or the visible static geoms of its map."""
    if not scene.has_only_boxes:
        return MapRays(load_world(scene))
    return BoxScene(
        [(*box.center_m, 0.5 * box.size_m[0], 0.5 * box.size_m[1], 0.5 * box.size_m[2]) for box in scene.boxes]
    )


class MapRays:
    """Surfaces of a map; MuJoCo tests every geom. Actors are not there, except those of `posed`, after `pose`."""

    def __init__(self, world: World, posed: Sequence[Actor] = ()) -> None:
        model = self._model = copy.copy(world.model)
        wanted = {id(actor) for actor in posed}
        numbers = [i for i, actor in enumerate(world.map.actors) if id(actor) in wanted]
        is_static = world.geom_actor < 0
        # Rays ignore group 5: invisible geoms, and actors that are not posed here.
        model.geom_group[:] = np.where(world.geom_visible & (is_static | np.isin(world.geom_actor, numbers)), 0, 5)
        self._data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        self._groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)
        self._geom = np.zeros(1, np.int32)
        self._origin, self._direction = np.zeros(3), np.zeros(3)

    def pose(self, actor: Actor, t_ns: int) -> None:
        """Pose an actor of `posed`."""
        pose_geoms(self._model, self._data, actor, t_ns)

    def ray_distance(self, origin_W: Vec3, direction_W: Vec3) -> float:
        self._origin[:], self._direction[:] = origin_W, direction_W
        found: float = mujoco.mj_ray(
            self._model, self._data, self._origin, self._direction, self._groups, 1, -1, self._geom, None
        )
        return found
