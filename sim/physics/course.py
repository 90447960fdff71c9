"""Search of straight courses for what stands in their way.

The contact shapes of the vehicle, as it stands but heading along the course, are tested against the solid geoms of the
scene in steps of half its radius: what is thinner than a step may be missed. What moves (people, traffic) is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from signals.rotation import norm
from signals.samples import Vec3
from sim.physics.contact_model import build_model
from sim.physics.take_off import CONTACT_STEP_S, solid_name
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene
from sim.world_loader import load_world

_GROUND = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


class Obstacle(NamedTuple):
    """Solid thing that a vehicle on a course first touches."""

    course: int  # index of the course
    name: str
    p_W: Vec3  # the vehicle there [m]
    after_m: float  # way from the start of the course to there
    is_ground: bool  # a plane or a height field


def obstacles(scene: Scene, vehicle: Vehicle, courses: Iterable[tuple[Vec3, Vec3]]) -> Iterator[Obstacle]:
    """Yield the first obstacle of each course, start and end in W [m], that is not free.

    A kilometre takes about half a second of processor time. Raises ConfigError for a wrong scene.
    """
    if scene.is_bare:
        return
    world = load_world(scene)
    model = build_model(scene, vehicle, contact_step_s=CONTACT_STEP_S)
    data = mujoco.MjData(model)
    body = int(model.jnt_bodyid[0])
    for course, (start_W, end_W) in enumerate(courses):
        q_WB = vehicle.standing_quat(math.atan2(end_W[1] - start_W[1], end_W[0] - start_W[0]))
        for after_m, p_W in _places(start_W, end_W, 0.5 * vehicle.bounding_radius_m):
            data.qpos[:] = (*p_W, *q_WB)
            geom = touched(model, data, body)
            if geom >= 0:
                ground = int(model.geom_type[geom]) in _GROUND
                yield Obstacle(course, solid_name(world, model, geom), p_W, after_m, ground)
                break


def _places(start_W: Vec3, end_W: Vec3, step_m: float) -> Iterator[tuple[float, Vec3]]:
    """Yield way from the start and place along a course, its ends included."""
    way = np.subtract(end_W, start_W)
    length_m = norm((float(way[0]), float(way[1]), float(way[2])))
    steps = math.ceil(length_m / step_m)
    for step in range(steps + 1):
        share = step / max(steps, 1)
        x, y, z = np.asarray(start_W) + share * way
        yield share * length_m, (float(x), float(y), float(z))


def touched(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> int:
    """Return a geom of the scene, not of what moves in it, that the vehicle touches as it is posed; -1: none."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    for contact in data.contact:
        geom = next(int(g) for g in contact.geom if model.geom_bodyid[g] != body)
        if contact.dist < 0.0 and model.geom_bodyid[geom] == 0:
            return geom
    return -1
