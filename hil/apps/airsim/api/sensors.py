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
from hil.apps.airsim.world.sensors.gps import GpsFix
from hil.apps.airsim.world.sensors.lidar import Cloud, ned_points
from hil.apps.airsim.world.sensors.suite import Sample
from signals.frames import ned_from_enu, q_NF_from_q_WB
from sim.frame.mount import quaternion_of_rpy
from sim.frame.source import VEHICLE_CLASS

_NS_PER_US = 1000


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    sim = simulation

    def read(kind: type, what: str, name: str, vehicle: str) -> tuple[Drone, Any, Sample, int]:
        """Return vehicle, settings and present sample of a sensor, and its time stamp. Raises RpcError."""
        drone = sim.drone(vehicle)
        sensors = drone.sensors
        found = sensors.find(kind, name)
        if found is None:
            known = [key for key, sensor in sensors.settings.items() if isinstance(sensor, kind) and sensor.enabled]
            hint = f"it has {', '.join(known)}" if known else f"add one to Sensors of {drone.name} in settings.json"
            raise RpcError(f"No {what} with name {name} exist on vehicle {drone.name}; {hint}")
        sample = sensors.read(found, drone.past)
        return drone, sensors.settings[found], sample, sim.epoch_ns + sample.t_ns

    def imu(name: str, vehicle: str) -> dict[str, Any]:
        drone, _, sample, stamp_ns = read(kinds.Imu, "IMU", name, vehicle)
        accel, rate = sample.value
        return {
            "time_stamp": stamp_ns,
            "orientation": Quaternion(*q_NF_from_q_WB(drone.vehicle.truth.q_WB)),
            "angular_velocity": Vector(*rate),
            "linear_acceleration": Vector(*accel),
        }

    def barometer(name: str, vehicle: str) -> dict[str, Any]:
        _, _, sample, stamp_ns = read(kinds.Barometer, "barometer", name, vehicle)
        altitude, pressure, qnh = sample.value
        return {"time_stamp": stamp_ns, "altitude": altitude, "pressure": pressure, "qnh": qnh}

    def magnetometer(name: str, vehicle: str) -> dict[str, Any]:
        _, _, sample, stamp_ns = read(kinds.Magnetometer, "magnetometer", name, vehicle)
        return {
            "time_stamp": stamp_ns,
            "magnetic_field_body": Vector(*sample.value),
            "magnetic_field_covariance": [],
        }

    def gps(name: str, vehicle: str) -> dict[str, Any]:
        _, _, sample, stamp_ns = read(kinds.Gps, "gps", name, vehicle)
        fix: GpsFix = sample.value
        return {
            "time_stamp": stamp_ns,
            "gnss": {
                "geo_point": geo_point(sim, fix.truth.p_WB),
                "eph": fix.eph_m,
                "epv": fix.epv_m,
                "velocity": Vector(*ned_from_enu(fix.truth.v_WB_W)),
                "fix_type": fix.fix_type,
                "time_utc": stamp_ns // _NS_PER_US,
            },
            "is_valid": True,
        }

    def distance(name: str, vehicle: str) -> dict[str, Any]:
        _, settings, sample, stamp_ns = read(kinds.Distance, "distance sensor", name, vehicle)
        turned = quaternion_of_rpy(settings.rotation_deg)
        return {
            "time_stamp": stamp_ns,
            "distance": sample.value,
            "min_distance": settings.min_m,
            "max_distance": settings.max_m,
            "relative_pose": Pose(Vector(*settings.position_m), Quaternion(*turned)),
        }

    def lidar(name: str, vehicle: str) -> dict[str, Any]:
        drone, settings, sample, stamp_ns = read(kinds.Lidar, "lidar", name, vehicle)
        cloud: Cloud = sample.value
        pose = drone.origin.pose(cloud.p_WL, cloud.q_WL)
        points = cloud.points_L * np.array([1.0, -1.0, -1.0], np.float32)
        if not settings.in_sensor_frame:
            points = ned_points(cloud.points_L, pose.position, cloud.q_WL)
        numbers, of_point = np.unique(cloud.instances, return_inverse=True)
        names = [cloud.names[number].removeprefix(f"{VEHICLE_CLASS}:") for number in numbers.tolist()]
        ids = np.array([max(sim.cameras.segmentation.id_of(each), 0) for each in names], np.int32)
        if not sim.settings.added.cosys:
            sim.large_replies.note("getLidarData", points.size)
        return {
            "time_stamp": stamp_ns,
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
        frame = sim.radars.frame(drone.name, name or names[0], drone.past)
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
