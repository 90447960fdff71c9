"""IMU: white noise and a bias that walks, from AirSim's random walk and bias stability (sim.sensors.imu)."""

from __future__ import annotations

from math import sqrt
from typing import Any

from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.world.sensors.sensor import Measured
from signals.frames import frd_from_flu
from signals.samples import TruthState, Vec3
from signals.units import RAD_PER_DEG, STANDARD_GRAVITY_MPS2
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation


class Imu:
    """Specific force [m/s2] and rate [rad/s] along the body's axes (FRD)."""

    rate_hz = 250.0
    latency_s = 0.0

    def __init__(self, name: str, settings: kinds.Imu, measured: Measured) -> None:
        installation = Installation(
            measured.stream(name), rate_hz=self.rate_hz, seed=1, scene=measured.scene(), step_ns=measured.tick_ns
        )
        self._sensor: Any = make_sensor(installation, kind="imu", overrides=_parameters(settings))

    def sample(self, seq: int, truth: TruthState) -> tuple[Vec3, Vec3]:
        sample = self._sensor.sample(truth, seq)
        return frd_from_flu(sample.accel_mps2), frd_from_flu(sample.gyro_radps)


def _parameters(settings: kinds.Imu) -> dict[str, Any]:
    """Return parameters of sim.sensors.imu for AirSim's figures."""
    noisy = 1.0 if settings.noisy else 0.0
    degps = RAD_PER_DEG
    return {
        "accel_noise_mps2_per_rthz": noisy * settings.velocity_random_walk_mg * 1e-3 * STANDARD_GRAVITY_MPS2,
        "gyro_noise_radps_per_rthz": noisy * settings.angular_random_walk_deg_per_sqrt_h * degps / 60.0,
        "accel_walk_mps3_per_rthz": noisy
        * settings.accel_bias_ug
        * 1e-6
        * STANDARD_GRAVITY_MPS2
        / sqrt(settings.accel_bias_tau_s),
        "gyro_walk_radps2_per_rthz": noisy
        * settings.gyro_bias_deg_per_h
        * degps
        / 3600.0
        / sqrt(settings.gyro_bias_tau_s),
        "accel_turn_on_bias_mps2": 0.0,
        "gyro_turn_on_bias_radps": 0.0,
        "accel_range_mps2": 10_000.0,
        "gyro_range_radps": 1_000.0,
        "accel_bits": 32,
        "gyro_bits": 32,
        "temperature_degc": 25.0,
        "temperature_noise_degc": 0.0,
    }
