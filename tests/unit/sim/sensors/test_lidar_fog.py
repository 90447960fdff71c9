"""LiDAR in fog: the formula of Hahner et al. and Rasshofer et al., how often fog is seen, and what it hides."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.constants import speed_of_light
from scipy.integrate import quad

from sim.scene.weather import Weather
from sim.sensors.lidar_fog import fog_echo, soft_power
from tests.unit.sim.sensors.test_lidar_drops import SKY, T_NS, WALL, rays, sensor, sweep
from tests.worlds.mjcf_world import truth_at

# The alphas for which Hahner et al. publish tables; their pulse.
ALPHAS, PULSE_S = (0.005, 0.01, 0.02, 0.03, 0.06, 0.1, 0.12, 0.15, 0.2), 2e-8
FOG = Weather(visibility_m=30.0)
USUAL: dict[str, Any] = {"least_drop_echo": 0.005}


def published_integral(range_m: float, alpha: float, tau_s: float, surface_m: float = math.inf) -> float:
    """Equation 14 of Hahner et al.: the light of fog before a surface, at the range before their shift by c tau / 2."""

    def integrand(t: float) -> float:
        x = range_m - 0.5 * speed_of_light * t
        if x <= 0.9 or x > surface_m:
            return 0.0
        return math.sin(math.pi * t / (2 * tau_s)) ** 2 * math.exp(-2 * alpha * x) / x**2 * min((x - 0.9) / 0.1, 1.0)

    knees = [t for x in (0.9, 1.0, surface_m) if 0.0 < (t := 2 * (range_m - x) / speed_of_light) < 2 * tau_s]
    return quad(integrand, 0.0, 2 * tau_s, points=knees, limit=200)[0]


@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("tau_s", [5e-9, PULSE_S])
def test_the_power_is_that_of_the_published_integral(alpha: float, tau_s: float) -> None:
    for range_m in (0.5, 1.2, 1.7, 3.0, 8.0):
        wanted = 0.5 * speed_of_light * published_integral(range_m + 0.5 * speed_of_light * tau_s, alpha, tau_s)
        assert soft_power(range_m, alpha, tau_s) == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_peak_is_where_the_published_table_has_it(alpha: float) -> None:
    """Their tables hold range and height of the peak on a grid of 0.1 m, for a surface at 30 m among others."""
    grid_m = np.linspace(0.0, 200.0, 2000)
    shift_m = 0.5 * speed_of_light * PULSE_S
    response = [published_integral(float(r), alpha, PULSE_S, 30.0) if r < 15.0 else 0.0 for r in grid_m]
    at = int(np.argmax(response))
    echo = fog_echo(alpha, PULSE_S)
    assert echo.range_m == pytest.approx(grid_m[at] - shift_m, abs=0.1)
    beta = 0.046 * alpha / math.log(20.0)
    strength = math.pi * beta * echo.range_m**2 * 0.5 * speed_of_light * response[at]
    assert echo.strength == pytest.approx(strength, rel=0.02)


@pytest.mark.parametrize("wall_m", [2.0, 4.0, 8.0, 14.0])
@pytest.mark.parametrize("which", ["strongest", "first", "last"])
def test_what_fog_hides_is_what_the_two_formulas_give(wall_m: float, which: str) -> None:
    """A surface of strongest echoes is lost where g e_p / R^2 > rho cos exp(-2 alpha R_0) / R_0^2."""
    alpha = 3.912 / 30.0
    echo = fog_echo(alpha, PULSE_S)
    wall = WALL.replace('pos="6 0 0"', f'pos="{wall_m + 0.1} 0 0"')
    settings = USUAL | {"echo": which, "range_at_10_percent_m": 1000.0}
    clear, foggy = sweep(Weather(), wall, **settings), sweep(FOG, wall, **settings)
    factor = np.concatenate([1.0 / (2.0 - np.linspace(0.0, 1.0, 501)[1:]), np.linspace(1.0, 2.0, 501)[1:]])
    range_m = echo.range_m * factor
    r0 = clear.range_m.astype(float)[:, None]
    least = np.full((len(r0), 1000), USUAL["least_drop_echo"])
    if which == "strongest":
        hard = clear.intensity[:, None] * np.exp(-2.0 * alpha * r0) / r0**2
        least = np.maximum(least, hard * range_m**2)
    hidden = np.exp(-least / echo.strength) * (range_m < r0) * (range_m >= 0.5)
    wanted = 0.0 if which == "last" else float(hidden.mean(axis=1).sum())
    found = len(clear.range_m) - int((foggy.segmentation != 0).sum())
    assert found == pytest.approx(wanted, abs=5.0 * math.sqrt(max(wanted, 1.0)) + 0.005 * wanted)


def test_false_returns_are_as_frequent_as_the_formula_says() -> None:
    for visibility_m in (20.0, 50.0, 200.0):
        echo = fog_echo(3.912 / visibility_m, PULSE_S)
        share = math.exp(-0.005 / echo.strength)
        found = (
            len(sweep(Weather(visibility_m=visibility_m), SKY, range_at_10_percent_m=100.0, **USUAL).range_m) / rays()
        )
        near = 0.25 if echo.range_m < 1.0 else 0.0  # nearer than the device's least range
        assert found == pytest.approx(share * (1.0 - near), abs=4.0 * math.sqrt(share / rays()) + 1e-4)


def test_false_returns_are_round_the_peak() -> None:
    echo = fog_echo(3.912 / 30.0, PULSE_S)
    cloud = sweep(FOG, **USUAL)
    assert 0.5 * echo.range_m <= cloud.range_m.min() < cloud.range_m.max() <= 2.0 * echo.range_m + 1e-5
    assert float(np.median(cloud.range_m)) == pytest.approx(echo.range_m, rel=0.05)
    assert set(cloud.segmentation.tolist()) == {0}
    # Light of those detected: exponential above the threshold, with the mean e_p.
    assert float(cloud.intensity.mean()) == pytest.approx(0.005 + echo.strength, rel=0.03)


def test_range_in_dense_fog_is_as_measured() -> None:
    """Bijelic, Gruber and Ritter (IV 2018): no sensor saw farther than 25 m where the visibility was below 40 m."""
    seen = {}
    for wall_m in range(5, 60, 2):
        wall = WALL.replace('pos="6 0 0"', f'pos="{wall_m + 0.1} 0 0"')
        cloud = sweep(Weather(visibility_m=40.0), wall, echo="last", range_at_10_percent_m=40.0, **USUAL)
        seen[wall_m] = int((cloud.segmentation != 0).sum())
    farthest_m = max(wall_m for wall_m, count in seen.items() if count > 0)
    assert 15 <= farthest_m <= 25


@pytest.mark.parametrize("weather", [Weather(), Weather(visibility_m=2000.0), Weather(rain_mm_per_h=30.0)])
def test_without_fog_nothing_is_computed(weather: Weather) -> None:
    assert sensor(weather, **USUAL)._fog is None


def test_draws_depend_on_the_number_of_the_sweep_alone() -> None:
    running = sensor(FOG, **USUAL)
    running.sample(truth_at(T_NS), 0)
    again = running.sample(truth_at(2 * T_NS), 1)
    alone = sweep(FOG, seq=1, **USUAL)
    assert again.range_m.tobytes() == alone.range_m.tobytes()
    assert alone.range_m.tobytes() != sweep(FOG, seq=2, **USUAL).range_m.tobytes()
    assert alone.range_m.tobytes() != sweep(FOG, seq=1, seed=2, **USUAL).range_m.tobytes()
