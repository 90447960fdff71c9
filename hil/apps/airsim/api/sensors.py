"""Methods that read sensors: IMU, barometer, magnetometer, GPS, distance sensor and LiDAR, as AirSim returns them."""

from __future__ import annotations

from typing import Any

import numpy as np

from hil.apps.airsim.api.session import VEHICLE, geo_point
from hil.apps.airsim.rpc.arguments import TEXT, Pose, Quaternion, Vector
from hil.apps.airsim.rpc.methods import Method, RpcError, method, optional
from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.drone import Drone
from hil.apps.airsim.world.sensors import ned_points
from signals.frames import ned_from_enu, q_NF_from_q_WB
from sim.frame.source import VEHICLE_CLASS

_NS_PER_US = 1000


def _found(drone: Drone, kind: type, what: str, name: str) -> str:
    """Return the name of a sensor; "" is the first of its kind. Raises RpcError in AirSim's words."""
    found = drone.sensors.find(kind, name)
    if found is None:
        known = [key for key, sensor in drone.sensors.settings.items() if isinstance(sensor, kind) and sensor.enabled]
        hint = f"it has {', '.join(known)}" if known else f"add one to Sensors of {drone.name} in settings.json"
        raise RpcError(f"No {what} with name {name} exist on vehicle {drone.name}; {hint}")
    return found


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    sim = simulation

    def taken_ns(drone: Drone, sensor: str) -> int:
        return sim.epoch_ns + drone.sensors.taken_ns(sensor)

    def imu(name: str, vehicle: str) -> dict[str, Any]:
        drone = sim.drone(vehicle)
        truth = drone.vehicle.truth
        found = _found(drone, kinds.Imu, "IMU", name)
        accel, rate = drone.sensors.imu(found, truth)
        return {
            "time_stamp": taken_ns(drone, found),
            "orientation": Quaternion(*q_NF_from_q_WB(truth.q_WB)),
            "angular_velocity": Vector(*rate),
            "linear_acceleration": Vector(*accel),
        }

    def barometer(name: str, vehicle: str) -> dict[str, Any]:
        drone = sim.drone(vehicle)
        found = _found(drone, kinds.Barometer, "barometer", name)
        altitude, pressure, qnh = drone.sensors.barometer(
            found, drone.vehicle.truth, drone.history, lambda p_W: sim.earth.geodetic(p_W)[2]
        )
        return {
            "time_stamp": taken_ns(drone, found),
            "altitude": altitude,
            "pressure": pressure,
            "qnh": qnh,
        }

    def magnetometer(name: str, vehicle: str) -> dict[str, Any]:
        drone = sim.drone(vehicle)
        found = _found(drone, kinds.Magnetometer, "magnetometer", name)
        field = drone.sensors.magnetometer(found, drone.vehicle.truth, drone.history)
        return {
            "time_stamp": taken_ns(drone, found),
            "magnetic_field_body": Vector(*field),
            "magnetic_field_covariance": [],
        }

    def gps(name: str, vehicle: str) -> dict[str, Any]:
        drone = sim.drone(vehicle)
        found = _found(drone, kinds.Gps, "gps", name)
        fix = drone.sensors.gps(found, drone.history)
        return {
            "time_stamp": taken_ns(drone, found),
            "gnss": {
                "geo_point": geo_point(sim, fix.truth.p_WB),
                "eph": fix.eph_m,
                "epv": fix.epv_m,
                "velocity": Vector(*ned_from_enu(fix.truth.v_WB_W)),
                "fix_type": fix.fix_type,
                "time_utc": (sim.epoch_ns + fix.truth.t_ns) // _NS_PER_US,
            },
            "is_valid": True,
        }

    def distance(name: str, vehicle: str) -> dict[str, Any]:
        drone = sim.drone(vehicle)
        found = _found(drone, kinds.Distance, "distance sensor", name)
        settings = drone.sensors.settings[found]
        assert isinstance(settings, kinds.Distance)
        mounting = drone.sensors.mounting(found)
        metres = drone.sensors.distance(found, drone.vehicle.truth)
        return {
            "time_stamp": taken_ns(drone, found),
            "distance": metres,
            "min_distance": settings.min_m,
            "max_distance": settings.max_m,
            "relative_pose": Pose(Vector(*mounting.position_F), Quaternion(*mounting.q_FS)),
        }

    def lidar(name: str, vehicle: str) -> dict[str, Any]:
        drone = sim.drone(vehicle)
        found = _found(drone, kinds.Lidar, "lidar", name)
        settings = drone.sensors.settings[found]
        assert isinstance(settings, kinds.Lidar)
        cloud = drone.sensors.lidar(found, drone.vehicle.truth, sim.frames.seen_by(drone.name))
        pose = drone.origin.pose(cloud.p_WL, cloud.q_WL)
        points = cloud.points_L * np.array([1.0, -1.0, -1.0], np.float32)
        if not settings.in_sensor_frame:
            points = ned_points(cloud.points_L, pose.position, cloud.q_WL)
        numbers, of_point = np.unique(cloud.instances, return_inverse=True)
        names = [cloud.names[number].removeprefix(f"{VEHICLE_CLASS}:") for number in numbers.tolist()]
        ids = np.array([max(sim.cameras.segmentation.of_known(each), 0) for each in names], np.int32)
        return {
            "time_stamp": taken_ns(drone, found),
            "point_cloud": points.astype(np.float32).ravel(),
            "pose": pose,
            "segmentation": ids[of_point],
            "groundtruth": [names[i] for i in of_point.tolist()],  # Cosys-AirSim's
        }

    def radar(name: str, vehicle: str) -> dict[str, Any]:
        drone = sim.drone(vehicle)
        names = sim.radars.names
        if not names or (name and name not in names):
            hint = f"it has {', '.join(names)}" if names else "add a radar to the sensors of the bench file"
            raise RpcError(f"No radar with name {name} exist on vehicle {drone.name}; {hint}")
        frame = sim.radars.frame(drone.name, name or names[0], drone.vehicle.truth)
        raw, points = frame.channels["raw"], frame.channels["points"]
        table = np.stack([points["x_R"], -points["y_R"], -points["z_R"], points["speed_mps"], points["snr_db"]], axis=1)
        return {
            "time_stamp": sim.epoch_ns + frame.t_capture_ns,
            "pose": drone.origin.pose(frame.p_WR, frame.q_WR),
            "raw": raw.astype("<u2").tobytes(),
            "shape": list(raw.shape),
            "points": table.astype(np.float32).ravel(),
        }

    def named(sensor: str) -> tuple[Any, Any]:
        return optional(f"{sensor}_name", TEXT, ""), VEHICLE

    return [
        method("getImuData", imu, *named("imu")),
        method("getBarometerData", barometer, *named("barometer")),
        method("getMagnetometerData", magnetometer, *named("magnetometer")),
        method("getGpsData", gps, *named("gps")),
        method("getDistanceSensorData", distance, *named("distance_sensor")),
        method("getLidarData", lidar, *named("lidar")),
        method("getRadarData", radar, *named("radar")),  # a method of this server; AirSim has no radar
        # Clients before 2021:
        method("simGetLidarSegmentation", lambda name, vehicle: lidar(name, vehicle)["segmentation"], *named("lidar")),
    ]
