"""Magnetometer: s R^T B + b + n, with B of WMM2025 and b drawn once from +-NoiseBias for each axis."""

from __future__ import annotations

from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.world.ned import body_from_W
from hil.apps.airsim.world.sensors.sensor import Measured
from signals.noise import NoiseStream
from signals.samples import TruthState, Vec3
from sim.sensors.magnetometer import magnetic_field_W_tesla

_GAUSS_PER_TESLA = 1e4


class Magnetometer:
    """Field along the body's axes (FRD) [Gauss]."""

    def __init__(self, name: str, settings: kinds.Magnetometer, measured: Measured) -> None:
        self.rate_hz, self.latency_s = settings.rate_hz, settings.latency_s
        self._settings = settings
        self._field_W = magnetic_field_W_tesla(measured.site)
        stream = measured.stream(name)
        self._noise = NoiseStream(1, stream, lanes=3)
        drawn = NoiseStream(1, f"{stream}.bias", lanes=3).uniform_block(0).ravel()[:3].tolist()
        self._bias = [settings.bias_gauss * (2.0 * u - 1.0) for u in drawn]

    def sample(self, seq: int, truth: TruthState) -> Vec3:
        field, noise = body_from_W(truth.q_WB, self._field_W), self._noise.normal(seq)
        gain, sigma = self._settings.scale_factor * _GAUSS_PER_TESLA, self._settings.noise_gauss
        x, y, z = (gain * f + b + sigma * n for f, b, n in zip(field, self._bias, noise, strict=True))
        return x, y, z
