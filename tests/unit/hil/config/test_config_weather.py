"""Impossible weather in a bench file: the file, the line and the limit are told."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from signals.errors import ConfigError


@pytest.mark.parametrize(
    ("weather", "told"),
    [
        ("{rain_mm_per_h: 500}", "weather.rain_mm_per_h must be at most 200, not 500"),
        ("{snow_mm_per_h: 11}", "weather.snow_mm_per_h must be at most 10, not 11"),
        ("{snow_mm_per_h: -1}", "weather.snow_mm_per_h must be at least 0, not -1"),
        ("{visibility_m: 2}", "weather.visibility_m must be at least 10 m, not 2"),
        ("{rain_mm_per_h: 1, snow_mm_per_h: 1}", "rain and snow at once are not modelled"),
        ("{hail_mm_per_h: 1}", "weather.hail_mm_per_h: unknown key"),
    ],
)
def test_impossible_weather_is_refused(tmp_path: Path, weather: str, told: str) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text(f"rig: mock\nscene: city_park\nweather: {weather}\n")
    with pytest.raises(ConfigError) as refused:
        load_bench(bench)
    assert f"{bench}:3: " in str(refused.value)
    assert told in str(refused.value)
