"""Check of the take-off place: solid ground under the vehicle that it stands on, and no obstacle there or just above.

Where that fails, a place nearby is looked for that passes the same check.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import DEG_PER_RAD, RAD_PER_DEG
from sim.physics.contact_model import build_model
from sim.physics.flight_start import FlightStart
from sim.physics.footing import INSIDE_M, OVER_GROUND_M, Footing, find_footing, steepest_slope
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene
from sim.scene.scene_map import actor_pose
from sim.scene.solids import solid_geoms
from sim.scene.world import World
from sim.world_loader import load_world

CONTACT_STEP_S = 0.001
_TOP_M = 10_000.0  # above every map
_DOWN = np.array([[0.0], [0.0], [-1.0]])
_CLIMB_M = 1.2  # above the vehicle nothing is solid up to here
_SEARCH_M = (0.0, 2.0, 4.0, 6.0, 9.0, 12.0, 16.0, 22.0, 30.0, 40.0, 55.0, 75.0, 100.0, 140.0, 200.0)
_BEARINGS = 24
_EASY_RAD = 5.0 * RAD_PER_DEG  # slope of a place that is proposed
_ROOM_M, _UNEVEN_M = 1.2, 0.3  # nothing within this distance of it is higher or lower than this
# A place is a roof if what is at this distance lies a storey below it in as many of 8 directions.
_NEIGHBOURS_M, _STOREY_M, _ROOF_SIDES = 8.0, 1.5, 2
_AROUND_RAD = [0.25 * math.pi * i for i in range(8)]


class TakeOffProblem(NamedTuple):
    """Reason why a vehicle cannot take off, and what to do."""

    message: str
    hint: str
    place: Vec3 | None  # the nearest free ground in W [m]; None: none was found
    foot_m: float | None = None  # lowest height of what is solid, if the place is on a roof; None: it is on the ground


def take_off_problem(
    scene: Scene,
    vehicle: Vehicle,
    start: FlightStart = FlightStart(),  # noqa: B008 (frozen)
) -> TakeOffProblem | None:
    """Return what is wrong with the take-off place, or None. Raises ConfigError for a wrong scene."""
    world = load_world(scene)
    model = build_model(scene, vehicle, contact_step_s=CONTACT_STEP_S)
    data = mujoco.MjData(model)
    _pose_actors(world, model, data)
    x, y, z = start.ground_W
    at_origin = start.ground_W == (0.0, 0.0, 0.0)
    where = "the origin" if at_origin else f"({x:g}, {y:g}, {z:g})"

    def problem(message: str, otherwise: str = "move the map") -> TakeOffProblem:
        top_m = None if at_origin else _top_m(model, data, x, y)
        there = "" if top_m is None else f"the topmost solid surface there is at z = {top_m:.2f} m; "
        place, foot_m = _nearest_place(model, data, vehicle, start, friction=scene.ground_friction)
        if place is None:
            found = f"no free, level ground was found within {_SEARCH_M[-1]:g} m: {otherwise}, or set start.p_W"
        else:
            x_W, y_W, z_W = place
            p_W = f"[{x_W:.2f}, {y_W:.2f}, {z_W:.2f}]"
            found = f"set start.p_W: {p_W}, the nearest free ground that was found, or {otherwise}"
        return TakeOffProblem(message, there + found, place, foot_m)

    footing = find_footing(model, data, vehicle, start)
    deepest = min(_contacts(model, data, footing), default=(0.0, -1))
    if deepest[0] < -INSIDE_M:
        what = solid_name(world, model, deepest[1])
        return problem(
            f"leaves no room to take off: the vehicle at {where} would stand {-deepest[0]:.2f} m inside {what}"
        )
    over_m, over = _overhead(model, data, footing)
    if over_m < _CLIMB_M:
        what = solid_name(world, model, over)
        return problem(f"leaves no room to take off: {what} is {over_m:.2f} m above the vehicle at {where}")
    lowered_m = OVER_GROUND_M + vehicle.standing_height_m - vehicle.lying_height_m
    if not _contacts(model, data, footing, lowered_m):
        return problem(
            f"has no ground to take off from: nothing solid is under {where}",
            "move the map, make its ground solid, or set map.ground: true",
        )
    steepest_rad, does = steepest_slope(vehicle, scene.ground_friction)
    if footing.slope_rad > steepest_rad:
        return problem(
            f"slopes by {footing.slope_rad * DEG_PER_RAD:.1f} degrees at {where}: the vehicle {does} on slopes above "
            f"{steepest_rad * DEG_PER_RAD:.1f} degrees"
        )
    return None


def _nearest_place(
    model: mujoco.MjModel, data: mujoco.MjData, vehicle: Vehicle, start: FlightStart, *, friction: float
) -> tuple[Vec3 | None, float | None]:
    """Return the nearest place on rings round a start where the vehicle stands in the open; ground before roofs.

    With a roof comes the lowest height of the map.
    """
    x0, y0, _ = start.ground_W
    steepest_rad = min(steepest_slope(vehicle, friction)[0], _EASY_RAD)
    on_top: Vec3 | None = None
    for radius_m in _SEARCH_M:
        for i in range(_BEARINGS):
            angle = 2.0 * math.pi * i / _BEARINGS
            x, y = round(x0 + radius_m * det_cos(angle), 2), round(y0 + radius_m * det_sin(angle), 2)
            z = _top_m(model, data, x, y)
            if z is None:
                continue
            place = (x, y, round(z, 3))
            around = [
                [_top_m(model, data, x + r * math.cos(a), y + r * math.sin(a)) for a in _AROUND_RAD]
                for r in (_ROOM_M, _NEIGHBOURS_M)
            ]
            if any(h is None or abs(h - z) > _UNEVEN_M for h in around[0]):
                continue
            footing = find_footing(model, data, vehicle, replace(start, ground_W=place))
            if footing.slope_rad > steepest_rad:
                continue
            if min(_contacts(model, data, footing), default=(0.0, -1))[0] < -INSIDE_M:
                continue
            if _overhead(model, data, footing)[0] < _CLIMB_M:
                continue
            lower = sum(h is None or h < z - _STOREY_M for h in around[1])
            if lower < _ROOF_SIDES:
                return place, None
            on_top = on_top or place
    return (None, None) if on_top is None else (on_top, _foot_m(model, data))


def _top_m(model: mujoco.MjModel, data: mujoco.MjData, x: float, y: float) -> float | None:
    """Return the height of the topmost solid surface; None: there is none."""
    geom = np.full((1, 1), -1, dtype=np.int32)
    top = np.array([[x], [y], [_TOP_M]])
    body = int(model.jnt_bodyid[0])
    distance_m: float = mujoco.mj_ray(model, data, top, _DOWN, None, 1, body, geom)
    return None if distance_m < 0.0 else _TOP_M - distance_m


def _foot_m(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the lowest height of what is solid, by the boxes round its geoms."""
    of_scene = model.geom_bodyid != model.jnt_bodyid[0]
    geoms = np.flatnonzero(of_scene & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE))
    up = data.geom_xmat[geoms, 6:]  # the world's z axis in each geom
    centre, half = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    return float((data.geom_xpos[geoms, 2] + (up * centre - np.abs(up) * half).sum(axis=1)).min())


