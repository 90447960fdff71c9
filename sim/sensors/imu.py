"""Strapdown inertial measurement unit.

    f = R_WB^T (a - g) + b_a + n_a        specific force in B [m/s2]
    w = w_WB_B + b_g + n_g                angular rate in B [rad/s]

a and w are means over the physics step just taken, turned into B at mid-step (`ideal_imu` in
sim/native/rigid_body.hpp says why): what an integrating IMU with that output interval delivers. White noise of density
D sampled at rate F has deviation D sqrt(F); biases are a turn-on value and a random walk; the output saturates at
the range and is rounded to the 16-bit step.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from hil.signals.noise import NoiseStream
from hil.signals.samples import ImuSample, TruthState
from hil.signals.time import NS_PER_S
from sim._kernels import ideal_imu
from sim.model_file import StrictModel
from sim.sensors.drift import random_walk
from sim.sensors.sensor import Installation

_FULL_SCALE = 32768.0


class ImuParameters(StrictModel):
    """Errors of one IMU, SI units. Densities are one-sided, per square root of hertz."""

    accel_noise_mps2_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    gyro_noise_radps_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    accel_walk_mps3_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    gyro_walk_radps2_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    accel_turn_on_bias_mps2: Annotated[float, Field(ge=0.0, le=5.0)]  # 1 sigma
    gyro_turn_on_bias_radps: Annotated[float, Field(ge=0.0, le=1.0)]  # 1 sigma
    accel_range_mps2: Annotated[float, Field(gt=0.0, le=10_000.0)]
    gyro_range_radps: Annotated[float, Field(gt=0.0, le=1_000.0)]
    temperature_degc: Annotated[float, Field(ge=-40.0, le=125.0)]
    temperature_noise_degc: Annotated[float, Field(ge=0.0, le=10.0)]
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Imu:
    """Averages over one physics tick, whatever its own rate."""

    sample_type = ImuSample

    def __init__(self, installation: Installation, parameters: ImuParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        period_s = installation.period_ns / NS_PER_S
        self.name = name
        self.period_ns = installation.period_ns
        self.latency_ns = round(p.latency_s * NS_PER_S)
        self._step_s = installation.step_ns / NS_PER_S
        self._gravity = installation.scene.gravity_mps2
        self._white = NoiseStream(seed, f"{name}.white", lanes=7)  # accel, gyro, temperature
        self._accel_bias = random_walk(
            seed,
            f"{name}.accel_bias",
            lanes=3,
            turn_on_sigma=p.accel_turn_on_bias_mps2,
            density=p.accel_walk_mps3_per_rthz,
            period_s=period_s,
        )
        self._gyro_bias = random_walk(
            seed,
            f"{name}.gyro_bias",
            lanes=3,
            turn_on_sigma=p.gyro_turn_on_bias_radps,
            density=p.gyro_walk_radps2_per_rthz,
            period_s=period_s,
        )
        self._accel_sigma = p.accel_noise_mps2_per_rthz / math.sqrt(period_s)
        self._gyro_sigma = p.gyro_noise_radps_per_rthz / math.sqrt(period_s)
        self._accel_lsb = p.accel_range_mps2 / _FULL_SCALE
        self._gyro_lsb = p.gyro_range_radps / _FULL_SCALE
        self._temperature_degc = p.temperature_degc
        self._temperature_sigma = p.temperature_noise_degc

    def sample(self, truth: TruthState, seq: int) -> ImuSample:
        """Sample `seq`. Specific force at rest, level: (0, 0, +g)."""
        t_ns = truth.t_ns
        fx, fy, fz, wx, wy, wz = ideal_imu(
            truth.q_WB, truth.a_WB_W, truth.w_WB_B, truth.alpha_WB_B, self._step_s, self._gravity
        )
        n = self._white.normal(seq)
        ba, bg = self._accel_bias.at(seq), self._gyro_bias.at(seq)
        sa, sg = self._accel_sigma, self._gyro_sigma
        la, lg = self._accel_lsb, self._gyro_lsb
        return ImuSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            (
                quantise(fx + ba[0] + sa * n[0], la),
                quantise(fy + ba[1] + sa * n[1], la),
                quantise(fz + ba[2] + sa * n[2], la),
            ),
            (
                quantise(wx + bg[0] + sg * n[3], lg),
                quantise(wy + bg[1] + sg * n[4], lg),
                quantise(wz + bg[2] + sg * n[5], lg),
            ),
            self._temperature_degc + self._temperature_sigma * n[6],
        )


def quantise(value: float, lsb: float) -> float:
    """Nearest multiple of `lsb` that a signed 16-bit word can hold."""
    counts = math.floor(value / lsb + 0.5)
    if counts > 32767:
        counts = 32767
    elif counts < -32768:
        counts = -32768
    return counts * lsb
