"""LiDAR: light of retroreflectors, and noise of the sun, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from signals.samples import PointCloudSample
from sim.scene.light import Light
from sim.scene.scene import load_scene
from sim.scene.surfaces import NUMBER_PLATE, SIGN_SHEETING, SURFACES
from sim.scene.weather import Weather
from sim.sensors.lidar import Lidar
from sim.sensors.lidar_retro import Retroreflectors, falloff
from sim.world_loader import load_world
from tests.worlds.installed_sensor import installed
from tests.worlds.mjcf_world import ModelFrames, compiled, truth_at

T_NS = 100_000_000
WALL = '<mujoco><worldbody><geom name="wall" type="box" size=".1 {half} {half}" pos="{x} 0 0"/></worldbody></mujoco>'
SKY = '<mujoco><worldbody><geom name="far" type="sphere" size=".1" pos="0 0 -4000"/></worldbody></mujoco>'
AHEAD = {"kind": "spinning", "elevation_deg": tuple(0.5 * e for e in range(-8, 8)), "firing_ns": 2000, "columns": 1800}
EXACT: dict[str, Any] = {"range_noise_m": 0.0, "range_resolution_m": 1e-6, "dropout_probability": 0.0, "pattern": AHEAD}
# The sun straight behind the LiDAR, on the wall ahead (x is east).
BEHIND = Light(sun_azimuth_deg=270.0, sun_elevation_deg=10.0)  # above all beams
AHEAD_OF_IT = Light(sun_azimuth_deg=90.0, sun_elevation_deg=1.0)


def lidar(mjcf: str, light: Light, reflectivity: float = 0.5, weather: Weather | None = None, **more: Any) -> Lidar:
    scene = load_scene("airfield").model_copy(update={"light": light, "weather": weather or Weather()})
    frames: Any = ModelFrames(*compiled(mjcf), reflectivity={"wall": reflectivity})
    made = installed("lidar", scene, preset="vlp16", overrides=EXACT | {"rolling": False} | more, frames=frames)
    assert isinstance(made, Lidar)
    return made


def sweep(mjcf: str, light: Light, seq: int = 0, **more: Any) -> PointCloudSample:
    return lidar(mjcf, light, **more).sample(truth_at(T_NS * (seq + 1)), seq)


# Retroreflectors -------------------------------------------------------------------------------------------------


def test_the_falloff_has_the_standard_s_values() -> None:
    cosines = np.cos(np.radians([0.0, 5.0, 30.0, 40.0, 60.0, 80.0]))
    assert falloff(cosines) == pytest.approx([1.0, 1.0, 150 / 250, 110 / 250, 0.0, 0.0], abs=1e-12)
    fine = falloff(np.cos(np.radians(np.linspace(0.0, 90.0, 1000))))
    assert (np.diff(fine) <= 0.0).all()


@pytest.mark.parametrize(("angle_deg", "least"), [(5.0, 250.0), (30.0, 150.0), (40.0, 110.0)])
def test_a_sign_returns_what_the_standard_asks(angle_deg: float, least: float) -> None:
    """R_A is intensity per area and illuminance across the light; a Lambertian disc of 1 sends cos / pi."""
    geom, strength = np.array([0, 1, -1], np.int32), np.zeros(3)
    angle = math.radians(angle_deg)
    normal = np.tile([math.cos(angle), math.sin(angle), 0.0], (3, 1))
    Retroreflectors(np.array([250.0, 0.0])).add(geom, normal, np.tile([-1.0, 0.0, 0.0], (3, 1)), strength)
    assert strength == pytest.approx([math.pi * least / math.cos(angle), 0.0, 0.0], rel=1e-9)


def street_sweep(*, retroreflectors: bool) -> tuple[Any, PointCloudSample, Lidar]:
    world = load_world(load_scene("urban_delivery"))
    from sim.frame.source import SharedFrames

    frames = SharedFrames(world)
    made = installed(
        "lidar",
        world.scene,
        preset="os1_64",
        overrides={"rolling": False, "retroreflectors": retroreflectors},
        frames=frames,
    )
    assert isinstance(made, Lidar)
    return world, made.sample(truth_at(T_NS, p_WB=(0.0, 0.0, 1.5)), 0), made


def test_plates_and_signs_of_the_maps_are_bright_only_if_switched_on() -> None:
    world, off, _ = street_sweep(retroreflectors=False)
    _, on, _ = street_sweep(retroreflectors=True)
    assert {SIGN_SHEETING.retroreflection, NUMBER_PLATE.retroreflection} & {s.retroreflection for s in world.surfaces}
    assert len(on.range_m) >= len(off.range_m)
    assert (off.intensity == 1.0).sum() == 0
    bright = on.range_m[on.intensity == 1.0]
    assert len(bright) > 0
    # Everything else keeps its bits.
    assert set(off.range_m.tolist()) <= set(on.range_m.tolist())


def test_maps_of_your_own_may_name_them() -> None:
    assert SURFACES["number_plate"] is NUMBER_PLATE
    assert SURFACES["sign_sheeting"] is SIGN_SHEETING


# The sun ---------------------------------------------------------------------------------------------------------


def farthest_m(light: Light, **more: Any) -> float:
    """Return the range at which half of the rays onto a small wall, head on, are seen."""
    low, high = 5.0, 95.0
    while high - low > 0.1:
        x = 0.5 * (low + high)
        wall = WALL.format(x=x + 0.1, half=0.08 * x)
        clear = len(sweep(wall, light, range_at_10_percent_m=None, sunlight=None).range_m)
        seen = len(sweep(wall, light, range_at_10_percent_m=30.0, **more).range_m)
        low, high = (x, high) if seen > 0.5 * clear else (low, x)
    return low


@pytest.mark.parametrize("noise", [1.0, 5.0])
def test_sunlit_surfaces_are_seen_less_far_by_the_fourth_root(noise: float) -> None:
    dark = farthest_m(BEHIND, reflectivity=0.4)
    lit = farthest_m(BEHIND, reflectivity=0.4, sunlight={"white_ground_noise": noise})
    assert dark == pytest.approx(30.0 * math.sqrt(4.0), rel=0.03)
    assert lit / dark == pytest.approx((1.0 + noise * 0.4 * math.cos(math.radians(10.0))) ** -0.25, rel=0.025)


def test_a_surface_in_its_own_shade_and_the_night_change_nothing() -> None:
    wall = WALL.format(x=20.0, half=4.0)
    for light in (Light(sun_azimuth_deg=90.0, sun_elevation_deg=10.0), Light(sun_elevation_deg=-5.0)):
        off, on = sweep(wall, light), sweep(wall, light, sunlight={})
        assert off.range_m.tobytes() == on.range_m.tobytes()
        assert off.intensity.tobytes() == on.intensity.tobytes()


def test_intensity_is_that_of_the_surface() -> None:
    wall = WALL.format(x=20.0, half=4.0)
    bright = {"range_at_10_percent_m": None}
    off, on = sweep(wall, BEHIND, **bright), sweep(wall, BEHIND, sunlight={}, **bright)
    assert off.range_m.tobytes() == on.range_m.tobytes()
    assert on.intensity == pytest.approx(off.intensity, rel=1e-6)


def test_a_beam_into_the_sun_sees_points_at_the_rate_of_rice() -> None:
    sun = {"white_ground_noise": 1.0, "threshold_sigma": 8.0, "greatest_rise": 4.0}
    made = lidar(SKY, AHEAD_OF_IT, sunlight=sun, pulse_s=2e-8, max_range_m=1000.0, min_range_m=0.0)
    t = 8.0 * 4.0 / math.sqrt(1.0 + 46_200.0)
    per_m = 2.0 / 299_792_458.0 * math.exp(-0.5 * t * t) / (2.0 * math.sqrt(3.0) * 2e-8)
    ranges, beams = [], 0
    for seq in range(400):
        cloud = made.sample(truth_at(T_NS * (seq + 1)), seq)
        beams = max(beams, len(cloud.range_m))
        ranges += cloud.range_m.tolist()
        assert set(cloud.segmentation.tolist()) <= {0}
    assert 3 <= beams <= 9  # 0.7 degrees of sky, 0.2 by 0.5 degrees a beam
    assert len(ranges) > 800
    assert float(np.mean(ranges)) == pytest.approx(1.0 / per_m, rel=5.0 / math.sqrt(len(ranges)))


def test_haze_takes_the_sun_away() -> None:
    sun = {"sunlight": {}, "max_range_m": 1000.0, "min_range_m": 0.0, "range_at_10_percent_m": None}
    assert len(sweep(SKY, AHEAD_OF_IT, **sun).range_m) > 0
    thick = Weather(visibility_m=500.0)
    assert len(sweep(SKY, AHEAD_OF_IT, weather=thick, least_drop_echo=0.5, **sun).range_m) == 0


def test_without_the_key_nothing_is_computed() -> None:
    made = lidar(SKY, BEHIND)
    assert made._sun is None
    assert made._retro is None