def _overhead(model: mujoco.MjModel, data: mujoco.MjData, footing: Footing) -> tuple[float, int]:
    """Return distance and geom of what is solid right above a vehicle that stands; infinity if nothing is."""
    geom = np.full((1, 1), -1, dtype=np.int32)
    start = np.array(footing.p_WB, float).reshape(3, 1)
    distance_m = float(mujoco.mj_ray(model, data, start, -_DOWN, None, 1, int(model.jnt_bodyid[0]), geom))
    return (distance_m, int(geom[0, 0])) if distance_m >= 0.0 else (math.inf, -1)


def _pose_actors(world: World, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    for actor in world.map.actors:
        p_WB, q_WB, _, _ = actor_pose(actor, 0)
        for name, p, q in zip(actor.bodies, p_WB, q_WB, strict=True):
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if body >= 0:
                data.mocap_pos[model.body_mocapid[body]] = p
                data.mocap_quat[model.body_mocapid[body]] = q


def _contacts(
    model: mujoco.MjModel, data: mujoco.MjData, footing: Footing, lowered_m: float = 0.0
) -> list[tuple[float, int]]:
    """Return distance (negative: depth) and geom of the scene for each contact, as the vehicle stands or lower."""
    x, y, z = footing.p_WB
    data.qpos[:] = (x, y, z - lowered_m, *footing.q_WB)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    vehicle_body = int(model.jnt_bodyid[0])
    found = []
    for contact in data.contact:
        scene_geom = next(int(geom) for geom in contact.geom if model.geom_bodyid[geom] != vehicle_body)
        found.append((float(contact.dist), scene_geom))
    return found


def solid_name(world: World, model: mujoco.MjModel, geom: int) -> str:
    body = int(model.geom_bodyid[geom])
    if body:
        return repr(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body))
    solids = solid_geoms(world)
    map_geom = int(solids.geom[solids.body == 0][geom])
    return repr(world.instance_names[world.geom_instance[map_geom]])
