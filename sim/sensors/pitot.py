"""Pitot-static tube with its differential pressure sensor.

u is the velocity of the tube's place through the air (sim/sensors/relative_wind.py), chi the angle between u and the
tube's axis a, p and rho the pressure and density of the air at the vehicle's height:

    u_e = |u|                     cos chi >= cos chi_0      within the tube's insensitive range chi_0
        = |u| cos chi / cos chi_0 otherwise                 chi_0 = 0: the component along the tube, a . u
    q   = p ((1 + M^2 / 5)^3.5 - 1),  M^2 = rho u_e^2 / (1.4 p)        impact pressure, with the sign of u_e
    e   = (c_0 + c_a alpha^2 + c_b beta^2) q                position error of the static port: it reads too high by e
    dp  = (p + q) - (p + e) = q - e
    out = round(dp (1 + s) + zero + drift + n),  saturated at the sensor's range

(isentropic flow: Anderson, Fundamentals of Aerodynamics, 5th ed., eq. 8.74; below 50 m/s q is rho u_e^2 / 2 within
0.6 %.) alpha and beta are the angles of u in the frame of the tube. A tube that is blown on from behind reads the
negative of q: a first approximation, its real suction depends on its shape. s and zero are drawn once: zero is what
remains after the autopilot's own zeroing.

Blockage (fault `blocked`). The lines behind the two ports hold air. With o the open share of a port, 1 to 0 within
`closing_s` (ice), and l the conductance of a drain hole or a leak to the static pressure over that of the open port:

    total line    dP/dt = (o (p_t - P) + l (p_s - P)) / tau          p_t = p + q,  p_s = p + e
    static line   dS/dt = (o + l) (p_s - S) / tau
    dp = P - S

solved for a sample with o, p_t and p_s constant since the one before. Without a leak a closed total port traps its
pressure, and the airspeed read then rises and falls with the height, as an altimeter; with a drain it decays to zero.
A closed static port reads too little in a climb. Both closed: the reading stays.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from signals._kernel import det_atan2, det_cos, det_pow
from signals.documents.validate import StrictModel
from signals.errors import ModelRangeError
from signals.noise import NoiseStream
from signals.rotation import applied_back, matrix_of
from signals.samples import DifferentialPressureSample, TruthState
from signals.time import NS_PER_S
from signals.units import RAD_PER_DEG
from sim.frame.mount import quaternion_of_rpy
from sim.scene.atmosphere import LOWEST_M, TOP_M, ZERO_DEGC_K, density_kgpm3, geopotential_m, pressure_pa, temperature_k
from sim.sensors.blockage import Blockage
from sim.sensors.drift import gauss_markov
from sim.sensors.relative_wind import airspeed_B_mps, wind_source
from sim.sensors.rounding import drawn_sigma, noise_with_rounding, saturated
from sim.sensors.sensor import Attitude, Installation, InstalledSensor, Kind, Position

_GAMMA = 1.4
_ATMOSPHERE = f"{LOWEST_M:g} to {TOP_M:g} m, the range of the standard atmosphere"

Share = Annotated[float, Field(ge=-2.0, le=2.0)]  # of the impact pressure
PerRad2 = Annotated[float, Field(ge=-20.0, le=20.0)]


class PitotParameters(StrictModel):
    """Errors of tube and sensor, deviations 1 sigma. The noise includes the rounding (sim/sensors/rounding.py)."""

    range_pa: Annotated[float, Field(gt=0.0, le=1e6)]  # the output saturates at -range and +range
    resolution_pa: Annotated[float, Field(gt=0.0, le=100.0)]
    noise_pa: Annotated[float, Field(ge=0.0, le=1000.0)]
    zero_error_pa: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    scale_error: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    drift_pa: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    drift_time_constant_s: Annotated[float, Field(gt=0.0, le=1e6)] = 300.0
    insensitive_deg: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0
    static_error: Share = 0.0
    static_error_per_rad2: tuple[PerRad2, PerRad2] = (0.0, 0.0)  # by angle of attack, by sideslip
    warmer_degc: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0  # the sensor's temperature over that of the air
    mount_m: Position = (0.0, 0.0, 0.0)  # of the tube's tip, from the body origin, in B
    mount_rpy_deg: Attitude = (0.0, 0.0, 0.0)  # (0, 0, 0) points forward (sim/frame/mount.py)
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Pitot(InstalledSensor):
    """Differential pressure of a pitot-static tube."""

    sample_type = DifferentialPressureSample

    def __init__(self, installation: Installation, parameters: PitotParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        super().__init__(
            installation, p.latency_s, {"differential_pressure_pa": p.resolution_pa, "temperature_degc": 0.01}
        )
        self._p = p
        self._sigma_pa = drawn_sigma(p.noise_pa, p.resolution_pa)
        self.deviations = {"differential_pressure_pa": noise_with_rounding(self._sigma_pa, p.resolution_pa)}
        site = installation.scene.site
        self._site_altitude_m, self._warmer_k = site.altitude_m, site.warmer_k
        self._wind_at = wind_source(installation)
        self._R_BT = matrix_of(quaternion_of_rpy(p.mount_rpy_deg))  # tube to body
        self._cos_insensitive = det_cos(p.insensitive_deg * RAD_PER_DEG)
        self._white = NoiseStream(seed, f"{name}.white")
        self._scale = 1.0 + p.scale_error * NoiseStream(seed, f"{name}.scale").normal(0)[0]
        self._zero_pa = p.zero_error_pa * NoiseStream(seed, f"{name}.zero").normal(0)[0]
        self._drift = gauss_markov(installation, lanes=1, sigma=p.drift_pa, time_constant_s=p.drift_time_constant_s)
        self.blockage = Blockage()

    def sample(self, truth: TruthState, seq: int) -> DifferentialPressureSample:
        """Return sample `seq`. Raises ModelRangeError outside the range of the standard atmosphere."""
        p, t_ns = self._p, truth.t_ns
        altitude_m = self._site_altitude_m + truth.p_WB[2]
        height_m = geopotential_m(altitude_m)
        if not LOWEST_M <= height_m <= TOP_M:
            raise ModelRangeError(truth.tick, f"{self.name}: altitude_m", height_m, _ATMOSPHERE)
        air_pa = pressure_pa(height_m)
        impact_pa, error_pa = self._pressures(truth, air_pa, density_kgpm3(altitude_m, self._warmer_k))
        true_pa = self.blockage.difference(air_pa + impact_pa, air_pa + error_pa, t_ns / NS_PER_S)
        value = true_pa * self._scale + self._zero_pa + self._drift.at(seq)[0]
        value += self._sigma_pa * self._white.normal(seq)[0]
        air_degc = temperature_k(height_m) + self._warmer_k - ZERO_DEGC_K
        return DifferentialPressureSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            saturated(value, p.resolution_pa, p.range_pa),
            air_degc + p.warmer_degc,
        )

    def _pressures(self, truth: TruthState, air_pa: float, density: float) -> tuple[float, float]:
        """Return impact pressure and error of the static port [Pa]."""
        p = self._p
        u_B = airspeed_B_mps(truth, self._wind_at(), p.mount_m)
        ux, uy, uz = applied_back(self._R_BT, u_B)
        speed = math.sqrt(ux * ux + uy * uy + uz * uz)
        if speed == 0.0:
            return 0.0, 0.0
        u = speed if ux >= speed * self._cos_insensitive else ux / self._cos_insensitive
        mach2 = density * u * u / (_GAMMA * air_pa)
        impact = math.copysign(air_pa * (det_pow(1.0 + 0.2 * mach2, 3.5) - 1.0), u)
        by_alpha, by_beta = p.static_error_per_rad2
        share = p.static_error
        if by_alpha != 0.0 or by_beta != 0.0:
            alpha, beta = det_atan2(-uz, ux), det_atan2(-uy, ux)
            share += by_alpha * alpha * alpha + by_beta * beta * beta
        return impact, share * impact


KIND = Kind(Pitot, PitotParameters)
