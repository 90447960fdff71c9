"""Magnetometer: Earth's field in B, disturbed by the vehicle's iron and currents, with noise.

    m = S R_WB^T B_W + b + I c + n,   rounded to the resolution, saturated at the range

S is soft iron (identity + a random symmetric matrix), b hard iron (random), c the field of the battery leads at the
reference rotor speed, and I the battery current relative to the current at that speed: mean (rotor speed /
reference)^3, because shaft power grows with the cube of speed and the battery's voltage is taken as constant.
"""

from __future__ import annotations

from typing import Annotated

import pygeomag
from pydantic import Field

from signals._kernel import rotate_into_body
from signals.documents.validate import StrictModel
from signals.noise import NoiseStream
from signals.samples import MagSample, TruthState, Vec3
from sim.scene.scene import Site
from sim.sensors.rotor_load import power_ratio
from sim.sensors.rounding import drawn_sigma, noise_with_rounding, saturated
from sim.sensors.sensor import Installation, InstalledSensor, Kind

# Fixed, so that a run repeats in later years although the field turns by about 0.2 degrees a year at mid latitudes.
EPOCH_YEAR = 2026.0

_TESLA_PER_NANOTESLA = 1e-9


def magnetic_field_W_tesla(site: Site) -> Vec3:
    """Return the field at `site` in W (ENU) [T], by WMM2025 at `EPOCH_YEAR`.

    The field is rounded to 1e-12 T, 100,000 times finer than the model's error, because pygeomag uses the C library's
    sin and cos, whose last bit depends on the CPU. It is constant over a scene: it changes by about 1e-8 T per km.
    """
    field = pygeomag.GeoMag().calculate(
        glat=site.latitude_deg, glon=site.longitude_deg, alt=site.altitude_m / 1000.0, time=EPOCH_YEAR
    )
    north, east, down = float(field.x), float(field.y), float(field.z)  # nT
    return (
        round(east * _TESLA_PER_NANOTESLA, 12),
        round(north * _TESLA_PER_NANOTESLA, 12),
        round(-down * _TESLA_PER_NANOTESLA, 12),
    )


Field_T = Annotated[float, Field(ge=-1e-3, le=1e-3)]


class MagnetometerParameters(StrictModel):
    """Errors of one magnetometer [T]. The noise includes the rounding (sim/sensors/rounding.py)."""

    noise_tesla: Annotated[float, Field(ge=0.0, le=1e-3)]
    hard_iron_tesla: Annotated[float, Field(ge=0.0, le=1e-3)]  # 1 sigma per axis, drawn once
    soft_iron: Annotated[float, Field(ge=0.0, le=0.3)] = 0.0  # 1 sigma of each of the six elements, drawn once
    motor_field_tesla: tuple[Field_T, Field_T, Field_T] = (0.0, 0.0, 0.0)  # in B, at the reference rotor speed
    motor_reference_radps: Annotated[float, Field(gt=0.0, le=1e5)] = 1000.0
    resolution_tesla: Annotated[float, Field(gt=0.0, le=1e-3)]
    range_tesla: Annotated[float, Field(gt=0.0, le=1.0)] = 1.6e-3
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Magnetometer(InstalledSensor):
    """Magnetic field at the body origin."""

    sample_type = MagSample

    def __init__(self, installation: Installation, parameters: MagnetometerParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        super().__init__(installation, p.latency_s, {"field_tesla": p.resolution_tesla})
        self._field_W = magnetic_field_W_tesla(installation.scene.site)
        self._white = NoiseStream(seed, f"{name}.white", lanes=3)
        x, y, z = NoiseStream(seed, f"{name}.hard_iron", lanes=3).normal(0)
        self.hard_iron_tesla = (p.hard_iron_tesla * x, p.hard_iron_tesla * y, p.hard_iron_tesla * z)
        xx, yy, zz, xy, xz, yz = [p.soft_iron * n for n in NoiseStream(seed, f"{name}.soft_iron", lanes=6).normal(0)]
        self.soft_iron = ((1.0 + xx, xy, xz), (xy, 1.0 + yy, yz), (xz, yz, 1.0 + zz))
        self._motor, self._motor_reference = p.motor_field_tesla, p.motor_reference_radps
        self._has_motor_field = any(p.motor_field_tesla)
        self._sigma = drawn_sigma(p.noise_tesla, p.resolution_tesla)
        self.deviations = {"field_tesla": noise_with_rounding(self._sigma, p.resolution_tesla)}
        self._lsb, self._range = p.resolution_tesla, p.range_tesla

    def sample(self, truth: TruthState, seq: int) -> MagSample:
        """Return sample `seq`."""
        t_ns, sigma, lsb, limit, b = truth.t_ns, self._sigma, self._lsb, self._range, self.hard_iron_tesla
        x, y, z = rotate_into_body(truth.q_WB, self._field_W)
        (sxx, sxy, sxz), (syx, syy, syz), (szx, szy, szz) = self.soft_iron
        n = self._white.normal(seq)
        current = power_ratio(truth.rotor_speed_radps, self._motor_reference) if self._has_motor_field else 0.0
        cx, cy, cz = self._motor
        return MagSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            (
                saturated(sxx * x + sxy * y + sxz * z + b[0] + current * cx + sigma * n[0], lsb, limit),
                saturated(syx * x + syy * y + syz * z + b[1] + current * cy + sigma * n[1], lsb, limit),
                saturated(szx * x + szy * y + szz * z + b[2] + current * cz + sigma * n[2], lsb, limit),
            ),
        )


KIND = Kind(Magnetometer, MagnetometerParameters)
