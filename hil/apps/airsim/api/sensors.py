"""Methods that read IMU, barometer, magnetometer and GPS, as AirSim returns them."""

from __future__ import annotations

from typing import Any

from hil.apps.airsim.api.session import VEHICLE, geo_point
from hil.apps.airsim.rpc.arguments import TEXT, Quaternion, Vector
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.drone import Drone
from hil.apps.airsim.world.sensors.gps import GpsFix
from hil.apps.airsim.world.sensors.suite import Sample
from signals.frames import ned_from_enu, q_NF_from_q_WB

_NS_PER_US = 1000


def read_sensor(
    simulation: Simulation, kind: type, what: str, name: str, vehicle: str
) -> tuple[Drone, Any, Sample, int]:
    """Return vehicle, settings and present sample of a sensor, and its time stamp. Raises RpcError."""
    drone = simulation.drone(vehicle)
    sensors = drone.sensors
    found = sensors.find(kind, name)
    if found is None:
        known = [key for key, sensor in sensors.settings.items() if isinstance(sensor, kind) and sensor.enabled]
        hint = f"it has {', '.join(known)}" if known else f"add one to Sensors of {drone.name} in settings.json"
        raise RpcError(f"No {what} with name {name} exist on vehicle {drone.name}; {hint}")
    sample = sensors.read(found, drone.past)
    return drone, sensors.settings[found], sample, simulation.epoch_ns + sample.t_ns


def named(sensor: str) -> tuple[Parameter, Parameter]:
    """Return the parameters of a method that reads a sensor: its name and the vehicle's."""
    return optional(f"{sensor}_name", TEXT, ""), VEHICLE


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""

    def imu(name: str, vehicle: str) -> dict[str, Any]:
        drone, _, sample, stamp_ns = read_sensor(sim, kinds.Imu, "IMU", name, vehicle)
        accel, rate = sample.value
        return {
            "time_stamp": stamp_ns,
            "orientation": Quaternion(*q_NF_from_q_WB(drone.vehicle.truth.q_WB)),
            "angular_velocity": Vector(*rate),
            "linear_acceleration": Vector(*accel),
        }

    def barometer(name: str, vehicle: str) -> dict[str, Any]:
        _, _, sample, stamp_ns = read_sensor(sim, kinds.Barometer, "barometer", name, vehicle)
        altitude, pressure, qnh = sample.value
        return {"time_stamp": stamp_ns, "altitude": altitude, "pressure": pressure, "qnh": qnh}

    def magnetometer(name: str, vehicle: str) -> dict[str, Any]:
        _, _, sample, stamp_ns = read_sensor(sim, kinds.Magnetometer, "magnetometer", name, vehicle)
        return {
            "time_stamp": stamp_ns,
            "magnetic_field_body": Vector(*sample.value),
            "magnetic_field_covariance": [],
        }

    def gps(name: str, vehicle: str) -> dict[str, Any]:
        _, _, sample, stamp_ns = read_sensor(sim, kinds.Gps, "gps", name, vehicle)
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

    return [
        method("getImuData", imu, *named("imu")),
        method("getBarometerData", barometer, *named("barometer")),
        method("getMagnetometerData", magnetometer, *named("magnetometer")),
        method("getGpsData", gps, *named("gps")),
    ]
