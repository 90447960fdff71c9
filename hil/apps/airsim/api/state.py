"""Methods that read the true state of vehicles, and that set it: pose, kinematics, collision, environment."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from hil.apps.airsim.api.session import VEHICLE, geo_point
from hil.apps.airsim.rpc.arguments import (
    BOOL,
    POSE_OR_NAN,
    QUATERNION_OR_NAN,
    VECTOR_OR_NAN,
    Pose,
    Quaternion,
    Vector,
    struct,
)
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.drone import Collision, Drone
from hil.apps.airsim.world.ned import Kinematics, q_WB_from_q_NF, unit_rotation
from signals.frames import frd_from_flu, ned_from_enu, q_NF_from_q_WB
from signals.samples import Quat, Vec3
from sim.scene.atmosphere import LAPSE_K_PER_M, LOWEST_M, SEA_LEVEL_K, TOP_M, TROPOPAUSE_M, geopotential_m, pressure_pa

_GAS_CONSTANT = 287.05  # of dry air [J/(kg K)]
_LANDED, _FLYING = 0, 1
_RC_DATA = {
    "timestamp": 0,
    "pitch": 0.0,
    "roll": 0.0,
    "throttle": 0.0,
    "yaw": 0.0,
    "left_z": 0.0,
    "right_z": 0.0,
    "switches": 0,
    "vendor_id": "",
    "is_initialized": False,
    "is_valid": False,
}


class KinematicsState(NamedTuple):
    """AirSim's KinematicsState, as a client gives it; NaN: keep."""

    position: Vector = Vector()
    orientation: Quaternion = Quaternion()
    linear_velocity: Vector = Vector()
    angular_velocity: Vector = Vector()
    linear_acceleration: Vector = Vector()
    angular_acceleration: Vector = Vector()


KINEMATICS = struct(
    "KinematicsState",
    KinematicsState,
    position=VECTOR_OR_NAN,
    orientation=QUATERNION_OR_NAN,
    linear_velocity=VECTOR_OR_NAN,
    angular_velocity=VECTOR_OR_NAN,
    linear_acceleration=VECTOR_OR_NAN,
    angular_acceleration=VECTOR_OR_NAN,
)


def _kept(wanted: Vector, present: Vec3) -> Vec3:
    """Return a vector whose NaN components are those of the present one."""
    x, y, z = (b if math.isnan(a) else a for a, b in zip(wanted, present, strict=True))
    return (x, y, z)


def place(
    simulation: Simulation,
    drone: Drone,
    pose: Pose,
    v_N: Vec3 | None = None,
    w_F: Vec3 | None = None,
    *,
    collides: bool = False,
) -> None:
    """Put a vehicle elsewhere, NaN keeps a component. Rotors and, if not given, velocities stay. Raises RpcError.

    `collides`: what a vehicle without physics touches there is a collision; one that flies touches it in the next tick.
    """
    truth = drone.vehicle.truth
    p_N = _kept(pose.position, drone.origin.from_W(truth.p_WB))
    q: Quat = tuple(pose.orientation)  # type: ignore[assignment]
    q_WB = unit_rotation(truth.q_WB if any(map(math.isnan, q)) else q_WB_from_q_NF(q))
    v_W = truth.v_WB_W if v_N is None else ned_from_enu(_kept(Vector(*v_N), ned_from_enu(truth.v_WB_W)))
    w_B = truth.w_WB_B if w_F is None else frd_from_flu(_kept(Vector(*w_F), frd_from_flu(truth.w_WB_B)))
    try:
        drone.vehicle.place(drone.origin.to_W(p_N), q_WB, v_W, w_B, truth.rotor_speed_radps)
    except ValueError as error:
        raise RpcError(f"{drone.name} cannot be put there: {error}") from None
    simulation.placed(drone, collides=collides)


def environment(simulation: Simulation, drone: Drone) -> dict[str, Any]:
    """Return AirSim's EnvironmentState: the standard atmosphere at the vehicle."""
    p_W = drone.vehicle.truth.p_WB
    point = geo_point(simulation, p_W)
    height_m = min(max(geopotential_m(point["altitude"]), LOWEST_M), TOP_M)
    pressure = pressure_pa(height_m)
    temperature = SEA_LEVEL_K - LAPSE_K_PER_M * min(height_m, TROPOPAUSE_M)
    return {
        "position": Vector(*drone.origin.from_W(p_W)),
        "geo_point": point,
        "gravity": Vector(0.0, 0.0, simulation.scene.gravity_mps2),
        "air_pressure": pressure,
        "temperature": temperature,
        "air_density": pressure / (_GAS_CONSTANT * temperature),
    }


