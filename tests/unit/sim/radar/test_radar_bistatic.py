"""Reflection out of another direction than in: its closed forms, and the one-way case."""

from __future__ import annotations

import numpy as np
import pytest

from sim.radar.bistatic import BistaticReflection
from sim.radar.reflection import Reflection, reflectance
from sim.scene.scene_map import Surface
from sim.scene.surfaces import ASPHALT, CONCRETE, GRASS, METAL, NO_SURFACE

CARRIER_HZ = 60.8e9
SURFACES = (NO_SURFACE, CONCRETE, ASPHALT, GRASS, METAL)


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_one_way_is_the_backscatter(k: int) -> None:
    cosine = np.linspace(0.02, 1.0, 5000)
    made = BistaticReflection(SURFACES, CARRIER_HZ, Reflection())
    ids = np.full(len(cosine), k)
    found = made.sigma0(ids, cosine, cosine, cosine, np.ones(len(cosine)))
    true = Reflection().backscatter(SURFACES[k], CARRIER_HZ, cosine)
    some = true > 1e-12 * true.max()
    assert np.abs(10.0 * np.log10(found[some] / true[some])).max() < 0.02


def test_a_mirror_reflects_as_fresnel_and_ament_say() -> None:
    made = BistaticReflection(SURFACES, CARRIER_HZ, Reflection())
    for k, surface in enumerate(SURFACES[1:], start=1):
        for cosine in (0.02, 0.1, 0.3, 0.7, 1.0):
            phase = 4.0 * np.pi * surface.roughness_m * CARRIER_HZ / 299_792_458.0 * cosine
            true = reflectance(surface, CARRIER_HZ, cosine) * np.exp(-(phase**2))
            found = made.mirror_power(np.array([k]), np.array([cosine]))[0]
            assert found == pytest.approx(true, rel=0.002, abs=1e-20)


def test_the_lobe_is_about_the_mirrored_way() -> None:
    smooth = Surface(0.5, 1.0, 1e8, 0.0)
    made = BistaticReflection((NO_SURFACE, smooth), CARRIER_HZ, Reflection())
    angle = np.radians(np.linspace(0.0, 80.0, 33))
    cosine = np.cos(angle)
    found = made.sigma0(np.ones(33, np.int64), cosine, cosine, np.ones(33), cosine)  # out by the mirrored way
    assert np.allclose(found, found[0], rtol=0.01)  # a good conductor
    assert found[0] == pytest.approx(1.0 / (2.0 * 0.1**2), rel=1e-3)
