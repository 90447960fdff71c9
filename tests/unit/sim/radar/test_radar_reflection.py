"""Reflection of surfaces against Fresnel's equations as complex numbers, and what the kernel's tables keep of them."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from sim._kernels import RADAR_CURVE_STEPS
from sim.radar.reflection import Reflection, reflectance
from sim.scene.scene_map import Surface
from sim.scene.surfaces import NO_SURFACE, SURFACES

CARRIER_HZ = 60.8e9
MIRROR = Surface(0.5, 1.0, 1e8, 0.0)


def fresnel(surface: Surface, c: float) -> tuple[float, float]:
    """Reflected share of power, across and along the plane of incidence."""
    eps = surface.relative_permittivity - 1j * surface.conductivity_s_per_m / (2 * math.pi * CARRIER_HZ * 8.8541878e-12)
    w = cmath.sqrt(eps - (1.0 - c * c))
    return abs((c - w) / (c + w)) ** 2, abs((eps * c - w) / (eps * c + w)) ** 2


def test_normal_incidence_in_closed_form() -> None:
    glass = Surface(0.1, 6.25, 0.0, 0.0)
    assert reflectance(glass, CARRIER_HZ, 1.0) == pytest.approx((1.5 / 3.5) ** 2, rel=1e-13)  # ((n - 1) / (n + 1))^2
    # A good conductor: 1 - 4 R_s / Z_0, its surface resistance R_s = sqrt(pi f mu_0 / sigma).
    copper = Surface(0.5, 1.0, 5.8e7, 0.0)
    resistance = math.sqrt(math.pi * CARRIER_HZ * 4e-7 * math.pi / 5.8e7)
    lost = 4.0 * resistance / 376.730313
    assert 1.0 - reflectance(copper, CARRIER_HZ, 1.0) == pytest.approx(lost, rel=1e-3)


def test_at_brewsters_angle_half_of_the_waves_come_back() -> None:
    glass = Surface(0.1, 6.25, 0.0, 0.0)
    c = 1.0 / math.sqrt(1.0 + 6.25)
    across, along = fresnel(glass, c)
    assert along < 1e-28
    assert reflectance(glass, CARRIER_HZ, c) == pytest.approx(0.5 * across, rel=1e-12)


@pytest.mark.parametrize("name", SURFACES)
def test_fresnel_against_complex_numbers(name: str) -> None:
    for c in (1.0, 0.9, 0.5, 0.2, 0.03, 1e-3, 1e-6):
        expected = 0.5 * sum(fresnel(SURFACES[name], c))
        assert reflectance(SURFACES[name], CARRIER_HZ, c) == pytest.approx(expected, rel=1e-8)


def test_a_rough_conductor_is_lamberts_and_a_smooth_one_a_lobe() -> None:
    c = np.array([1.0, 0.8, 0.5, 0.2])
    rough = Reflection().backscatter(Surface(0.5, 1.0, 1e8, 0.05), CARRIER_HZ, c)
    assert rough == pytest.approx(4.0 * c * c, rel=2e-3)
    smooth = Reflection(facet_slope=0.2).backscatter(MIRROR, CARRIER_HZ, c)
    tan2 = 1.0 / c**2 - 1.0
    assert smooth == pytest.approx(np.exp(-tan2 / 0.08) / (0.08 * c**4), rel=2e-3)


@pytest.mark.parametrize("roughness_m", [0.0, 1e-4, 3e-4, 1e-3, 1e-2])
def test_roughness_moves_power_and_makes_none(roughness_m: float) -> None:
    """A surface lit at cosine c reflects at most |Gamma|^2 in all; from the front the lobe holds rho^2."""
    surface = Surface(0.5, 1.0, 1e8, roughness_m)
    phase = 4.0 * math.pi * roughness_m * CARRIER_HZ / 299_792_458.0
    rho2 = math.exp(-phase * phase)
    front = Reflection(facet_slope=0.1).backscatter(surface, CARRIER_HZ, np.array([1.0]))[0]
    assert front == pytest.approx(rho2 / 0.02 + 4.0 * (1.0 - rho2), rel=1e-3)


def curve_in_db(curve: NDArray[np.float32], c: NDArray[np.float64]) -> NDArray[np.float64]:
    nodes = np.linspace(0.0, 1.0, RADAR_CURVE_STEPS + 1)
    return np.asarray(20.0 * np.log10(np.interp(np.sqrt(c), nodes, curve.astype(float))))


@pytest.mark.parametrize("facet_slope", [0.07, 0.1, 0.3])
def test_tables_are_within_a_hundredth_of_a_decibel(facet_slope: float) -> None:
    model = Reflection(facet_slope=facet_slope)
    surfaces = [NO_SURFACE, *SURFACES.values()]
    curves = model.curves(surfaces, CARRIER_HZ)
    rng = np.random.default_rng(1)
    c = np.concatenate([10.0 ** rng.uniform(-3.0, 0.0, 20_000), rng.uniform(1e-3, 1.0, 20_000)])
    for surface, curve in zip(surfaces[1:], curves[1:], strict=True):
        exact = 10.0 * np.log10(model.backscatter(surface, CARRIER_HZ, c) / c)
        assert np.abs(curve_in_db(curve, c) - exact).max() < 0.01, surface


@pytest.mark.parametrize("name", SURFACES)
def test_grazing_is_finite_and_fades(name: str) -> None:
    curves = Reflection().curves([NO_SURFACE, SURFACES[name]], CARRIER_HZ)
    assert np.all(np.isfinite(curves))
    assert np.all(curves >= 0.0)
    assert not curves[0].any()
    assert curves[1][0] == 0.0
    assert 0.0 < curves[1][1] < 0.02 * curves[1].max()
    c = np.array([0.0, -0.5, np.nan, 1e-300, 1e-160, 1e-30])
    sigma0 = Reflection().backscatter(SURFACES[name], CARRIER_HZ, c)
    assert np.all(np.isfinite(sigma0))
    assert np.all(sigma0[:3] == 0.0)
