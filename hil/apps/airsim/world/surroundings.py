"""Surroundings that clients set: weather and time of day."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

from hil.apps.airsim.settings.settings import AirSimSettings
from signals.time import NS_PER_S

RAIN, ROAD_WETNESS, SNOW, ROAD_SNOW, MAPLE_LEAF, ROAD_LEAF, DUST, FOG, ENABLED = range(9)
SUMMER_TIME = timedelta(hours=1)


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
    version: int = 0

    def take_settings(self, settings: AirSimSettings, epoch_ns: int) -> None:
        """Take the time of day of the settings."""
        day = settings.time_of_day
        if day.enabled:
            start = day.start if day.start is not None else datetime.fromtimestamp(epoch_ns / NS_PER_S, UTC)
            start = start if start.tzinfo is not None else start.replace(tzinfo=UTC)
            self.clock = start - SUMMER_TIME if day.daylight_saving else start
            self.clock_speed, self.move_sun = day.clock_speed, day.move_sun
            self.update_ns = max(1, round(day.update_interval_s * NS_PER_S))
