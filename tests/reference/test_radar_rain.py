"""Rain: the Recommendation's table, Mie's series against its limits, and the power and speeds of a frame's drops."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.frame.camera_model import CameraModel
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.radar.echoes import Echoes
from sim.radar.rain import (
    NEAREST_M,
    Rain,
    attenuation_db_per_km,
    coefficients,
    drop_sections_m2,
    drop_spectrum,
    water_permittivity,
)
from sim.radar.scatterers import Scatterers, amplitude_scale, solid_angles
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from tests.worlds.radar_scenes import ANTENNA, CHIRP, RECEIVER

FAR_M = 12.0


@pytest.mark.parametrize(
    ("ghz", "k_h", "alpha_h", "k_v", "alpha_v"),
    [
        (25, 0.1571, 0.9991, 0.1533, 0.9491),
        (60, 0.8606, 0.7656, 0.8515, 0.7486),
        (70, 1.0315, 0.7345, 1.0253, 0.7215),
        (80, 1.1704, 0.7115, 1.1668, 0.7021),
    ],
)
def test_coefficients_are_those_of_the_table(
    ghz: float, k_h: float, alpha_h: float, k_v: float, alpha_v: float
) -> None:
    """Recommendation ITU-R P.838-3, table 5."""
    assert coefficients(1e9 * ghz) == pytest.approx((k_h, alpha_h, k_v, alpha_v), abs=6e-5)


def test_small_drops_scatter_as_rayleigh_says() -> None:
    f_hz, d_m = 3e9, 1e-3
    wavelength_m = SPEED_OF_LIGHT_MPS / f_hz
    eps = complex(*water_permittivity(f_hz))
    section = math.pi**5 * abs((eps - 1.0) / (eps + 2.0)) ** 2 * d_m**6 / wavelength_m**4
    assert drop_sections_m2(d_m, f_hz)[0] == pytest.approx(section, rel=0.01)


def test_great_drops_have_twice_their_shadow() -> None:
    """The extinction paradox."""
    area = math.pi * 0.25 * 7e-3**2
    assert drop_sections_m2(7e-3, 1e12)[1] == pytest.approx(2.0 * area, rel=0.1)


@pytest.mark.parametrize("ghz", [24.0, 60.8, 77.0])
@pytest.mark.parametrize("rate", [2.0, 10.0, 50.0])
def test_mie_and_the_recommendation_agree(ghz: float, rate: float) -> None:
    """Within 1.3 dB: the Recommendation has another distribution of small drops."""
    extinction = sum(row[2] for row in drop_spectrum(1e9 * ghz, rate)) * 1e4 / math.log(10.0)
    assert abs(10.0 * math.log10(extinction / attenuation_db_per_km(1e9 * ghz, rate))) < 1.5


@pytest.mark.parametrize("rate", [5.0, 10.0, 40.0])
def test_backscatter_is_that_measured_at_70_ghz(rate: float) -> None:
    """4.2e-5 r^1.1 (Currie, Dyer and Hayes, Georgia Tech, 1975), within the spread of rain, 4 dB."""
    eta = sum(row[1] for row in drop_spectrum(70e9, rate))
    assert abs(10.0 * math.log10(eta / (4.2e-5 * rate**1.1))) < 4.0


def rain_of(rate: float) -> tuple[Rain, Scatterers, CameraModel]:
    camera = CameraModel.from_fov(160, 120, 90.0)
    made = Scatterers(camera, load_world(load_scene("airfield")), CHIRP, ANTENNA, RECEIVER)
    rain = Rain(CHIRP.center_frequency_hz, rate, made.direction_R, made.weight, FAR_M, seed=1, name="radar")
    return rain, made, camera


def test_a_frame_has_the_power_of_the_volume() -> None:
    """scale^2 eta dR / R^2 times the integral of both gains, in each metre."""
    rain, made, camera = rain_of(10.0)
    sky = np.full((120, 160), np.inf, np.float32)
    power = np.zeros(12)
    frames = 40
    for k in range(frames):
        e = rain.echoes(sky, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0), k)
        power += np.bincount(e.range_m.astype(int), e.amplitude**2, 12) / frames
    scale2 = amplitude_scale(CHIRP, ANTENNA, RECEIVER) ** 2
    pattern = float(np.sum(ANTENNA.share(made.direction_R) * solid_angles(camera).reshape(-1)))
    eta = sum(row[1] for row in drop_spectrum(CHIRP.center_frequency_hz, 10.0))
    for metre in range(1, 12):
        expected = scale2 * eta * pattern * (1.0 / metre - 1.0 / (metre + 1))
        assert abs(10.0 * math.log10(power[metre] / expected)) < 0.5
    assert NEAREST_M < 1.0


def test_drops_fall_and_end_at_what_is_seen() -> None:
    rain, made, _ = rain_of(10.0)
    wall = np.full((120, 160), 4.0, np.float32)
    e = rain.echoes(wall, (0.0, 0.0, -1.0), (3.0, 0.0, 0.0), 5)
    assert np.all(e.amplitude[e.range_m >= 4.0] == 0.0)
    assert np.all(e.amplitude[e.range_m < 4.0] > 0.0)
    fall = -(e.speed_mps + 3.0 * e.direction_R[:, 0]) / e.direction_R[:, 2]
    level = np.abs(e.direction_R[:, 2]) > 0.05
    assert fall[level].min() >= -1e-9
    assert 3.0 < np.median(fall[level]) < 8.0
    again = rain_of(10.0)[0].echoes(wall, (0.0, 0.0, -1.0), (3.0, 0.0, 0.0), 5)
    assert again.speed_mps.tobytes() == e.speed_mps.tobytes()
    assert not np.array_equal(rain.echoes(wall, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0), 6).range_m, e.range_m)
    assert len(made.weight) == wall.size


def test_echoes_are_attenuated_both_ways() -> None:
    rain, _, _ = rain_of(50.0)
    echoes = Echoes(np.linspace(0.1, 20.0, 50), np.zeros(50), np.zeros((50, 3)), np.ones(50))
    rain.attenuate(echoes)
    loss_db = attenuation_db_per_km(CHIRP.center_frequency_hz, 50.0) * 2e-3 * echoes.range_m
    assert np.allclose(-20.0 * np.log10(echoes.amplitude), loss_db, atol=1e-5)
