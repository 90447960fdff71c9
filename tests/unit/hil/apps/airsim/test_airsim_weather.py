"""Weather that AirSim's clients change in flight: rates, cameras, LiDAR, distance sensor, radar, recording, digest."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.airsim.world.surroundings import DUST, FOG, RAIN, SNOW, Surroundings
from sim.scene.precipitation import rain
from sim.scene.scene import load_scene
from sim.scene.weather import Weather
from tests.worlds.airsim_server import Client, Served, served

SETTINGS: dict[str, Any] = {
    "SettingsVersion": 1.2,
    "SimMode": "Multirotor",
    "CameraDefaults": {"CaptureSettings": [{"ImageType": 0, "Width": 160, "Height": 120, "FOV_Degrees": 90}]},
    "Vehicles": {
        "A": {
            "VehicleType": "SimpleFlight",
            "Sensors": {
                "Scan": {
                    "SensorType": 6, "Enabled": True, "NumberOfChannels": 16, "PointsPerSecond": 40000, "Range": 60,
                    "VerticalFOVLower": 2, "VerticalFOVUpper": 40,
                },
                "Down": {
                    "SensorType": 5, "Enabled": True, "Pitch": -2, "UncorrelatedNoiseSigma": 0.0, "MaxDistance": 15,
                },
            },
        },
    },
}  # fmt: skip
CLEAR: dict[int, float] = dict.fromkeys((RAIN, SNOW, DUST, FOG), 0.0)


@pytest.fixture(scope="module")
def world() -> Iterator[Served]:
    with served(json.dumps(SETTINGS)) as running:
        yield running


@pytest.fixture
def client(world: Served) -> Iterator[Client]:
    client = world.client()
    client.call("reset")
    weather(client, {})
    client.call("simPause", True)
    yield client
    client.close()


def weather(client: Client, intensities: dict[int, float]) -> None:
    client.call("simEnableWeather", bool(intensities))
    for kind, intensity in (CLEAR | intensities).items():
        client.call("simSetWeatherParameter", kind, intensity)


def next_sample(client: Client) -> None:
    """Let time go on until every sensor has a new sample."""
    client.call("simContinueForTime", 0.2)
    client.call("simPause", True)


def points(client: Client) -> NDArray[np.float64]:
    return np.array(client.call("getLidarData", "Scan", "A")["point_cloud"]).reshape(-1, 3)


def picture(client: Client) -> NDArray[np.uint8]:
    request = {"camera_name": "0", "image_type": 0, "pixels_as_float": False, "compress": False}
    reply = client.call("simGetImages", [request], "A", False)[0]
    return np.frombuffer(bytes(reply["image_data_uint8"]), np.uint8).reshape(reply["height"], reply["width"], 3)


@pytest.mark.parametrize(
    ("intensities", "wanted"),
    [
        ({RAIN: 0.5}, Weather(rain_mm_per_h=25.0)),
        ({SNOW: 0.5}, Weather(snow_mm_per_h=2.0)),
        ({FOG: 1.0}, Weather(visibility_m=25.0)),
        ({DUST: 0.5}, Weather(visibility_m=240.0)),
        ({FOG: 1.0, DUST: 1.0}, Weather(visibility_m=1500.0 / 85.0)),
        ({RAIN: 1.0, SNOW: 0.1}, Weather(rain_mm_per_h=100.0)),  # the denser one falls
        ({RAIN: 0.1, SNOW: 1.0}, Weather(snow_mm_per_h=8.0)),
        ({1: 1.0, 3: 1.0, 4: 1.0, 5: 1.0}, Weather()),
    ],
)
def test_intensities_are_rates(intensities: dict[int, float], wanted: Weather) -> None:
    found = Surroundings(weather_enabled=True, weather=intensities).weather_of(Weather())
    assert found.model_dump() == pytest.approx(wanted.model_dump())
    Weather.model_validate(found.model_dump())  # within the limits of a bench file


def test_the_scene_s_own_weather_stays_and_adds() -> None:
    own = Weather(rain_mm_per_h=150.0, visibility_m=50.0)
    found = Surroundings(weather_enabled=True, weather={RAIN: 1.0, FOG: 1.0}).weather_of(own)
    assert found.rain_mm_per_h == 200.0
    assert found.visibility_m == pytest.approx(1.0 / (1.0 / 50.0 + 1.0 / 25.0))
    assert Surroundings(weather={RAIN: 1.0}).weather_of(own) is own


def test_the_scene_is_the_same_object_until_the_weather_changes() -> None:
    scene, around = load_scene("airfield"), Surroundings()
    assert around.present(scene) is scene
    around.weather_enabled, around.weather[RAIN] = True, 0.5
    wet = around.present(scene)
    assert wet.weather.rain_mm_per_h == 25.0
    assert around.present(scene) is wet
    around.weather_enabled = False
    assert around.present(scene).weather == scene.weather


def test_a_lidar_gets_flakes_and_loses_them_again(client: Client) -> None:
    next_sample(client)
    clear = points(client)
    weather(client, {SNOW: 0.5})
    next_sample(client)
    snowy = points(client)
    weather(client, {})
    next_sample(client)
    assert len(clear) == len(points(client))
    assert len(snowy) > len(clear) + 100
    assert np.median(np.sqrt((snowy**2).sum(axis=1))) < 12.0


def test_a_distance_sensor_loses_range(client: Client, world: Served) -> None:
    def distance_m() -> float:
        next_sample(client)
        return float(client.call("getDistanceSensorData", "Down", "A")["distance"])

    clear_m = distance_m()
    assert 1.0 < clear_m < 15.0
    weather(client, {FOG: 1.0})
    beta = 3.912 / 25.0
    assert clear_m * math.exp(beta * clear_m) > 15.0
    assert distance_m() == 15.0
    weather(client, {RAIN: 0.3})
    assert clear_m * math.exp(rain(9.0).extinction_per_m * clear_m) < 15.0
    assert distance_m() == pytest.approx(clear_m, abs=1e-3)


def test_a_camera_shows_streaks(client: Client) -> None:
    clear = picture(client)
    weather(client, {RAIN: 1.0})
    wet = picture(client)
    np.testing.assert_array_equal(picture(client), wet)  # of one tick
    next_sample(client)
    other = picture(client)
    weather(client, {})
    np.testing.assert_array_equal(picture(client), clear)
    assert (wet != other).any(axis=2).mean() > 0.02  # other drops
    assert (wet != clear).any(axis=2).mean() > 0.3


def script(client: Client, last: float) -> None:
    """Fly through changing weather with every sensor read after each change."""
    client.call("enableApiControl", True, "A")
    client.call("armDisarm", True, "A")
    client.call("takeoff", 20.0, "A")
    for intensities in ({}, {RAIN: 0.6}, {SNOW: 0.6}, {FOG: 0.5}, {RAIN: last}):
        weather(client, intensities)
        client.call("simContinueForTime", 0.3)
        points(client)
        picture(client)
        client.call("getDistanceSensorData", "Down", "A")


def replies(last: float) -> tuple[str, str]:
    with served(json.dumps(SETTINGS)) as world:
        script(world.client(), last)
        assert world.server.digest is not None
        return world.server.digest.hexdigest(), world.truths.hexdigest()


def test_the_digest_repeats_and_tells_the_weather() -> None:
    first, again, other = replies(0.3), replies(0.3), replies(0.31)
    assert first == again
    assert other[0] != first[0]


def test_a_recording_has_the_weather(client: Client, world: Served, tmp_path: Any) -> None:
    world.simulation.recorder.folder = tmp_path
    client.call("startRecording")
    client.call("simContinueForTime", 0.2)
    weather(client, {RAIN: 0.5})
    client.call("simContinueForTime", 0.2)
    weather(client, {FOG: 1.0})
    client.call("simContinueForTime", 0.2)
    client.call("stopRecording")
    rows = [line.split("\t") for line in next(tmp_path.glob("*/weather.txt")).read_text().splitlines()]
    assert rows[0] == ["TimeStamp", "RainMmPerH", "SnowMmPerH", "VisibilityM"]
    assert [row[1:] for row in rows[1:]] == [["0", "0", ""], ["25", "0", ""], ["0", "0", "25"]]
    times = [int(row[0]) for row in rows[1:]]
    assert times == sorted(set(times))
