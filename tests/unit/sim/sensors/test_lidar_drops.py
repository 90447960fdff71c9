"""LiDAR in rain and snow: how often, how near and how bright false returns are, and what they hide."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.samples import PointCloudSample
from sim.frame.source import SharedFrames
from sim.scene.precipitation import Precipitation, rain, snow
from sim.scene.scene import load_scene
from sim.scene.weather import Weather
from sim.sensors.catalog import make_sensor
from sim.sensors.lidar import Lidar
from sim.sensors.lidar_drops import beam_of, drops_per_m, nearest_drop
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.sensor import Installation
from sim.world_loader import load_world
from tests.worlds.mjcf_world import ModelFrames, compiled, truth_at

T_NS = 100_000_000
SKY = '<mujoco><worldbody><geom name="far" type="sphere" size=".1" pos="0 0 -4000"/></worldbody></mujoco>'
WALL = '<mujoco><worldbody><geom name="wall" type="box" size=".1 4 4" pos="6 0 0"/></worldbody></mujoco>'
AHEAD = {"kind": "spinning", "elevation_deg": tuple(float(e) for e in range(-8, 8)), "firing_ns": 2000, "columns": 1800}
# Exact ranges, and so sensitive near the device that raindrops count.
EXACT: dict[str, Any] = {
    "range_noise_m": 0.0,
    "range_resolution_m": 1e-6,
    "dropout_probability": 0.0,
    "least_drop_echo": 1e-6,
}
SHOWER = Weather(rain_mm_per_h=30.0)


def sweep(weather: Weather, mjcf: str = SKY, *, seq: int = 0, seed: int = 1, **overrides: Any) -> PointCloudSample:
    return sensor(weather, mjcf, seed=seed, **overrides).sample(truth_at(T_NS * (seq + 1)), seq)


def sensor(
    weather: Weather, mjcf: str | None = SKY, *, seed: int = 1, preset: str = "vlp16", **overrides: Any
) -> Lidar:
    """A LiDAR in a world of MJCF; None: on the airfield."""
    scene = load_scene("airfield").model_copy(update={"weather": weather})
    frames: Any = (
        SharedFrames(load_world(scene)) if mjcf is None else ModelFrames(*compiled(mjcf), reflectivity={"wall": 0.5})
    )
    made = make_sensor(
        Installation("lidar", rate_hz=10.0, seed=seed, scene=scene, step_ns=4_000_000, frames=frames),
        preset=preset,
        overrides={"pattern": AHEAD, "rolling": False} | EXACT | overrides,
    )
    assert isinstance(made, Lidar)
    return made


def rays() -> int:
    return 16 * 1800


@pytest.mark.parametrize("falling", [rain(10.0), rain(80.0), snow(2.0)])
@pytest.mark.parametrize("preset", ["vlp16", "os1_64"])
def test_the_table_is_the_integral_of_the_detectable_drops(preset: str, falling: Precipitation) -> None:
    parameters = parameters_of(preset)
    beam = beam_of(parameters)
    beta = falling.extinction_per_m
    table = nearest_drop(falling, beam, beta, (parameters.min_range_m, 60.0))
    fine_m = parameters.min_range_m + 0.0005 * np.arange(20 * (len(table) - 1) + 1)
    per_m = np.array([drops_per_m(falling, beam, beta, float(r)) for r in fine_m])
    wanted = 1.0 - np.exp(-np.concatenate([[0.0], np.cumsum(0.5 * 0.0005 * (per_m[1:] + per_m[:-1]))]))
    assert np.abs(table - wanted[::20]).max() < 2e-5
    assert (np.diff(table) >= 0.0).all()


def parameters_of(preset: str) -> LidarParameters:
    return sensor(Weather(), preset=preset)._p


def test_false_returns_are_as_frequent_as_the_formula_says() -> None:
    parameters = sensor(SHOWER)._p
    table = nearest_drop(rain(30.0), beam_of(parameters), SHOWER.extinction_per_m, (0.5, 100.0))
    count = sum(len(sweep(SHOWER, seq=seq, range_at_10_percent_m=40.0).range_m) for seq in range(3))
    # The receiver sees a drop for sure up to 0.9 of the range at which the table ends to count it at 1.1.
    least = nearest_drop(
        rain(30.0),
        beam_of(parameters)._replace(least_power_per_m2=0.1 / (0.9 * 40.0) ** 2),
        SHOWER.extinction_per_m,
        (0.5, 100.0),
    )[-1]
    deviation = 4.0 * math.sqrt(table[-1] / (3 * rays()))
    assert least - deviation < count / (3 * rays()) < table[-1] + deviation
    assert 0.01 < table[-1] < 0.5


def test_no_false_return_is_farther_than_the_drops_that_count() -> None:
    cloud = sweep(Weather(rain_mm_per_h=100.0))
    assert len(cloud.range_m) > 500
    assert cloud.range_m.max() < 8.0
    assert set(cloud.segmentation.tolist()) == {0}
    assert (cloud.intensity < 0.05).all()


def test_a_usual_device_reports_flakes_and_no_raindrops() -> None:
    usual = {"least_drop_echo": LidarParameters.model_fields["least_drop_echo"].default}
    assert len(sweep(Weather(rain_mm_per_h=30.0), **usual).range_m) == 0
    share = len(sweep(Weather(snow_mm_per_h=0.5), **usual).range_m) / rays()
    assert 0.04 < share < 0.09


def test_clear_air_adds_nothing() -> None:
    assert len(sweep(Weather()).range_m) == 0
    assert sensor(Weather())._drops is None


def test_snow_reaches_farther_than_rain() -> None:
    """Flakes return thirty times the light of a raindrop of their width."""
    flakes, drops = sweep(Weather(snow_mm_per_h=2.0)), sweep(Weather(rain_mm_per_h=2.0))
    assert flakes.range_m.max() > 2.0 * drops.range_m.max()
    assert len(flakes.range_m) > 2 * len(drops.range_m)


def test_which_echo_the_device_reports_decides_what_a_drop_hides() -> None:
    first, strongest, last = (hidden(echo) for echo in ("first", "strongest", "last"))
    assert first > 2 * max(strongest, 1)
    assert last == 0


def hidden(echo: str) -> int:
    """Return how many beams that meet the wall in clear air report a drop instead."""
    clear = sweep(Weather(), WALL, echo=echo)
    wet = sweep(Weather(rain_mm_per_h=100.0), WALL, echo=echo)
    on_wall = int((wet.segmentation != 0).sum())
    return len(clear.range_m) - on_wall


def test_draws_depend_on_the_number_of_the_sweep_alone() -> None:
    running = sensor(SHOWER)
    running.sample(truth_at(T_NS), 0)
    again = running.sample(truth_at(2 * T_NS), 1)
    alone = sweep(SHOWER, seq=1)
    assert again.range_m.tobytes() == alone.range_m.tobytes()
    assert alone.range_m.tobytes() != sweep(SHOWER, seq=2).range_m.tobytes()
    assert alone.range_m.tobytes() != sweep(SHOWER, seq=1, seed=2).range_m.tobytes()


@pytest.mark.parametrize("divergence_rad", [0.0, 0.003])
def test_points_and_instances_belong_together(divergence_rad: float) -> None:
    lidar = sensor(SHOWER, None, beam_divergence_rad=divergence_rad)
    cloud = lidar.sample(truth_at(T_NS, p_WB=(0.0, 0.0, 3.0)), 0)
    instances: NDArray[np.uint16] = lidar.instances()
    assert len(instances) == len(cloud.range_m)
    assert (instances[cloud.segmentation == 0] == 0).all()
    assert 10 < int((cloud.segmentation == 0).sum()) < len(instances)
