"""Surroundings that clients set: weather, time of day, and the drawings of simPlot*. Cameras and pages read them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from hil.apps.airsim.settings.settings import AirSimSettings
from signals.time import NS_PER_S

RAIN, ROAD_WETNESS, SNOW, ROAD_SNOW, MAPLE_LEAF, ROAD_LEAF, DUST, FOG, ENABLED = range(9)
MOST_DRAWINGS = 1000
SUMMER_TIME = timedelta(hours=1)


class Drawing(NamedTuple):
    """Drawing of a client, in the world's NED."""

    kind: str  # points, line_strip, line_list, arrows, strings, transforms
    content: tuple[Any, ...]
    colour: tuple[float, ...]
    size: float
    end_ns: int | None  # simulated time at which it disappears; None: it stays until simFlushPersistentMarkers


@dataclass
class Surroundings:
    """Weather, time of day and drawings of one server. `version` grows with every change that pictures show."""

    weather_enabled: bool = False
    weather: dict[int, float] = field(default_factory=dict)  # by WeatherParameter, 0..1
    clock: datetime | None = None  # time of day at `clock_t_ns`; None: the light of the scene
    clock_t_ns: int = 0
    clock_speed: float = 1.0
    move_sun: bool = True
    update_ns: int = 60 * NS_PER_S
    drawings: list[Drawing] = field(default_factory=list)
    drawn: Counter[str] = field(default_factory=Counter)  # drawings so far, by kind
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

    def draw(self, drawing: Drawing, t_ns: int) -> None:
        """Add a drawing; those that are over, and the oldest of too many, are dropped."""
        kept = [each for each in self.drawings if each.end_ns is None or each.end_ns > t_ns]
        self.drawings = [*kept[-MOST_DRAWINGS + 1 :], drawing]
        self.drawn[drawing.kind] += 1

    def flush_persistent(self) -> None:
        """Remove the drawings that would stay."""
        self.drawings = [drawing for drawing in self.drawings if drawing.end_ns is not None]
