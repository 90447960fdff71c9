"""Barometer: pressure of the standard atmosphere at the vehicle's height, with errors of sensor and installation.

    p = p_ISA(h) + drift + prop wash + flow + n,   rounded to the resolution
    altitude = altitude of the standard atmosphere at p     (pressure altitude: geopotential)

with h the geopotential height of the vehicle, up to 20 km.

    prop wash   T (p_free + p_ground e^{-z / h_g})      T = mean (rotor speed / reference)^2, the thrust ratio
    flow        sum_i c_i rho/2 u_i |u_i|, i = x, y     u air velocity past the body in B

Prop wash changes the pressure around the sensor. Above the rotors there is suction (p_free < 0: the altitude reads too
high). Under them near the ground there is a cushion (p_ground > 0: the altitude reads too low, the dip at take-off that
autopilots allow for). The flow term is the position error of the static port, which ArduPilot corrects with
BARO1_WCF_*. Both terms are first-order models, with coefficients to be measured on the vehicle; z is the height over
the ground plane, the wind is the scene's steady wind.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from signals._kernel import det_exp, rotate_into_body
from signals.documents.validate import StrictModel
from signals.errors import ModelRangeError
from signals.noise import NoiseStream
from signals.samples import BaroSample, TruthState
from sim.scene.atmosphere import LOWEST_M, TOP_M, geopotential_m, pressure_altitude_m, pressure_pa
from sim.sensors.drift import gauss_markov
from sim.sensors.rotor_load import thrust_ratio
from sim.sensors.rounding import drawn_sigma, noise_with_rounding, rounded
from sim.sensors.sensor import Installation, InstalledSensor, Kind

_AIR_DENSITY_KGPM3 = 1.225  # ISA at sea level
_ATMOSPHERE = f"{LOWEST_M:g} to {TOP_M:g} m, the range of the standard atmosphere of barometers"

Coefficient = Annotated[float, Field(ge=-2.0, le=2.0)]
WashPressure = Annotated[float, Field(ge=-500.0, le=500.0)]


class BarometerParameters(StrictModel):
    """Errors of one barometer. The noise includes the rounding (sim/sensors/rounding.py)."""

    noise_pa: Annotated[float, Field(ge=0.0, le=1000.0)]
    drift_pa: Annotated[float, Field(ge=0.0, le=5000.0)]  # 1 sigma
    drift_time_constant_s: Annotated[float, Field(gt=0.0, le=1e6)]
    resolution_pa: Annotated[float, Field(gt=0.0, le=100.0)]
    temperature_degc: Annotated[float, Field(ge=-40.0, le=125.0)]
    temperature_noise_degc: Annotated[float, Field(ge=0.0, le=10.0)]
    wash_free_pa: WashPressure = 0.0  # at the reference rotor speed
    wash_ground_pa: WashPressure = 0.0
    wash_ground_height_m: Annotated[float, Field(gt=0.0, le=10.0)] = 0.5
    wash_reference_radps: Annotated[float, Field(gt=0.0, le=1e5)] = 1000.0
    flow_coefficient: tuple[Coefficient, Coefficient] = (
        0.0,
        0.0,
    )  # along x and y of B, as shares of the dynamic pressure
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Barometer(InstalledSensor):
    """Static pressure at the body origin."""

    sample_type = BaroSample

    def __init__(self, installation: Installation, parameters: BarometerParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        super().__init__(installation, p.latency_s, {"pressure_pa": p.resolution_pa, "temperature_degc": 0.01})
        self._p = p
        self._sigma_pa = drawn_sigma(p.noise_pa, p.resolution_pa)
        self.deviations = {
            "pressure_pa": noise_with_rounding(self._sigma_pa, p.resolution_pa),
            "temperature_degc": p.temperature_noise_degc,
        }
        self._site_altitude_m = installation.scene.site.altitude_m
        self._wind_W = installation.scene.wind_W_mps
        self._washes = p.wash_free_pa != 0.0 or p.wash_ground_pa != 0.0
        self._flows = p.flow_coefficient != (0.0, 0.0)
        self._white = NoiseStream(seed, f"{name}.white", lanes=2)  # pressure, temperature
        self._drift = gauss_markov(installation, lanes=1, sigma=p.drift_pa, time_constant_s=p.drift_time_constant_s)

    def sample(self, truth: TruthState, seq: int) -> BaroSample:
        """Return sample `seq`. Height in W is taken as height over the site (Earth's curvature: 8 cm at 1 km).

        Raises ModelRangeError outside the range of the standard atmosphere.
        """
        t_ns, p = truth.t_ns, self._p
        n = self._white.normal(seq)
        height_m = geopotential_m(self._site_altitude_m + truth.p_WB[2])
        if not LOWEST_M <= height_m <= TOP_M:
            raise ModelRangeError(truth.tick, f"{self.name}: altitude_m", height_m, _ATMOSPHERE)
        pressure = pressure_pa(height_m)
        pressure += self._drift.at(seq)[0] + self._sigma_pa * n[0]
        if self._washes:
            pressure += self._wash_pa(truth)
        if self._flows:
            pressure += self._flow_pa(truth)
        pressure = rounded(pressure, p.resolution_pa)
        return BaroSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            pressure,
            pressure_altitude_m(pressure),
            p.temperature_degc + p.temperature_noise_degc * n[1],
        )

    def _wash_pa(self, truth: TruthState) -> float:
        p = self._p
        near = det_exp(-max(truth.p_WB[2], 0.0) / p.wash_ground_height_m)
        return thrust_ratio(truth.rotor_speed_radps, p.wash_reference_radps) * (
            p.wash_free_pa + p.wash_ground_pa * near
        )

    def _flow_pa(self, truth: TruthState) -> float:
        (vx, vy, vz), (wx, wy, wz) = truth.v_WB_W, self._wind_W
        ux, uy, _ = rotate_into_body(truth.q_WB, (vx - wx, vy - wy, vz - wz))
        cx, cy = self._p.flow_coefficient
        return 0.5 * _AIR_DENSITY_KGPM3 * (cx * ux * abs(ux) + cy * uy * abs(uy))


KIND = Kind(Barometer, BarometerParameters)
