"""Sensors: `DefaultSensors`, and `Sensors` of a vehicle, with AirSim's default values.

Angles are in degrees, positions in metres (forward, right, down from the vehicle). A sensor needs `"Enabled": true`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hil.apps.airsim.settings.reader import Reader, number
from signals.samples import Vec3

_NOT_SIMULATED = {7: "Echo", 8: "GPULidar", 9: "SensorTemplate", 10: "MarlocUwb", 11: "Wifi"}  # Cosys-AirSim's
_MOST_DEG = 3600.0
_DRAWING = ("DrawDebugPoints", "DrawSensor", "DrawMode", "ExternalController")


def _rate_hz(default: float) -> Any:
    return number(default, 0.01, 1000.0, "UpdateFrequency")


def _latency_s(default: float) -> Any:
    return number(default, 0.0, 10.0, "UpdateLatency")


def _of_gps(default: float, *keys: str) -> Any:
    return number(default, 0.0, 1e4, *keys)


@dataclass(frozen=True)
class Barometer:
    enabled: bool = True
    pressure_factor_sigma: float = number(0.0365 / 20.0, 0.0, 1.0, "PressureFactorSigma")
    pressure_factor_tau_s: float = number(3600.0, 1e-3, 1e9, "PressureFactorTau")
    noise_pa: float = number(2.7, 0.0, 1e4, "UncorrelatedNoiseSigma")
    latency_s: float = _latency_s(0.0)
    rate_hz: float = _rate_hz(50.0)


@dataclass(frozen=True)
class Imu:
    enabled: bool = True
    noisy: bool = True  # Cosys-AirSim adds noise only on request
    angular_random_walk_deg_per_sqrt_h: float = number(0.3, 0.0, 1e4, "AngularRandomWalk")
    gyro_bias_deg_per_h: float = number(4.6, 0.0, 1e5, "GyroBiasStability")
    gyro_bias_tau_s: float = number(500.0, 1e-3, 1e9, "GyroBiasStabilityTau")
    velocity_random_walk_mg: float = number(0.24, 0.0, 1e4, "VelocityRandomWalk")
    accel_bias_ug: float = number(36.0, 0.0, 1e6, "AccelBiasStability")
    accel_bias_tau_s: float = number(800.0, 1e-3, 1e9, "AccelBiasStabilityTau")


@dataclass(frozen=True)
class Gps:
    enabled: bool = True
    # AirSim's documentation writes the first two keys without the underscore, its code reads them with it.
    eph_time_constant_s: float = _of_gps(0.9, "EphTimeConstant", "EPH_TimeConstant")
    epv_time_constant_s: float = _of_gps(0.9, "EpvTimeConstant", "EPV_TimeConstant")
    eph_initial_m: float = _of_gps(100.0, "EphInitial")
    epv_initial_m: float = _of_gps(100.0, "EpvInitial")
    eph_final_m: float = _of_gps(0.1, "EphFinal")
    epv_final_m: float = _of_gps(0.1, "EpvFinal")
    eph_min_3d_m: float = _of_gps(3.0, "EphMin3d")
    eph_min_2d_m: float = _of_gps(4.0, "EphMin2d")
    latency_s: float = _latency_s(0.2)
    rate_hz: float = _rate_hz(50.0)
    startup_s: float = _of_gps(1.0, "StartupDelay")


@dataclass(frozen=True)
class Magnetometer:
    enabled: bool = True
    noise_gauss: float = number(0.005, 0.0, 100.0, "NoiseSigma")
    bias_gauss: float = number(0.0, -100.0, 100.0, "NoiseBias")
    scale_factor: float = number(1.0, -100.0, 100.0, "ScaleFactor")
    latency_s: float = _latency_s(0.0)
    rate_hz: float = _rate_hz(50.0)


@dataclass(frozen=True)
class Distance:
    enabled: bool = True
    min_m: float = number(0.2, 0.0, 1e4, "MinDistance")
    max_m: float = number(40.0, 0.01, 1e4, "MaxDistance")
    position_m: Vec3 = (0.0, 0.0, 0.0)
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    noise_m: float = number(0.2, 0.0, 100.0, "UncorrelatedNoiseSigma")
    rate_hz: float = _rate_hz(50.0)


@dataclass(frozen=True)
class Lidar:
    enabled: bool = True
    channels: int = 16
    range_m: float = number(100.0, 0.01, 1e4, "Range")
    points_per_second: int = 100_000
    horizontal_fov_deg: tuple[float, float] = (0.0, 359.0)  # start, end
    vertical_fov_deg: tuple[float, float] = (-45.0, -15.0)  # lower, upper, in any order
    in_sensor_frame: bool = False
    position_m: Vec3 = (0.0, 0.0, 0.0)
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    noise_m: float = 0.0
    rate_hz: float = _rate_hz(10.0)
    # Of the noise at the full range, from 1 at no distance.
    noise_scale: float = number(1.0, 0.0, 100.0, "NoiseDistanceScale")


Sensor = Barometer | Imu | Gps | Magnetometer | Distance | Lidar

MULTIROTOR_SENSORS: Mapping[str, Sensor] = {
    "barometer": Barometer(),
    "gps": Gps(),
    "imu": Imu(),
    "magnetometer": Magnetometer(),
}


def default_sensors(multirotor: bool, cosys: bool) -> dict[str, Sensor]:
    """Return the sensors of a vehicle whose file names none."""
    return {**MULTIROTOR_SENSORS, "imu": Imu(noisy=not cosys)} if multirotor else {}


def read_sensors(
    owner: Reader, key: str, defaults: Mapping[str, Sensor], *, multirotor: bool, cosys: bool
) -> dict[str, Sensor]:
    """Return the sensors by name, sorted: those given, and the defaults of every type that is not given."""
    given: dict[str, Sensor] = {}
    for name, reader in owner.named(key) or []:
        sensor = _read_sensor(reader, multirotor, cosys)
        if sensor is not None:
            given[name] = sensor
    types = {type(sensor) for sensor in given.values()}
    given |= {name: sensor for name, sensor in defaults.items() if type(sensor) not in types}
    return dict(sorted(given.items()))


def _read_sensor(reader: Reader, multirotor: bool, cosys: bool) -> Sensor | None:
    if not reader.has("SensorType"):
        reader.problem(None, "has no SensorType", "1 barometer, 2 IMU, 3 GPS, 4 magnetometer, 5 distance, 6 LiDAR")
        return None
    kind = reader.whole("SensorType", 1, 1, max(_NOT_SIMULATED))
    enabled = reader.flag("Enabled", False)
    if kind in _NOT_SIMULATED:
        if enabled:
            hint = "take SensorType 6, a LiDAR" if kind == 8 else ""
            reader.note(None, f"is a sensor of type {_NOT_SIMULATED[kind]}, which is not simulated and left out", hint)
        return None
    if not reader.has("Enabled"):
        reader.note(None, "is off, as in AirSim", 'a sensor needs "Enabled": true')
    reader.without_meaning(*_DRAWING, "ExternalLocal", "StartupDelay" if kind != 3 else "DrawMode")
    if reader.flag("External", False):
        reader.note("External", "is not supported: the sensor stays on the vehicle")
    sensor: Sensor
    if kind == 1:
        sensor = Barometer(enabled, **reader.values(Barometer))
    elif kind == 2:
        sensor = Imu(enabled, reader.flag("GenerateNoise", not cosys), **reader.values(Imu))
    elif kind == 3:
        sensor = Gps(enabled, **reader.values(Gps))
    elif kind == 4:
        sensor = Magnetometer(enabled, **reader.values(Magnetometer))
    elif kind == 5:
        sensor = _read_distance(reader, enabled, multirotor)
    else:
        sensor = _read_lidar(reader, enabled, multirotor, cosys)
    reader.close(type(sensor).__name__)
    return sensor


def _position_m(reader: Reader, multirotor: bool) -> Vec3:
    return reader.vector((0.0, 0.0, 0.0 if multirotor else -1.0))


def _read_distance(reader: Reader, enabled: bool, multirotor: bool) -> Distance:
    numbers = reader.values(Distance)
    low, high = numbers["min_m"], numbers["max_m"]
    if low >= high:
        reader.problem(None, f"has MinDistance {low:g}, which is not below MaxDistance {high:g}")
    return Distance(
        enabled,
        position_m=_position_m(reader, multirotor),
        rotation_deg=reader.angles_deg((0.0, 0.0, 0.0)),
        **numbers,
    )


def _read_lidar(reader: Reader, enabled: bool, multirotor: bool, cosys: bool) -> Lidar:
    channels = reader.whole("NumberOfChannels", 16, 1, 1024)
    reader.number("RotationsPerSecond", 10.0, 0.01, 1000.0)  # checked only: a sample is a whole rotation
    numbers = reader.values(Lidar)
    points = reader.whole("PointsPerSecond", 100_000, 1, 50_000_000)
    if reader.has("MeasurementsPerCycle"):  # Cosys-AirSim: points of one channel in one rotation
        points = round(channels * numbers["rate_hz"] * reader.whole("MeasurementsPerCycle", 512, 1, 100_000))
    lower = reader.optional("VerticalFOVLower", -_MOST_DEG, _MOST_DEG)
    upper = reader.optional("VerticalFOVUpper", -_MOST_DEG, _MOST_DEG)
    vertical = (
        (-45.0 if multirotor else -10.0) if lower is None else lower,
        (-15.0 if multirotor else 10.0) if upper is None else upper,
    )
    in_sensor_frame = cosys  # Cosys-AirSim has no other frame and does not read DataFrame
    if cosys:
        reader.without_meaning("DataFrame")
    else:
        frames = ("VehicleInertialFrame", "SensorLocalFrame")
        in_sensor_frame = reader.choice("DataFrame", frames[0], frames) == frames[1]
    noise_m = reader.number("MinNoiseStandardDeviation", 0.0, 0.0, 100.0)
    noisy = reader.flag("GenerateNoise", False)
    reader.without_meaning("LimitPoints", "IgnoreMarked")
    return Lidar(
        enabled,
        channels,
        points_per_second=points,
        horizontal_fov_deg=(
            reader.number("HorizontalFOVStart", 0.0, -_MOST_DEG, _MOST_DEG),
            reader.number("HorizontalFOVEnd", 359.0, -_MOST_DEG, _MOST_DEG),
        ),
        vertical_fov_deg=vertical,
        in_sensor_frame=in_sensor_frame,
        position_m=_position_m(reader, multirotor),
        rotation_deg=reader.angles_deg((0.0, 0.0, 0.0)),
        noise_m=noise_m if noisy else 0.0,
        **numbers,
    )
