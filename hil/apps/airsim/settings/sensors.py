"""Sensors: `DefaultSensors`, and `Sensors` of a vehicle, with AirSim's default values.

Angles are in degrees, positions in metres (forward, right, down from the vehicle). A sensor needs `"Enabled": true`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hil.apps.airsim.settings.reader import Reader
from signals.samples import Vec3

_NOT_SIMULATED = {7: "Echo", 8: "GPULidar", 9: "SensorTemplate", 10: "MarlocUwb", 11: "Wifi"}  # Cosys-AirSim's
_MOST_DEG = 3600.0
_DRAWING = ("DrawDebugPoints", "DrawSensor", "DrawMode", "ExternalController")


@dataclass(frozen=True)
class Barometer:
    enabled: bool = True
    pressure_factor_sigma: float = 0.0365 / 20.0
    pressure_factor_tau_s: float = 3600.0
    noise_pa: float = 2.7
    latency_s: float = 0.0
    rate_hz: float = 50.0


@dataclass(frozen=True)
class Imu:
    enabled: bool = True
    noisy: bool = True  # Cosys-AirSim adds noise only on request
    angular_random_walk_deg_per_sqrt_h: float = 0.3
    gyro_bias_deg_per_h: float = 4.6
    gyro_bias_tau_s: float = 500.0
    velocity_random_walk_mg: float = 0.24
    accel_bias_ug: float = 36.0
    accel_bias_tau_s: float = 800.0


@dataclass(frozen=True)
class Gps:
    enabled: bool = True
    eph_time_constant_s: float = 0.9
    epv_time_constant_s: float = 0.9
    eph_initial_m: float = 100.0
    epv_initial_m: float = 100.0
    eph_final_m: float = 0.1
    epv_final_m: float = 0.1
    eph_min_3d_m: float = 3.0
    eph_min_2d_m: float = 4.0
    latency_s: float = 0.2
    rate_hz: float = 50.0
    startup_s: float = 1.0


@dataclass(frozen=True)
class Magnetometer:
    enabled: bool = True
    noise_gauss: float = 0.005
    bias_gauss: float = 0.0
    scale_factor: float = 1.0
    latency_s: float = 0.0
    rate_hz: float = 50.0


@dataclass(frozen=True)
class Distance:
    enabled: bool = True
    min_m: float = 0.2
    max_m: float = 40.0
    position_m: Vec3 = (0.0, 0.0, 0.0)
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    noise_m: float = 0.2
    rate_hz: float = 50.0


@dataclass(frozen=True)
class Lidar:
    enabled: bool = True
    channels: int = 16
    range_m: float = 100.0
    points_per_second: int = 100_000
    horizontal_fov_deg: tuple[float, float] = (0.0, 359.0)  # start, end
    vertical_fov_deg: tuple[float, float] = (-45.0, -15.0)  # lower, upper, in any order
    in_sensor_frame: bool = False
    position_m: Vec3 = (0.0, 0.0, 0.0)
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    noise_m: float = 0.0
    rate_hz: float = 10.0
    noise_scale: float = 1.0  # of the noise at the full range, from 1 at no distance


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
        sensor = _read_barometer(reader, enabled)
    elif kind == 2:
        sensor = _read_imu(reader, enabled, not cosys)
    elif kind == 3:
        sensor = _read_gps(reader, enabled)
    elif kind == 4:
        sensor = _read_magnetometer(reader, enabled)
    elif kind == 5:
        sensor = _read_distance(reader, enabled, multirotor)
    else:
        sensor = _read_lidar(reader, enabled, multirotor, cosys)
    reader.close(type(sensor).__name__)
    return sensor


def _rate_hz(reader: Reader, default: float) -> float:
    return reader.number("UpdateFrequency", default, 0.01, 1000.0)


def _latency_s(reader: Reader, default: float) -> float:
    return reader.number("UpdateLatency", default, 0.0, 10.0)


def _read_barometer(reader: Reader, enabled: bool) -> Barometer:
    default = Barometer()
    return Barometer(
        enabled,
        reader.number("PressureFactorSigma", default.pressure_factor_sigma, 0.0, 1.0),
        reader.number("PressureFactorTau", default.pressure_factor_tau_s, 1e-3, 1e9),
        reader.number("UncorrelatedNoiseSigma", default.noise_pa, 0.0, 1e4),
        _latency_s(reader, default.latency_s),
        _rate_hz(reader, default.rate_hz),
    )


def _read_imu(reader: Reader, enabled: bool, noisy: bool) -> Imu:
    default = Imu()
    return Imu(
        enabled,
        reader.flag("GenerateNoise", noisy),
        reader.number("AngularRandomWalk", default.angular_random_walk_deg_per_sqrt_h, 0.0, 1e4),
        reader.number("GyroBiasStability", default.gyro_bias_deg_per_h, 0.0, 1e5),
        reader.number("GyroBiasStabilityTau", default.gyro_bias_tau_s, 1e-3, 1e9),
        reader.number("VelocityRandomWalk", default.velocity_random_walk_mg, 0.0, 1e4),
        reader.number("AccelBiasStability", default.accel_bias_ug, 0.0, 1e6),
        reader.number("AccelBiasStabilityTau", default.accel_bias_tau_s, 1e-3, 1e9),
    )


def _read_gps(reader: Reader, enabled: bool) -> Gps:
    default = Gps()

    def number(key: str, value: float) -> float:
        return reader.number(key, value, 0.0, 1e4)

    # AirSim's documentation writes the first two keys without the underscore, its code reads them with it.
    return Gps(
        enabled,
        number("EPH_TimeConstant", number("EphTimeConstant", default.eph_time_constant_s)),
        number("EPV_TimeConstant", number("EpvTimeConstant", default.epv_time_constant_s)),
        number("EphInitial", default.eph_initial_m),
        number("EpvInitial", default.epv_initial_m),
        number("EphFinal", default.eph_final_m),
        number("EpvFinal", default.epv_final_m),
        number("EphMin3d", default.eph_min_3d_m),
        number("EphMin2d", default.eph_min_2d_m),
        _latency_s(reader, default.latency_s),
        _rate_hz(reader, default.rate_hz),
        number("StartupDelay", default.startup_s),
    )


def _read_magnetometer(reader: Reader, enabled: bool) -> Magnetometer:
    default = Magnetometer()
    return Magnetometer(
        enabled,
        reader.number("NoiseSigma", default.noise_gauss, 0.0, 100.0),
        reader.number("NoiseBias", default.bias_gauss, -100.0, 100.0),
        reader.number("ScaleFactor", default.scale_factor, -100.0, 100.0),
        _latency_s(reader, default.latency_s),
        _rate_hz(reader, default.rate_hz),
    )


def _position_m(reader: Reader, multirotor: bool) -> Vec3:
    return reader.vector((0.0, 0.0, 0.0 if multirotor else -1.0))


def _read_distance(reader: Reader, enabled: bool, multirotor: bool) -> Distance:
    low = reader.number("MinDistance", 0.2, 0.0, 1e4)
    high = reader.number("MaxDistance", 40.0, 0.01, 1e4)
    if low >= high:
        reader.problem(None, f"has MinDistance {low:g}, which is not below MaxDistance {high:g}")
    return Distance(
        enabled, low, high, _position_m(reader, multirotor), reader.angles_deg((0.0, 0.0, 0.0)),
        reader.number("UncorrelatedNoiseSigma", 0.2, 0.0, 100.0), _rate_hz(reader, 50.0),
    )  # fmt: skip


def _read_lidar(reader: Reader, enabled: bool, multirotor: bool, cosys: bool) -> Lidar:
    channels = reader.whole("NumberOfChannels", 16, 1, 1024)
    reader.number("RotationsPerSecond", 10.0, 0.01, 1000.0)  # checked only: a sample is a whole rotation
    rate_hz = _rate_hz(reader, 10.0)
    points = reader.whole("PointsPerSecond", 100_000, 1, 50_000_000)
    if reader.has("MeasurementsPerCycle"):  # Cosys-AirSim: points of one channel in one rotation
        points = round(channels * rate_hz * reader.whole("MeasurementsPerCycle", 512, 1, 100_000))
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
        reader.number("Range", 100.0, 0.01, 1e4),
        points,
        (
            reader.number("HorizontalFOVStart", 0.0, -_MOST_DEG, _MOST_DEG),
            reader.number("HorizontalFOVEnd", 359.0, -_MOST_DEG, _MOST_DEG),
        ),
        vertical,
        in_sensor_frame,
        _position_m(reader, multirotor),
        reader.angles_deg((0.0, 0.0, 0.0)),
        noise_m if noisy else 0.0,
        rate_hz,
        reader.number("NoiseDistanceScale", 1.0, 0.0, 100.0),
    )
