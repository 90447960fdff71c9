"""Haze: Koschmieder's law in pictures and on a LiDAR's echoes, against numpy, and nothing at all in clear air."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.errors import ConfigError
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.frame.source import SharedFrames
from sim.scene.light import Light, light_in_haze
from sim.scene.scene import Scene, load_scene
from sim.scene.weather import HAZE_M, Weather
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation
from sim.world_loader import load_world
from tests.unit.sim.frame.test_frame_raster import CAMERA, digest, looking, picture
from tests.worlds.mjcf_world import truth_at

POSE = looking((-30.0, -35.0, 12.0), (0.0, 5.0, 9.0))  # things from 15 m on, the horizon and the sky
GREY = (0.5, 0.5, 0.5)
# No sun, so that haze leaves the light as it is, and a grey horizon, so that the air has its colour.
OVERCAST = Light(sun_rgb=(0.0, 0.0, 0.0), ambient_rgb=(0.9, 0.9, 0.9), sky_horizon_rgb=GREY)


def linear(code: NDArray[np.uint8]) -> NDArray[np.float64]:
    c = code / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def coded(light: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.clip(light, 0.0, 1.0)
    return 255.0 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)


@pytest.fixture(scope="module")
def geometry() -> FrameGeometry:
    return FrameGeometry(load_world(load_scene("city_park")))


def hazy(light: Light, extinction_per_m: float) -> Light:
    return light.model_copy(update={"fog_per_m": extinction_per_m})


@pytest.mark.parametrize("visibility_m", [60.0, 800.0, 10_000.0])
def test_colour_fades_into_the_air_as_koschmieder_says(geometry: FrameGeometry, visibility_m: float) -> None:
    beta = Weather(visibility_m=visibility_m).extinction_per_m
    assert np.exp(-beta * visibility_m) == pytest.approx(0.02, rel=1e-3)
    clear = picture(FrameRenderer(geometry, CAMERA, light=OVERCAST), POSE, "rgb", "range")
    seen = picture(FrameRenderer(geometry, CAMERA, light=hazy(OVERCAST, beta)), POSE, "rgb")["rgb"]
    range_m = clear["range"].astype(float)
    hit = np.isfinite(range_m)
    assert 0.2 < hit.mean() < 0.98
    up = CAMERA.rays() @ np.reshape(POSE.R_WC, (3, 3))[2]  # sine of the elevation
    through = np.exp(-beta * np.where(hit, range_m, HAZE_M / np.maximum(up, 1e-3)))[..., None]
    expected = coded(linear(clear["rgb"]) * through + 0.5 * (1.0 - through))
    # Half a code each for the two roundings, and 0.7 for the raster's own curve at either end.
    assert np.abs(seen - expected).max() < 2.5
    assert np.abs(seen - expected).mean() < 0.6
    if visibility_m < 1000.0:
        far = (hit & (range_m > 5.0 * visibility_m)) | (~hit & (up < 0.01))
        assert far.any()
        assert np.ptp(seen[far].astype(int)) <= 1  # nothing but air


def test_in_clear_air_nothing_changes_and_geometry_never_does(geometry: FrameGeometry) -> None:
    others = ("depth", "range", "segmentation", "instance", "normal", "material", "geom")
    plain = FrameRenderer(geometry, CAMERA)
    clear = FrameRenderer(geometry, CAMERA, light=Light())
    fog = FrameRenderer(geometry, CAMERA, light=hazy(Light(), 0.01))
    assert digest(picture(plain, POSE, "rgb")) == digest(picture(clear, POSE, "rgb"))
    assert digest(picture(plain, POSE, *others)) == digest(picture(fog, POSE, *others))
    assert digest(picture(plain, POSE, "rgb")) != digest(picture(fog, POSE, "rgb"))


def test_fog_takes_the_sun_and_gives_it_back_to_the_sky() -> None:
    light = Light(sun_elevation_deg=30.0)
    before = light_in_haze(light, 0.0)
    assert (before.sun_rgb, before.ambient_rgb, before.air_rgb) == (
        light.sun_rgb,
        light.ambient_rgb,
        light.sky_horizon_rgb,
    )
    beta = 3.912 / 2000.0
    after = light_in_haze(light, beta)
    through = np.exp(-beta * HAZE_M / 0.5)
    assert np.allclose(after.sun_rgb, np.multiply(light.sun_rgb, through), rtol=1e-12)
    lost = np.multiply(light.sun_rgb, 0.5 * (1.0 - through))  # on level ground
    gained = np.subtract(after.ambient_rgb, light.ambient_rgb)
    assert np.allclose(gained, 0.75 * lost, rtol=1e-12)
    assert np.ptp(after.air_rgb) < np.ptp(light.sky_horizon_rgb)
    night = light_in_haze(Light(sun_elevation_deg=-5.0), beta)
    assert night.sun_rgb == (0.0, 0.0, 0.0)
    assert night.ambient_rgb == Light().ambient_rgb


def echoes(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Range and intensity of all that a LiDAR 3 m over the ground hears."""
    told = {"rate_hz": 10.0, "seed": 1, "step_ns": 4_000_000, "frames": SharedFrames(load_world(scene))}
    exact = {
        "range_noise_m": 0.0,
        "dropout_probability": 0.0,
        "range_at_10_percent_m": None,
        "beam_divergence_rad": 0.0,
        "least_drop_echo": 1.0,  # no false returns: test_lidar_fog.py
    }
    lidar = make_sensor(Installation("lidar", scene=scene, **told), preset="vlp16", overrides=exact)
    sample = lidar.sample(truth_at(0, p_WB=(0.0, 0.0, 3.0)), 0)
    return sample.range_m.astype(float), sample.intensity.astype(float)


def test_a_lidar_sees_less_by_the_way_out_and_back() -> None:
    clear = load_scene("airfield")
    foggy = clear.model_copy(update={"weather": Weather(visibility_m=200.0)})
    range_m, strength = echoes(clear)
    same_m, weaker = echoes(foggy)
    assert np.array_equal(range_m, same_m)
    # Ranges are rounded to 2 mm after the light was taken.
    assert np.allclose(weaker, strength * np.exp(-2.0 * 3.912 / 200.0 * range_m), rtol=2e-4)
    assert range_m.max() > 40.0


def test_weather_is_read_strictly(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    head = "name: s\ndescription: d\nsite: {latitude_deg: 1, longitude_deg: 1, altitude_m: 1}\nground_friction: 0.8\n"
    path.write_text(head + "weather: {visibility_m: 800}\nlight: {fog_per_m: 0.001}\n")
    assert load_scene(path).extinction_per_m == pytest.approx(3.912 / 800.0 + 0.001)
    path.write_text(head + "weather: {visibility: 800}\n")
    with pytest.raises(ConfigError, match=r"s\.yaml:5: weather\.visibility"):
        load_scene(path)
