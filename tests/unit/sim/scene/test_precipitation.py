"""Rain and snow: the formulas' own limits, figures of their sources, and bad values."""

from __future__ import annotations

import math

import numpy as np
import pydantic
import pytest

from sim.scene.precipitation import Precipitation, rain, snow
from sim.scene.weather import Weather

DB_PER_KM = 10.0 / math.log(10.0) * 1000.0


@pytest.mark.parametrize(("rate", "db_per_km"), [(1.0, 1.076), (10.0, 5.033), (50.0, 14.80)])
def test_rain_takes_the_light_that_the_recommendation_gives(rate: float, db_per_km: float) -> None:
    assert rain(rate).extinction_per_m * DB_PER_KM == pytest.approx(db_per_km, rel=1e-3)


def test_dry_snow_takes_the_light_that_the_recommendation_gives() -> None:
    assert snow(2.0).extinction_per_m * DB_PER_KM == pytest.approx(5.5256 * 2.0**1.38, rel=1e-3)


@pytest.mark.parametrize("rate", [1.0, 5.0, 25.0])
def test_drops_take_the_light_that_was_measured_within_half(rate: float) -> None:
    """Twice the shadow of all drops of the distribution: pi n0 / s^3."""
    falling = rain(rate)
    shadows_per_m = math.pi * falling.n0_per_m3_mm / falling.slope_per_mm**3 * 1e-6
    assert shadows_per_m == pytest.approx(falling.extinction_per_m, rel=0.5)


@pytest.mark.parametrize("falling", [rain(20.0), snow(1.5)])
def test_number_above_a_width_is_the_integral_of_the_distribution(falling: Precipitation) -> None:
    widths_mm = np.linspace(0.3, 4.0, 9)
    for width in widths_mm:
        least = falling.water_scale * width**falling.water_power
        m = np.linspace(least, falling.largest_mm, 200_001)
        wanted = np.trapezoid(falling.n0_per_m3_mm * np.exp(-falling.slope_per_mm * m), m)
        assert falling.per_m3(float(width)) == pytest.approx(wanted, rel=1e-6)
    assert falling.per_m3(1000.0) == 0.0


def test_the_water_that_falls_is_the_rate() -> None:
    """Rate of Marshall and Palmer's drops at the speeds of Atlas et al. (1973), 9.65 - 10.3 exp(-0.6 m)."""
    for rate in (2.0, 10.0, 50.0):
        falling = rain(rate)
        m = np.linspace(0.11, 6.0, 100_001)
        speed_mps = 9.65 - 10.3 * np.exp(-0.6 * m)
        volume_m3 = math.pi / 6.0 * (m * 1e-3) ** 3
        fallen_mps = np.trapezoid(falling.n0_per_m3_mm * np.exp(-falling.slope_per_mm * m) * volume_m3 * speed_mps, m)
        assert fallen_mps * 3.6e6 == pytest.approx(rate, rel=0.25)


def test_extinctions_add() -> None:
    weather = Weather(visibility_m=800.0, rain_mm_per_h=10.0)
    assert weather.extinction_per_m == 3.912 / 800.0 + rain(10.0).extinction_per_m
    assert Weather().extinction_per_m == 0.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rain_mm_per_h": -1.0}, "greater than or equal to 0"),
        ({"rain_mm_per_h": 500.0}, "less than or equal to 200"),
        ({"snow_mm_per_h": 11.0}, "less than or equal to 10"),
        ({"rain_mm_per_h": 5.0, "snow_mm_per_h": 1.0}, "at once are not modelled"),
    ],
)
def test_weather_that_cannot_be_is_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=message):
        Weather(**values)
