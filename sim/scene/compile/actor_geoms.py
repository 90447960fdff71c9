"""Geoms of actors in MuJoCo's data of a world, and the way of an object up to the first contact.

The way is found by conservative advancement: an object that is d away from everything moves by d.
"""

from __future__ import annotations

import mujoco
import numpy as np

from signals.rotation import applied_to_rows, dot, matrix_of, norm
from signals.samples import Quat, Vec3
from sim.scene.placed.actor import ObjectActor
from sim.scene.scene_map import Actor, actor_pose
from sim.scene.world import World

_TOUCH_M = 1e-3
_ASIDE_M = 0.01  # of a step that shows whether an object leaves what it touches
_MOST_STEPS = 200


def actor_geoms(model: mujoco.MjModel, body: str) -> range:
    """Return the geoms of an actor's body."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body)
    first = int(model.body_geomadr[number])
    return range(first, first + int(model.body_geomnum[number]))


def pose_geoms(model: mujoco.MjModel, data: mujoco.MjData, actor: Actor, t_ns: int) -> None:
    """Write the poses of an actor's geoms at `t_ns`."""
    p, q, _, _ = actor_pose(actor, t_ns)
    for name, p_WB, q_WB in zip(actor.bodies, p, q.tolist(), strict=True):
        R_WB = np.array(matrix_of(q_WB)).reshape(3, 3)
        for geom in actor_geoms(model, name):
            R_BG = np.array(matrix_of(model.geom_quat[geom].tolist())).reshape(3, 3)
            data.geom_xpos[geom] = p_WB + applied_to_rows(R_WB, model.geom_pos[geom])
            data.geom_xmat[geom] = applied_to_rows(R_WB, R_BG.T).T.ravel()


def posed(world: World, t_ns: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a world's model, and new data with all actors posed at `t_ns`."""
    data = mujoco.MjData(world.model)
    mujoco.mj_kinematics(world.model, data)
    for actor in world.map.actors:
        pose_geoms(world.model, data, actor, t_ns)
    return world.model, data


def way_to(world: World, moved: ObjectActor, start_W: Vec3, end_W: Vec3, q_WB: Quat, t_ns: int) -> Vec3:
    """Return where an object comes that moves straight to `end_W`, up to its first contact with another solid.

    Meshes count as their convex hulls. What the object touches at the start stops it only if it moves into it.
    """
    model = world.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for actor in world.map.actors:
        if actor is not moved:
            pose_geoms(model, data, actor, t_ns)
    own = [geom for body in moved.bodies for geom in actor_geoms(model, body) if world.geom_solid[geom]]
    probe = ObjectActor(moved.name, moved.fixed, 0.0)
    dx, dy, dz = (b - a for a, b in zip(start_W, end_W, strict=True))
    length_m = norm((dx, dy, dz))
    direction = np.array((dx, dy, dz)) / max(length_m, 1e-12)
    others = _near(world, data, own, start_W, end_W, moved.bound(t_ns)[1])
    buffer = np.zeros(6)

    def at(travelled_m: float) -> Vec3:
        x, y, z = (np.array(start_W) + travelled_m * direction).tolist()
        return (x, y, z)

    def distances(travelled_m: float, geoms: list[int], most_m: float) -> list[float]:
        probe.put(at(travelled_m), q_WB)
        pose_geoms(model, data, probe, 0)
        return [min(mujoco.mj_geomDistance(model, data, a, b, most_m, buffer) for a in own) for b in geoms]

    if not own or length_m < 1e-9:
        return end_W
    touched = [g for g, d in zip(others, distances(0.0, others, length_m), strict=True) if d <= _TOUCH_M]
    before = distances(0.0, touched, length_m)
    aside = distances(min(_ASIDE_M, length_m), touched, length_m)
    if any(b < a - 0.1 * _TOUCH_M for a, b in zip(before, aside, strict=True)):
        return start_W
    others = [geom for geom in others if geom not in touched]
    travelled_m = 0.0
    for _ in range(_MOST_STEPS):
        gap_m = min(distances(travelled_m, others, length_m - travelled_m), default=length_m)
        if gap_m >= length_m - travelled_m:
            return end_W
        if gap_m <= _TOUCH_M:
            break
        travelled_m += gap_m
    return at(travelled_m)


def _near(world: World, data: mujoco.MjData, own: list[int], start_W: Vec3, end_W: Vec3, radius_m: float) -> list[int]:
    """Return the solid geoms of others whose bounding spheres an object may meet on its way."""
    model = world.model
    solid = np.setdiff1d(np.flatnonzero(world.geom_solid), own)
    a, b = np.array(start_W), np.array(end_W)
    p = data.geom_xpos[solid]
    way = b - a
    along = np.clip(dot((p - a).T, way) / max(float(dot(way, way)), 1e-12), 0.0, 1.0)
    away = (p - (a + along[:, None] * way)).T
    gap = np.sqrt(dot(away, away))
    reach = model.geom_rbound[solid]
    found: list[int] = solid[(reach <= 0.0) | (gap <= reach + radius_m + 0.1)].tolist()
    return found
