"""Barometer: pressure of the standard atmosphere at the vehicle's height, with noise and a slow drift.

p = p_ISA(h) + drift + n,   rounded to the resolution;   altitude = the standard atmosphere's at p
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from hil.signals.noise import NoiseStream
from hil.signals.samples import BaroSample, TruthState
from hil.signals.time import NS_PER_S
from sim.model_file import StrictModel
from sim.scene.atmosphere import pressure_altitude_m, pressure_pa
from sim.sensors.drift import gauss_markov
from sim.sensors.sensor import Installation


class BarometerParameters(StrictModel):
    """Errors of one barometer."""

    noise_pa: Annotated[float, Field(ge=0.0, le=1000.0)]
    drift_pa: Annotated[float, Field(ge=0.0, le=5000.0)]  # 1 sigma
    drift_time_constant_s: Annotated[float, Field(gt=0.0, le=1e6)]
    resolution_pa: Annotated[float, Field(gt=0.0, le=100.0)]
    temperature_degc: Annotated[float, Field(ge=-40.0, le=125.0)]
    temperature_noise_degc: Annotated[float, Field(ge=0.0, le=10.0)]
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Barometer:
    """Static pressure at the body origin."""

    sample_type = BaroSample

    def __init__(self, installation: Installation, parameters: BarometerParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        self.name = name
        self.period_ns = installation.period_ns
        self.latency_ns = round(p.latency_s * NS_PER_S)
        self._p = p
        self._site_altitude_m = installation.scene.site.altitude_m
        self._white = NoiseStream(seed, f"{name}.white", lanes=2)  # pressure, temperature
        self._drift = gauss_markov(
            seed,
            f"{name}.drift",
            lanes=1,
            sigma=p.drift_pa,
            time_constant_s=p.drift_time_constant_s,
            period_s=installation.period_ns / NS_PER_S,
        )

    def sample(self, truth: TruthState, seq: int) -> BaroSample:
        """Sample `seq`. Height in W is taken as height over the site (Earth's curvature: 8 cm at 1 km)."""
        t_ns, p = truth.t_ns, self._p
        n = self._white.normal(seq)
        pressure = pressure_pa(self._site_altitude_m + truth.p_WB[2])
        pressure += self._drift.at(seq)[0] + p.noise_pa * n[0]
        pressure = math.floor(pressure / p.resolution_pa + 0.5) * p.resolution_pa
        return BaroSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            pressure,
            pressure_altitude_m(pressure),
            p.temperature_degc + p.temperature_noise_degc * n[1],
        )
