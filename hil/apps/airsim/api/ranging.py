"""Methods that read the distance sensor, the LiDAR and the radar, the first two as AirSim returns them."""

from __future__ import annotations

from typing import Any

import numpy as np

from hil.apps.airsim.api.sensors import named, read_sensor
from hil.apps.airsim.rpc.arguments import Pose, Quaternion, Vector
from hil.apps.airsim.rpc.methods import Method, RpcError, method
from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.sensors.lidar import Cloud, ned_points
from sim.frame.mount import quaternion_of_rpy
from sim.frame.source import VEHICLE_CLASS


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""

    def distance(name: str, vehicle: str) -> dict[str, Any]:
        _, settings, sample, stamp_ns = read_sensor(sim, kinds.Distance, "distance sensor", name, vehicle)
        turned = quaternion_of_rpy(settings.rotation_deg)
        return {
            "time_stamp": stamp_ns,
            "distance": sample.value,
            "min_distance": settings.min_m,
            "max_distance": settings.max_m,
            "relative_pose": Pose(Vector(*settings.position_m), Quaternion(*turned)),
        }

    def lidar(name: str, vehicle: str) -> dict[str, Any]:
        drone, settings, sample, stamp_ns = read_sensor(sim, kinds.Lidar, "lidar", name, vehicle)
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

    return [
        method("getDistanceSensorData", distance, *named("distance_sensor")),
        method("getLidarData", lidar, *named("lidar")),
        method("getRadarData", radar, *named("radar")),  # a method of this server; AirSim has no radar
        # Clients before 2021:
        method("simGetLidarSegmentation", lambda name, vehicle: lidar(name, vehicle)["segmentation"], *named("lidar")),
    ]