def rotor_states(simulation: Simulation, drone: Drone) -> dict[str, Any]:
    """Return thrust [N], torque on the body along its axis [N m] and speed [rad/s] of every rotor."""
    model = drone.vehicle.vehicle
    c = model.rotor_constants
    rotors = []
    for rotor, speed in zip(model.rotors, drone.vehicle.truth.rotor_speed_radps, strict=True):
        thrust = c.thrust_coefficient_n_per_radps2 * speed * speed
        rotors.append({"thrust": thrust, "torque_scaler": -rotor.spin.sign * c.moment_ratio_m * thrust, "speed": speed})
    return {"rotors": rotors, "timestamp": simulation.now_ns}


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""
    id_of = sim.cameras.segmentation.id_of

    def multirotor_state(name: str) -> dict[str, Any]:
        drone = sim.drone(name)
        return {
            "collision": drone.collision_info(sim.epoch_ns, id_of),
            "kinematics_estimated": drone.origin.kinematics(drone.vehicle.truth),
            "gps_location": geo_point(sim, drone.vehicle.truth.p_WB),
            "timestamp": sim.now_ns,
            "landed_state": landed_state(name),
            "rc_data": _RC_DATA,
            # Its clients know these too, but AirSim itself does not send them:
            "ready": True,
            "ready_message": "",
            "can_arm": True,
        }

    def computer_vision_state(name: str) -> dict[str, Any]:
        drone = sim.drone(name)
        return {"kinematics_estimated": drone.origin.kinematics(drone.vehicle.truth), "timestamp": sim.now_ns}

    def kinematics(name: str) -> Kinematics:
        drone = sim.drone(name)
        return drone.origin.kinematics(drone.vehicle.truth)

    def pose(name: str) -> Pose:
        drone = sim.drone(name)
        return drone.origin.pose(drone.vehicle.truth.p_WB, drone.vehicle.truth.q_WB)

    def set_pose(wanted: Pose, ignore_collision: bool, name: str) -> None:
        place(sim, sim.drone(name), wanted, collides=not ignore_collision)

    def set_kinematics(state: KinematicsState, ignore_collision: bool, name: str) -> None:  # noqa: ARG001
        pose = Pose(state.position, state.orientation)
        place(sim, sim.drone(name), pose, state.linear_velocity, state.angular_velocity)

    def collision(name: str) -> dict[str, Any]:
        drone = sim.drone(name)
        info = drone.collision_info(sim.epoch_ns, id_of)
        drone.collision = Collision()  # reading clears it
        return info

    def position(name: str) -> Vector:
        drone = sim.drone(name)
        return Vector(*drone.origin.from_W(drone.vehicle.truth.p_WB))

    def landed_state(name: str) -> int:
        flight = sim.drone(name).flight
        return _LANDED if flight is not None and flight.landed else _FLYING

    ignore = optional("ignore_collision", BOOL, True)
    state, pose_parameter = Parameter("state", KINEMATICS), Parameter("pose", POSE_OR_NAN)
    return [
        method("getMultirotorState", multirotor_state, VEHICLE),
        method("getComputerVisionState", computer_vision_state, VEHICLE),
        method("getRotorStates", lambda name: rotor_states(sim, sim.drone(name)), VEHICLE),
        method("simGetGroundTruthKinematics", kinematics, VEHICLE),
        method("simGetPhysicsRawKinematics", kinematics, VEHICLE),
        method("simGetGroundTruthEnvironment", lambda name: environment(sim, sim.drone(name)), VEHICLE),
        method("simSetKinematics", set_kinematics, state, ignore, VEHICLE),
        method("simSetPhysicsRawKinematics", lambda wanted, name: set_kinematics(wanted, True, name), state, VEHICLE),
        method("simGetVehiclePose", pose, VEHICLE),
        method("simSetVehiclePose", set_pose, pose_parameter, ignore, VEHICLE),
        method("simGetCollisionInfo", collision, VEHICLE),
        # Clients before June 2018:
        method("simGetPose", pose, VEHICLE),
        method("simSetPose", set_pose, pose_parameter, ignore, VEHICLE),
        method("getCollisionInfo", collision, VEHICLE),
        method("getPosition", position, VEHICLE),
        method("getVelocity", lambda name: Vector(*ned_from_enu(sim.drone(name).vehicle.truth.v_WB_W)), VEHICLE),
        method("getOrientation", lambda name: Quaternion(*q_NF_from_q_WB(sim.drone(name).vehicle.truth.q_WB)), VEHICLE),
        method("getLandedState", landed_state, VEHICLE),
        method("getGpsLocation", lambda name: geo_point(sim, sim.drone(name).vehicle.truth.p_WB), VEHICLE),
        method("getRCData", lambda name: (sim.drone(name), _RC_DATA)[1], VEHICLE),
    ]
