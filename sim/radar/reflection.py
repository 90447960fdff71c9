"""Backscatter of surfaces by incidence, roughness and electrical properties.

sigma0(theta) is the sum of a Kirchhoff lobe, with the power that roughness leaves coherent, and a Lambertian part with
the rest. Both use Fresnel's reflectance (equations: sim/native/radar/reflection.hpp) at the complex permittivity

    eps = eps_r - j sigma / (omega eps_0)

at the carrier frequency. Reflectance is the mean of both polarisations, because surfaces have any orientation to the
wave.

The lobe of a flat wall has, for any slope of its facets, the power of the radar's mirror image behind the wall,
(lambda / (4 pi 2 R))^2 |Gamma|^2. A Lambertian sphere of radius r and albedo a = (1 - rho^2) |Gamma|^2 has the
cross-section (8/3) a pi r^2 (tests/reference/test_radar_equation.py).

The amplitude of a pixel needs sqrt(sigma0(c) / c) with c = cos(theta), which is tabulated for each surface over
sqrt(c). The table's error of sigma0 is below 0.01 dB for c >= 0.001; for c = 0 the table gives 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.units import TURN_RAD
from sim._kernels import RADAR_CURVE_STEPS, radar_amplitude_curve, radar_backscatter, radar_fresnel_power
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.scene.scene_map import Surface

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

VACUUM_PERMITTIVITY_F_PER_M = 8.8541878128e-12


class Reflection(StrictModel):
    """Parameters of the reflection model besides those of the surfaces."""

    # rms slope of a surface's facets (undulations far larger than the wavelength). It sets the width of the lobe, not
    # its power. 0.1 (5.7 degrees) is an assumption for walls, roads and sheet metal, not a measurement.
    facet_slope: Annotated[float, Field(ge=0.07, le=1.0)] = 0.1

    def backscatter(self, surface: Surface, carrier_hz: float, cosine: Float64) -> Float64:
        """Return sigma0 at cosines of incidence, (n,)."""
        sigma0 = np.empty(len(cosine))
        radar_backscatter(
            *at_carrier(surface, carrier_hz), self.facet_slope, np.ascontiguousarray(cosine, np.float64), sigma0
        )
        return sigma0

    def curves(self, surfaces: Sequence[Surface], carrier_hz: float) -> Float32:
        """Return the kernel's tables, (surfaces, RADAR_CURVE_STEPS + 1); surface 0 is not a surface."""
        curves = np.zeros((len(surfaces), RADAR_CURVE_STEPS + 1), np.float32)
        for surface, curve in zip(surfaces[1:], curves[1:], strict=True):
            radar_amplitude_curve(*at_carrier(surface, carrier_hz), self.facet_slope, curve)
        return curves


def reflectance(surface: Surface, carrier_hz: float, cosine: float) -> float:
    """Return |Gamma|^2 of the smooth surface, the mean of both polarisations."""
    eps_r, eps_i, _ = at_carrier(surface, carrier_hz)
    return radar_fresnel_power(eps_r, eps_i, cosine)


def at_carrier(surface: Surface, carrier_hz: float) -> tuple[float, float, float]:
    """Return the real part of eps, minus its imaginary part, and 4 pi h / lambda with the roughness h."""
    loss = surface.conductivity_s_per_m / (TURN_RAD * carrier_hz * VACUUM_PERMITTIVITY_F_PER_M)
    phase_height = 2.0 * TURN_RAD * surface.roughness_m * carrier_hz / SPEED_OF_LIGHT_MPS
    return surface.relative_permittivity, loss, phase_height
