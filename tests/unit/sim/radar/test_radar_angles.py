"""Directions from the phases of receivers: arrays of all kinds, exact without noise, and as good as noise allows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.radar.processing.directions import Directions
from tests.worlds.radar_point_targets import CHIRP, L_ARRAY, direction

WAVELENGTH = CHIRP.wavelength_m
Array = tuple[tuple[float, float, float], ...]
HALF = 0.5 * WAVELENGTH
LINE: Array = tuple((0.0, i * HALF, 0.0) for i in range(8))
SPARSE: Array = ((0.0, 0.0, 0.0), (0.0, HALF, 0.0), (0.0, 3.5 * HALF, 0.0), (0.0, 0.0, HALF), (0.0, 0.0, 5.0 * HALF))
DEEP: Array = ((0.0, 0.0, 0.0), (2e-4, 0.7 * HALF, 0.0), (-3e-4, 0.0, 0.7 * HALF), (1e-4, 0.7 * HALF, 0.7 * HALF))


def cells(array: Array, d: NDArray[np.float64], gain: complex = 3.0 - 4.0j) -> NDArray[np.complex128]:
    return gain * np.exp(-2j * np.pi * (np.array(array) @ d) / WAVELENGTH)


def found(array: Array, x: NDArray[np.complex128]) -> NDArray[np.float64]:
    return Directions(array, WAVELENGTH).find(x[:, None])[0]


@pytest.mark.parametrize("array", [L_ARRAY, SPARSE, DEEP], ids=["L", "sparse", "deep"])
def test_exact_without_noise_over_60_degrees(array: Array) -> None:
    for azimuth in range(-60, 61, 6):
        for elevation in (-40, -11, 0, 7, 40):
            d = direction(azimuth, elevation)
            tolerance = 1e-4 if array is DEEP else 1e-12  # DEEP is solved in rounds
            assert found(array, cells(array, d)) == pytest.approx(d, abs=tolerance)


def test_a_line_sees_its_own_angle_alone() -> None:
    for azimuth in (-70.0, -20.0, 0.0, 45.0):
        d = direction(azimuth, 0.0)
        assert found(LINE, cells(LINE, d)) == pytest.approx(d, abs=1e-12)
        higher = direction(azimuth, 20.0)  # a cone: d_y is right, d_z taken for 0
        assert found(LINE, cells(LINE, higher))[1:] == pytest.approx([higher[1], 0.0], abs=1e-12)


def test_one_receiver_sees_straight_ahead() -> None:
    assert found(((0.1, 0.2, 0.3),), np.array([1.0 + 2.0j])).tolist() == [1.0, 0.0, 0.0]


def test_half_a_millimetre_too_much_makes_the_edge_ambiguous() -> None:
    limit = math.degrees(math.asin(0.5 * WAVELENGTH / 2.5e-3))
    assert 80.0 < limit < 81.0
    assert found(L_ARRAY, cells(L_ARRAY, direction(limit - 0.5, 0.0)))[1] > 0.9
    assert found(L_ARRAY, cells(L_ARRAY, direction(limit + 0.5, 0.0)))[1] < -0.9  # beyond it, the other side


def test_noise_can_ask_for_more_than_a_unit_vector() -> None:
    both = cells(L_ARRAY, np.array([0.0, 0.95, 0.95]))
    d = found(L_ARRAY, both)
    assert np.linalg.norm(d) == pytest.approx(1.0, abs=1e-12)
    assert d == pytest.approx([0.0, math.sqrt(0.5), math.sqrt(0.5)], abs=1e-7)


@pytest.mark.parametrize("azimuth", [0.0, 40.0, -60.0])
def test_spread_is_that_of_the_phases(azimuth: float) -> None:
    """Each phase has the variance 1 / (2 SNR), so d_y of a pair spreads by sqrt(1 / SNR) lambda / (2 pi b)."""
    snr, trials = 10.0**3.0, 3000
    rng = np.random.default_rng(5)
    d = direction(azimuth, 0.0)
    clean = cells(L_ARRAY, d, 1.0)
    noise = rng.normal(0.0, math.sqrt(0.5 / snr), (trials, 3, 2))
    y = np.array([found(L_ARRAY, clean + n[:, 0] + 1j * n[:, 1])[1] for n in noise])
    expected = math.sqrt(1.0 / snr) * WAVELENGTH / (2.0 * math.pi * 2.5e-3)
    assert y.mean() == pytest.approx(d[1], abs=4.0 * expected / math.sqrt(trials))
    assert y.std() == pytest.approx(expected, rel=0.06)


def test_refusals() -> None:
    with pytest.raises(ValueError, match="needs at least one receiver"):
        found((), np.zeros(0, complex))
    with pytest.raises(ValueError, match="one value per receiver"):
        found(L_ARRAY, np.zeros(2, complex))
