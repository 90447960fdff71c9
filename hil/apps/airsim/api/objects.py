"""Methods about where objects and vehicles are: pose, scale, and the direction from one to the other."""

from __future__ import annotations

import math

from hil.apps.airsim.api.state import place
from hil.apps.airsim.rpc.arguments import (
    BOOL,
    NAME,
    POSE,
    TEXT,
    VECTOR_OR_NAN,
    Pose,
    Quaternion,
    Vector,
)
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.ned import q_WB_from_q_NF
from signals._kernel import det_atan2
from signals.samples import Quat, Vec3
from signals.units import DEG_PER_RAD

_NAN = math.nan
NO_POSE = Pose(Vector(_NAN, _NAN, _NAN), Quaternion(_NAN, _NAN, _NAN, _NAN))


def object_names(simulation: Simulation) -> list[str]:
    """Return the names of all objects that exist, then those of the vehicles."""
    return [*simulation.objects.names, *simulation.drones]


def pose_in_W(sim: Simulation, pose: Pose) -> tuple[Vec3, Quat]:
    """Return place and orientation in W of a pose that a client gave."""
    (x, y, z), q_NF = pose
    return sim.frame.to_W((x, y, z)), q_WB_from_q_NF((q_NF.w_val, q_NF.x_val, q_NF.y_val, q_NF.z_val))


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    sim, objects = simulation, simulation.objects

    def get_pose(name: str, ned: bool) -> Pose:
        drone = sim.drones.get(name)
        if drone is not None:
            p_W, q_W = drone.vehicle.truth.p_WB, drone.vehicle.truth.q_WB
        else:
            found = objects.find(name)
            if found is None:
                return NO_POSE
            p_W, q_W = found.p_W, found.q_W
        pose = sim.frame.pose(p_W, q_W)
        return pose if ned else _unreal(pose)

    def set_pose(name: str, pose: Pose, teleport: bool) -> bool:
        drone = sim.drones.get(name)
        if drone is not None:
            p_N = drone.origin.from_W(pose_in_W(sim, pose)[0])
            place(sim, drone, Pose(Vector(*p_N), pose.orientation), collides=not teleport)
            return True
        p_W, q_W = pose_in_W(sim, pose)
        return objects.put(name, p_W, q_W) if teleport else objects.sweep(name, p_W, q_W)

    def get_scale(name: str) -> Vector:
        found = objects.find(name)
        if found is not None:
            return Vector(*found.scale)
        return Vector(1.0, 1.0, 1.0) if name in sim.drones else Vector()  # zeros, as AirSim

    def set_scale(name: str, scale: Vector) -> bool:
        if name in sim.drones:
            sim.log(f"{name} is a vehicle and keeps its size")
            return False
        return objects.rescale(name, finite("scale", scale))

    def look_at(vehicle: str, name: str) -> Vector:
        drone, target = sim.drone(vehicle), get_pose(name, True).position
        if not target.is_finite:
            return Vector()  # zeros, as Colosseum
        p_N = sim.frame.from_W(drone.vehicle.truth.p_WB)
        north, east, down = (a - b for a, b in zip(target, p_N, strict=True))
        pitch_rad, yaw_rad = det_atan2(-down, math.sqrt(north * north + east * east)), det_atan2(east, north)
        return Vector(pitch_rad * DEG_PER_RAD, 0.0, yaw_rad * DEG_PER_RAD)

    pose, scale = Parameter("pose", POSE), Parameter("scale", VECTOR_OR_NAN)
    name = Parameter("object_name", NAME)
    return [
        method("simGetObjectPose", get_pose, name, optional("ned", BOOL, True)),
        method("simSetObjectPose", set_pose, name, pose, optional("teleport", BOOL, True))._replace(
            is_long=lambda name, _, teleport: not teleport and not sim.present.is_settled and name not in sim.drones
        ),
        method("simGetObjectScale", get_scale, name),
        method("simSetObjectScale", set_scale, name, scale),
        # Colosseum's; pitch, roll and yaw in degrees, as Unreal counts them.
        method("simFindLookAtRotation", look_at, Parameter("vehicle_name", TEXT), name),
    ]


def finite(what: str, vector: Vector) -> Vec3:
    """Return the components of a vector. Raises RpcError if one is not finite."""
    if not vector.is_finite:
        raise RpcError(f"the {what} {tuple(vector)} is not finite")
    return tuple(vector)  # type: ignore[return-value]


def _unreal(pose: Pose) -> Pose:
    """Return a pose in Unreal's axes [cm]: north, east, up."""
    (x, y, z), (w, i, j, k) = pose
    return Pose(Vector(100.0 * x, 100.0 * y, -100.0 * z), Quaternion(w, -i, -j, k))
