"""Check of the take-off place: solid ground at W's origin, and no obstacle where the vehicle stands."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.physics.contact_model import build_model
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene
from sim.scene.solids import solid_geoms
from sim.scene.world import World
from sim.world_loader import load_world

# Feet rest about 10 um deep, and terrain under them may be uneven.
INSIDE_M = 0.02
OVER_GROUND_M = 0.05
_CONTACT_STEP_S = 0.001


def take_off_problem(scene: Scene, vehicle: Vehicle) -> tuple[str, str] | None:
    """Return what is wrong with the take-off place and what to do, or None. Raises ConfigError for a wrong scene."""
    world = load_world(scene)
    model = build_model(scene, vehicle, contact_step_s=_CONTACT_STEP_S)
    data = mujoco.MjData(model)
    _pose_actors(world, model, data)
    contacts = _contacts(model, data, vehicle.standing_height_m)
    deepest = min(contacts, default=(0.0, -1))
    if deepest[0] < -INSIDE_M:
        what = _name(world, model, deepest[1])
        message = f"leaves no room to take off: the vehicle at the origin would stand {-deepest[0]:.2f} m inside {what}"
        return message, "the origin is where flights begin: move the map so that free ground is there"
    if not _contacts(model, data, vehicle.standing_height_m - OVER_GROUND_M):
        hint = "the bench starts at x = y = z = 0: move the map, make its ground solid, or set map.ground: true"
        return "has no ground to take off from: nothing solid is under the origin", hint
    return None


def _pose_actors(world: World, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    for actor in world.map.actors:
        n = len(actor.bodies)
        p_WB, q_WB = np.zeros((n, 3)), np.zeros((n, 4))
        actor.pose(0, p_WB, q_WB, np.zeros((n, 3)), np.zeros((n, 3)))
        for name, p, q in zip(actor.bodies, p_WB, q_WB, strict=True):
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if body >= 0:
                data.mocap_pos[model.body_mocapid[body]] = p
                data.mocap_quat[model.body_mocapid[body]] = q


def _contacts(model: mujoco.MjModel, data: mujoco.MjData, height_m: float) -> list[tuple[float, int]]:
    """Return distance (negative: depth) and geom of the scene for each contact at that height."""
    data.qpos[:] = (0.0, 0.0, height_m, 1.0, 0.0, 0.0, 0.0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    vehicle_body = int(model.jnt_bodyid[0])
    found = []
    for contact in data.contact:
        pair = [int(geom) for geom in contact.geom if model.geom_bodyid[geom] != vehicle_body]
        found.append((float(contact.dist), pair[0]))
    return found


def _name(world: World, model: mujoco.MjModel, geom: int) -> str:
    body = int(model.geom_bodyid[geom])
    if body:
        return repr(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body))
    placed = solid_geoms(world)
    of_map = int(placed.geom[placed.body == 0][geom])
    return repr(world.instance_names[world.geom_instance[of_map]])
