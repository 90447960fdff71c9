"""Sensors by name: what kinds there are, which presets, and how to make one.

Preset values are the typical ones of the named datasheets; what those leave open is marked "typical" here. They were
entered by hand and have not been compared with a real board: treat them as the class of the device, not as one device.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hil.signals.time import period_ns_from_hz
from sim.model_file import StrictModel
from sim.scene.scene import Scene
from sim.sensors.barometer import Barometer, BarometerParameters
from sim.sensors.gps import Gps, GpsParameters
from sim.sensors.imu import Imu, ImuParameters
from sim.sensors.magnetometer import Magnetometer, MagnetometerParameters
from sim.sensors.sensor import Installation, Sensor

_G = 9.80665
_RAD_PER_DEG = 0.017453292519943295


@dataclass(frozen=True)
class Kind:
    """One kind of sensor: its class and the model of its parameters."""

    sensor: Any  # callable (Installation, parameters) -> Sensor
    parameters: type[StrictModel]


@dataclass(frozen=True)
class Preset:
    """One real device: kind, parameters, and where the numbers are from."""

    kind: str
    parameters: StrictModel
    source: str


KINDS: dict[str, Kind] = {
    "imu": Kind(Imu, ImuParameters),
    "barometer": Kind(Barometer, BarometerParameters),
    "magnetometer": Kind(Magnetometer, MagnetometerParameters),
    "gps": Kind(Gps, GpsParameters),
}

PRESETS: dict[str, Preset] = {
    "icm20689": Preset(
        "imu",
        ImuParameters(
            accel_noise_mps2_per_rthz=150e-6 * _G,  # 150 ug/rtHz
            gyro_noise_radps_per_rthz=0.006 * _RAD_PER_DEG,  # 0.006 dps/rtHz
            accel_walk_mps3_per_rthz=1.0e-4,  # typical of the class
            gyro_walk_radps2_per_rthz=4.0e-6,  # typical of the class
            # Left after the autopilot's calibration; the datasheet's raw zero-g and zero-rate offsets are larger.
            accel_turn_on_bias_mps2=0.02,
            gyro_turn_on_bias_radps=0.002,
            accel_range_mps2=16.0 * _G,  # FS_SEL 3: 2048 LSB/g, as PX4 sets it
            gyro_range_radps=2000.0 * _RAD_PER_DEG * 32768.0 / 32800.0,  # FS_SEL 3: 16.4 LSB/dps
            temperature_degc=45.0,  # self-heated board
            temperature_noise_degc=0.05,
        ),
        "TDK InvenSense DS-000143, ICM-20689",
    ),
    "ms5611": Preset(
        "barometer",
        BarometerParameters(
            noise_pa=1.2,  # 0.012 mbar RMS at OSR 4096
            drift_pa=2.0,  # weather over minutes, typical
            drift_time_constant_s=300.0,
            resolution_pa=1.0,  # the compensation arithmetic ends in whole 0.01 mbar
            temperature_degc=40.0,
            temperature_noise_degc=0.02,  # 0.002 degC resolution, noise typical
        ),
        "TE Connectivity MS5611-01BA03 datasheet",
    ),
    "ist8310": Preset(
        "magnetometer",
        MagnetometerParameters(
            noise_tesla=0.3e-6,  # typical with 16-fold averaging
            hard_iron_tesla=0.2e-6,  # left after calibration, typical
            resolution_tesla=0.3e-6,  # 0.3 uT/LSB
        ),
        "iSentek IST8310 datasheet, 3-axis magnetometer, +-1600 uT",
    ),
    "here_plus": Preset(
        "gps",
        GpsParameters(
            # RTK: 0.025 m + 1 ppm CEP. Split between what changes from fix to fix and what stays.
            horizontal_noise_m=0.01,
            vertical_noise_m=0.02,
            horizontal_drift_m=0.02,
            vertical_drift_m=0.03,
            drift_time_constant_s=60.0,
            horizontal_speed_noise_mps=0.05,  # 0.05 m/s, 50 %
            vertical_speed_noise_mps=0.08,
            horizontal_accuracy_m=0.03,
            vertical_accuracy_m=0.05,
            fix_type=6,  # RTK fixed
            satellites=16,
            latency_s=0.1,  # typical, receiver and serial line
        ),
        "u-blox NEO-M8P data sheet (Here+ RTK rover)",
    ),
    "m8n": Preset(
        "gps",
        GpsParameters(
            # Stand-alone: 2.5 m CEP is 2.1 m a horizontal axis, nearly all of it slow.
            horizontal_noise_m=0.2,
            vertical_noise_m=0.4,
            horizontal_drift_m=2.1,
            vertical_drift_m=3.5,
            drift_time_constant_s=300.0,
            horizontal_speed_noise_mps=0.05,
            vertical_speed_noise_mps=0.08,
            horizontal_accuracy_m=2.2,
            vertical_accuracy_m=3.6,
            fix_type=3,
            satellites=14,
            latency_s=0.12,
        ),
        "u-blox NEO-M8 data sheet",
    ),
}


def make_sensor(
    name: str,
    *,
    preset: str | None = None,
    kind: str | None = None,
    rate_hz: float,
    seed: int,
    scene: Scene,
    step_ns: int,
    overrides: Mapping[str, Any] | None = None,
) -> Sensor:
    """A sensor from a preset, or from a kind with all its parameters in `overrides`.

    `overrides` replace single parameters. `step_ns` is the physics tick. Raises KeyError for an unknown preset or
    kind (legal names: `sorted(PRESETS)`, `sorted(KINDS)`), ValueError for a preset of another kind,
    pydantic.ValidationError for wrong parameters.
    """
    values: dict[str, Any] = {}
    if preset is not None:
        chosen = PRESETS[preset]
        if kind is not None and kind != chosen.kind:
            raise ValueError(f"sensor '{name}': preset '{preset}' is a {chosen.kind}, not a {kind}")
        kind = chosen.kind
        values = chosen.parameters.model_dump()
    if kind is None:
        raise ValueError(f"sensor '{name}' needs a preset or a kind")
    entry = KINDS[kind]
    parameters = entry.parameters.model_validate(values | dict(overrides or {}))
    installation = Installation(name, period_ns_from_hz(rate_hz), seed, scene, step_ns)
    sensor: Sensor = entry.sensor(installation, parameters)
    return sensor
