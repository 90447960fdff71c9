"""Check of the take-off place: solid ground under the vehicle, and no obstacle where it stands."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.physics.contact_model import build_model
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene
from sim.scene.solids import solid_geoms
from sim.scene.world import World
from sim.world_loader import load_world

# Standing feet sink about 10 um into the ground, and the terrain under them may be uneven.
INSIDE_M = 0.02  # greatest depth of a contact sphere in an object
OVER_GROUND_M = 0.05  # greatest height of the feet over the ground
_CONTACT_STEP_S = 0.001
_TOP_M = 10_000.0  # above every map


def take_off_problem(
    scene: Scene,
    vehicle: Vehicle,
    start: FlightStart = FlightStart(),  # noqa: B008 (frozen)
) -> tuple[str, str] | None:
    """Return what is wrong with the take-off place and what to do, or None. Raises ConfigError for a wrong scene."""
    world = load_world(scene)
    model = build_model(scene, vehicle, contact_step_s=_CONTACT_STEP_S)
    data = mujoco.MjData(model)
    _pose_actors(world, model, data)
    x, y, z = start.ground_W
    at_origin = start.ground_W == (0.0, 0.0, 0.0)
    where = "the origin" if at_origin else f"({x:g}, {y:g}, {z:g})"
    contacts = _contacts(model, data, start, vehicle, vehicle.standing_height_m)
    deepest = min(contacts, default=(0.0, -1))
    if deepest[0] < -INSIDE_M:
        what = _name(world, model, deepest[1])
        message = f"leaves no room to take off: the vehicle at {where} would stand {-deepest[0]:.2f} m inside {what}"
        hint = "move the map so that free ground is there, or set start.p_W to a place on free ground"
        return message, hint if at_origin else _surface_hint(model, data, x, y)
    if not _contacts(model, data, start, vehicle, vehicle.lying_height_m - OVER_GROUND_M):
        message = f"has no ground to take off from: nothing solid is under {where}"
        hint = (
            "flights start at x = y = z = 0 unless start.p_W names another place: set it, move the map, make its "
            "ground solid, or set map.ground: true"
        )
        return message, hint if at_origin else _surface_hint(model, data, x, y)
    return None


def _surface_hint(model: mujoco.MjModel, data: mujoco.MjData, x: float, y: float) -> str:
    """Return what is there: the height of the topmost solid surface."""
    geom = np.full((1, 1), -1, dtype=np.int32)
    top = np.array([[x], [y], [_TOP_M]])
    body = int(model.jnt_bodyid[0])
    distance_m = mujoco.mj_ray(model, data, top, np.array([[0.0], [0.0], [-1.0]]), None, 1, body, geom)
    if distance_m < 0.0:
        return "nothing solid is there at any height: choose another x and y"
    return f"the topmost solid surface there is at z = {_TOP_M - distance_m:.2f} m: choose that height or another place"


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


def _contacts(
    model: mujoco.MjModel, data: mujoco.MjData, start: FlightStart, vehicle: Vehicle, height_m: float
) -> list[tuple[float, int]]:
    """Return distance (negative: depth) and geom of the scene for each contact at that height above the start."""
    x, y, z = start.ground_W
    data.qpos[:] = (x, y, z + height_m, *vehicle.standing_quat(start.yaw_rad))
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    vehicle_body = int(model.jnt_bodyid[0])
    found = []
    for contact in data.contact:
        scene_geom = next(int(geom) for geom in contact.geom if model.geom_bodyid[geom] != vehicle_body)
        found.append((float(contact.dist), scene_geom))
    return found


def _name(world: World, model: mujoco.MjModel, geom: int) -> str:
    body = int(model.geom_bodyid[geom])
    if body:
        return repr(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body))
    solids = solid_geoms(world)
    map_geom = int(solids.geom[solids.body == 0][geom])
    return repr(world.instance_names[world.geom_instance[map_geom]])
