"""Surroundings that clients set: weather and time of day.

AirSim's intensities have no unit. At intensity x of a parameter,

    Rain    100 x^2 mm/h                 0.1: drizzle of 1; 0.3: a shower of 9; 1: a cloudburst
    Snow    8 x^2 mm/h, as water         1: hardly anything is seen beyond 170 m
    Fog     3.912 x^2 / 25 m of extinction: a visibility of 25 m at 1
    Dust    3.912 x^2 / 60 m of extinction

They add to the scene's own weather, up to the limits of sim/scene/weather.py. Rain and snow at once are not modelled:
the one that takes more light falls. Roadwetness, RoadSnow, MapleLeaf and RoadLeaf have no effect.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

from hil.apps.airsim.settings.settings import AirSimSettings
from signals.time import NS_PER_S
from sim.scene.precipitation import rain, snow
from sim.scene.scene import Scene
from sim.scene.weather import MOST_RAIN_MM_PER_H, MOST_SNOW_MM_PER_H, NEAREST_VISIBILITY_M, Weather

RAIN, ROAD_WETNESS, SNOW, ROAD_SNOW, MAPLE_LEAF, ROAD_LEAF, DUST, FOG, ENABLED = range(9)
SUMMER_TIME = timedelta(hours=1)
_RAIN_MM_PER_H, _SNOW_MM_PER_H = 100.0, 8.0  # at intensity 1
_VISIBILITY_M = {FOG: 25.0, DUST: 60.0}  # at intensity 1


@dataclass
class Surroundings:
    """Weather and time of day of one server. `version` grows with every change that pictures show."""

    weather_enabled: bool = False
    weather: dict[int, float] = field(default_factory=dict)  # by WeatherParameter, 0..1
    clock: datetime | None = None  # time of day at `clock_t_ns`; None: the light of the scene
    clock_t_ns: int = 0
    clock_speed: float = 1.0
    move_sun: bool = True
    update_ns: int = 60 * NS_PER_S
    _present: tuple[Scene, Scene] | None = None  # a scene, and that scene in the weather
    version: int = 0

    def weather_of(self, own: Weather) -> Weather:
        """Return the present weather of a scene whose own weather is `own`."""
        if not (self.weather_enabled and any(self.weather.get(kind) for kind in (RAIN, SNOW, DUST, FOG))):
            return own
        share = {kind: self.weather.get(kind, 0.0) ** 2 for kind in (RAIN, SNOW, DUST, FOG)}
        rain_mm_per_h = min(own.rain_mm_per_h + _RAIN_MM_PER_H * share[RAIN], MOST_RAIN_MM_PER_H)
        snow_mm_per_h = min(own.snow_mm_per_h + _SNOW_MM_PER_H * share[SNOW], MOST_SNOW_MM_PER_H)
        if rain_mm_per_h > 0.0 and snow_mm_per_h > 0.0:
            if rain(rain_mm_per_h).extinction_per_m > snow(snow_mm_per_h).extinction_per_m:
                snow_mm_per_h = 0.0
            else:
                rain_mm_per_h = 0.0
        per_m = sum(share[kind] / visibility_m for kind, visibility_m in _VISIBILITY_M.items())
        per_m += 0.0 if own.visibility_m is None else 1.0 / own.visibility_m
        return own.model_copy(
            update={
                "rain_mm_per_h": rain_mm_per_h,
                "snow_mm_per_h": snow_mm_per_h,
                "visibility_m": max(1.0 / per_m, NEAREST_VISIBILITY_M) if per_m > 0.0 else None,
            }
        )

    def present(self, scene: Scene) -> Scene:
        """Return the scene in the present weather: the same object until a client changes the weather."""
        if self._present is None or self._present[0] is not scene:
            self._present = scene, scene
        weather = self.weather_of(scene.weather)
        if self._present[1].weather != weather:
            self._present = scene, scene.model_copy(update={"weather": weather})
        return self._present[1]

    def take_settings(self, settings: AirSimSettings, epoch_ns: int) -> None:
        """Take the time of day of the settings."""
        day = settings.time_of_day
        if day.enabled:
            start = day.start if day.start is not None else datetime.fromtimestamp(epoch_ns / NS_PER_S, UTC)
            start = start if start.tzinfo is not None else start.replace(tzinfo=UTC)
            self.clock = start - SUMMER_TIME if day.daylight_saving else start
            self.clock_speed, self.move_sun = day.clock_speed, day.move_sun
            self.update_ns = max(1, round(day.update_interval_s * NS_PER_S))
