"""Magnetometer: Earth's field in B, with a constant hard-iron offset and noise.

m = R_WB^T B_W + b + n,   rounded to the resolution, saturated at 16 bits
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hil.signals.noise import NoiseStream
from hil.signals.samples import MagSample, TruthState
from hil.signals.time import NS_PER_S
from sim._kernels import rotate_into_body
from sim.model_file import StrictModel
from sim.scene.magnetic_field import magnetic_field_W_tesla
from sim.sensors.imu import quantise
from sim.sensors.sensor import Installation


class MagnetometerParameters(StrictModel):
    """Errors of one magnetometer [T]."""

    noise_tesla: Annotated[float, Field(ge=0.0, le=1e-3)]
    hard_iron_tesla: Annotated[float, Field(ge=0.0, le=1e-3)]  # 1 sigma a axis, drawn once
    resolution_tesla: Annotated[float, Field(gt=0.0, le=1e-3)]
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Magnetometer:
    """Magnetic field at the body origin."""

    sample_type = MagSample

    def __init__(self, installation: Installation, parameters: MagnetometerParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        self.name = name
        self.period_ns = installation.period_ns
        self.latency_ns = round(p.latency_s * NS_PER_S)
        self._field_W = magnetic_field_W_tesla(installation.scene.site)
        self._white = NoiseStream(seed, f"{name}.white", lanes=3)
        x, y, z = NoiseStream(seed, f"{name}.hard_iron", lanes=3).normal(0)
        self._offset = (p.hard_iron_tesla * x, p.hard_iron_tesla * y, p.hard_iron_tesla * z)
        self._sigma = p.noise_tesla
        self._lsb = p.resolution_tesla

    def sample(self, truth: TruthState, seq: int) -> MagSample:
        """Sample `seq`."""
        t_ns, sigma, lsb, b = truth.t_ns, self._sigma, self._lsb, self._offset
        x, y, z = rotate_into_body(truth.q_WB, self._field_W)
        n = self._white.normal(seq)
        return MagSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            (
                quantise(x + b[0] + sigma * n[0], lsb),
                quantise(y + b[1] + sigma * n[1], lsb),
                quantise(z + b[2] + sigma * n[2], lsb),
            ),
        )
