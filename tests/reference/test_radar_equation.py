"""Summed power of a rendered scene's echoes against the radar equation with cross-sections in closed form."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from sim.frame.camera_model import CameraModel
from sim.radar.reflection import Reflection
from sim.radar.scatterers import Scatterers
from sim.scene.world import World
from tests.worlds.radar_scenes import (
    ANTENNA,
    CHIRP,
    LAMBERT,
    MIRROR,
    POWER_SCALE,
    RECEIVER,
    WIDE,
    picture_of,
    world_of,
)


def power_of(world: World, camera: CameraModel, **options: Reflection) -> float:
    """Return the sum of the squared amplitudes."""
    made = Scatterers(camera, world, CHIRP, ANTENNA, RECEIVER, **options)
    amplitude = made.collect(picture_of(world, camera, made.channels)).amplitude
    assert len(amplitude) == made.last.kept > 100
    return float(np.sum(amplitude**2))


def decibels(ratio: float) -> float:
    return 10.0 * math.log10(ratio)


def sphere(folder: Path, range_m: float, surface: dict[str, float]) -> World:
    return world_of(folder, f'<geom pos="{range_m} 0 0" size="1" material="m"/>', surface)


@pytest.mark.parametrize("range_m", [250.0, 500.0, 1000.0])
def test_lambertian_sphere(tmp_path: Path, range_m: float) -> None:
    """(8/3) pi r^2 of albedo 1, and R^-4 in the power; a sphere is nearer than its middle by 3/4 of its radius."""
    camera = CameraModel.from_fov(320, 240, math.degrees(6.0 / range_m))
    power = power_of(sphere(tmp_path, range_m, LAMBERT), camera)
    expected = POWER_SCALE * 8.0 / 3.0 * math.pi / (range_m - 0.75) ** 4
    assert abs(decibels(power / expected)) < 0.03


@pytest.mark.parametrize("slope", [0.1, 0.2])
def test_mirror_sphere(tmp_path: Path, slope: float) -> None:
    """pi r^2, but for the width of the lobe: pi r^2 / s^2 times the integral of t sqrt(1 + t^2) exp(-t^2 / (2 s^2))."""
    camera = CameraModel.from_fov(320, 240, math.degrees(4.0 / 500.0))
    power = power_of(sphere(tmp_path, 500.0, MIRROR), camera, reflection=Reflection(facet_slope=slope))
    t = np.linspace(0.0, 10.0 * slope, 20_001)
    lobe = np.trapezoid(t * np.sqrt(1.0 + t * t) * np.exp(-t * t / (2.0 * slope**2)), t) / slope**2
    assert 1.0 < lobe < 1.0 + 1.1 * slope**2
    assert abs(decibels(power / (POWER_SCALE * math.pi * lobe / 499.0**4))) < 0.05


@pytest.mark.parametrize(("range_m", "slope"), [(2.0, 0.1), (20.0, 0.1), (5.0, 0.2)])
def test_flat_mirror_shows_the_radar_its_image(tmp_path: Path, range_m: float, slope: float) -> None:
    """Friis over 2 R, whatever the slope of the facets: a wall has R^-2 where a target has R^-4."""
    wall = world_of(tmp_path, f'<geom type="box" size=".5 500 500" pos="{range_m + 0.5} 0 0" material="m"/>', MIRROR)
    power = power_of(wall, CameraModel.from_fov(320, 240, 110.0), reflection=Reflection(facet_slope=slope))
    friis = RECEIVER.tx_power_w * WIDE.axis_gain**2 * (CHIRP.wavelength_m / (4.0 * math.pi * 2.0 * range_m)) ** 2
    expected = RECEIVER.counts_per_sqrt_watt**2 * friis
    # The antenna loses gain off the axis: (cos)^0.15 each way in either plane.
    assert -0.1 < decibels(power / expected) < 0.01


def test_flat_plate_of_a_few_pixels(tmp_path: Path) -> None:
    """A Lambertian plate askew: sigma0 dA = 4 cos^2(theta) times its area."""
    angle = math.radians(50.0)
    turned = f'quat="{math.cos(angle / 2)} 0 0 {math.sin(angle / 2)}"'
    plate = world_of(tmp_path, f'<geom type="box" size="1e-4 1 .7" pos="100 0 0" {turned} material="m"/>', LAMBERT)
    power = power_of(plate, CameraModel.from_fov(640, 480, 2.0))
    expected = POWER_SCALE * 4.0 * math.cos(angle) ** 2 * (2.0 * 1.4) / 100.0**4
    assert abs(decibels(power / expected)) < 0.05


def test_resolution_changes_nothing(tmp_path: Path) -> None:
    geoms = """<geom pos="6 1 0" size="1" material="m"/><geom type="box" pos="8 -2 0" size="1 .5 1" material="m"/>
    <geom type="plane" size="0 0 1" pos="0 0 -1.8"/>"""
    world = world_of(tmp_path, geoms, LAMBERT)
    camera = CameraModel.from_fov(320, 240, 90.0)
    assert abs(decibels(power_of(world, camera.scaled(2)) / power_of(world, camera))) < 0.02
