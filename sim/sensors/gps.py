"""GNSS receiver: geodetic position and velocity with white and time-correlated errors.

    p = p_WB + c + n_p,  v = v_WB_W + n_v     in W, then to WGS-84

c is a first-order Gauss-Markov process (orbit, clock, troposphere, multipath: errors that stay for a while), n white.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hil.signals.noise import NoiseStream
from hil.signals.samples import GpsSample, TruthState
from hil.signals.time import NS_PER_S
from sim.model_file import StrictModel
from sim.scene.geodesy import LocalFrame
from sim.sensors.drift import gauss_markov
from sim.sensors.sensor import Installation

Deviation = Annotated[float, Field(ge=0.0, le=1000.0)]


class GpsParameters(StrictModel):
    """Errors of one receiver, 1 sigma a horizontal axis or vertical; the accuracies are what it says of itself."""

    horizontal_noise_m: Deviation
    vertical_noise_m: Deviation
    horizontal_drift_m: Deviation
    vertical_drift_m: Deviation
    drift_time_constant_s: Annotated[float, Field(gt=0.0, le=1e6)]
    horizontal_speed_noise_mps: Deviation
    vertical_speed_noise_mps: Deviation
    horizontal_accuracy_m: Deviation
    vertical_accuracy_m: Deviation
    fix_type: Annotated[int, Field(ge=0, le=8)]  # MAVLink GPS_FIX_TYPE
    satellites: Annotated[int, Field(ge=0, le=64)]
    latency_s: Annotated[float, Field(ge=0.0, le=2.0)]


class Gps:
    """Fixes of the body origin."""

    sample_type = GpsSample

    def __init__(self, installation: Installation, parameters: GpsParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        self.name = name
        self.period_ns = installation.period_ns
        self.latency_ns = round(p.latency_s * NS_PER_S)
        self._p = p
        self._frame = LocalFrame(installation.scene.site)
        self._white = NoiseStream(seed, f"{name}.white", lanes=6)  # position, velocity
        self._drift = gauss_markov(
            seed,
            f"{name}.drift",
            lanes=3,
            sigma=1.0,
            time_constant_s=p.drift_time_constant_s,
            period_s=installation.period_ns / NS_PER_S,
        )

    def sample(self, truth: TruthState, seq: int) -> GpsSample:
        """Sample `seq`."""
        t_ns, p = truth.t_ns, self._p
        n, c = self._white.normal(seq), self._drift.at(seq)
        x, y, z = truth.p_WB
        vx, vy, vz = truth.v_WB_W
        latitude_deg, longitude_deg, altitude_m = self._frame.geodetic_from_enu(
            (
                x + p.horizontal_drift_m * c[0] + p.horizontal_noise_m * n[0],
                y + p.horizontal_drift_m * c[1] + p.horizontal_noise_m * n[1],
                z + p.vertical_drift_m * c[2] + p.vertical_noise_m * n[2],
            )
        )
        return GpsSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            latitude_deg,
            longitude_deg,
            altitude_m,
            (
                vx + p.horizontal_speed_noise_mps * n[3],
                vy + p.horizontal_speed_noise_mps * n[4],
                vz + p.vertical_speed_noise_mps * n[5],
            ),
            p.horizontal_accuracy_m,
            p.vertical_accuracy_m,
            p.fix_type,
            p.satellites,
        )
