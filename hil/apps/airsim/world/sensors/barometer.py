"""Barometer: p = p_ISA(h) (1 + d) + n, with d first-order with sigma and tau, 0 at the start."""

from __future__ import annotations

from math import sqrt

from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.world.sensors.sensor import Measured
from signals._kernel import det_exp, det_pow
from signals.noise import NoiseStream
from signals.samples import TruthState
from sim.scene.atmosphere import LOWEST_M, SEA_LEVEL_PA, TOP_M, geopotential_m, pressure_pa
from sim.sensors.drift import Drift

_QNH_HPA = 1013.25


class Barometer:
    """Altitude [m], pressure [Pa] and QNH [hPa]."""

    def __init__(self, name: str, settings: kinds.Barometer, measured: Measured) -> None:
        self.rate_hz, self.latency_s = settings.rate_hz, settings.latency_s
        self._altitude_m, self._noise_pa = measured.altitude_m, settings.noise_pa
        stream = measured.stream(name)
        phi = det_exp(-1.0 / (settings.rate_hz * settings.pressure_factor_tau_s))
        step = settings.pressure_factor_sigma * sqrt(1.0 - phi * phi)
        self._drift = Drift(1, f"{stream}.drift", lanes=1, start=0.0, phi=phi, step=step)
        self._noise = NoiseStream(1, stream, lanes=1)

    def sample(self, seq: int, truth: TruthState) -> tuple[float, float, float]:
        height_m = min(max(geopotential_m(self._altitude_m(truth.p_WB)), LOWEST_M), TOP_M)
        pressure = pressure_pa(height_m) * (1.0 + self._drift.at(seq)[0]) + self._noise_pa * self._noise.normal(seq)[0]
        # AirSim's altitude of a pressure, that of the US standard atmosphere in feet.
        altitude = (1.0 - det_pow(pressure / SEA_LEVEL_PA, 0.190284)) * 145366.45 * 0.3048
        return altitude, pressure, _QNH_HPA
