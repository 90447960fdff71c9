"""Methods about the surroundings: wind, weather, time of day, and drawings in the scene (simPlot*)."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from hil.apps.airsim.api.session import VEHICLE
from hil.apps.airsim.rpc.arguments import (
    BOOL,
    COLOUR,
    FLOAT,
    FLOAT_OR_NAN,
    POSE,
    TEXT,
    VECTOR,
    Vector,
    list_of,
    one_of,
)
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.surroundings import ENABLED, SUMMER_TIME
from signals.frames import ned_from_enu
from signals.time import NS_PER_S

_MOST_WIND_MPS = 50.0
_MOST_POINTS = 100_000
_RED = [1.0, 0.0, 0.0, 1.0]
_FORMAT = "%Y-%m-%d %H:%M:%S"


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    sim = simulation
    around = sim.surroundings
    clamped: set[int] = set()  # weather parameters whose range was told

    def set_wind(wind: Vector) -> None:
        if not all(abs(component) <= _MOST_WIND_MPS for component in wind):
            raise RpcError(f"a component of the wind {tuple(wind)} is beyond {_MOST_WIND_MPS:g} m/s")
        sim.world.set_wind(ned_from_enu((wind.x_val, wind.y_val, wind.z_val)))

    def enable_weather(enabled: bool) -> None:
        around.weather_enabled = enabled
        around.version += 1

    def set_weather(parameter: int, value: float) -> None:
        kept = min(max(value, 0.0), 1.0)
        if kept != value and parameter not in clamped:
            clamped.add(parameter)
            sim.log(f"simSetWeatherParameter: {value:g} counts as {kept:g}, because an intensity goes from 0 to 1")
        if parameter == ENABLED:
            around.weather_enabled = kept > 0.0
        else:
            around.weather[parameter] = kept
        around.version += 1

    def set_time(enabled: bool, start: str, dst: bool, speed: float, interval: float, move_sun: bool) -> None:
        if not enabled:
            around.clock = None
        else:
            try:
                clock = datetime.strptime(start, _FORMAT).replace(tzinfo=UTC) if start else None
            except ValueError:
                raise RpcError(f"'{start}' is no date and time; write it as 2018-02-12 15:20:00") from None
            clock = clock or datetime.fromtimestamp(sim.now_ns / NS_PER_S, UTC)
            around.clock = clock - SUMMER_TIME if dst else clock
            around.clock_t_ns, around.clock_speed, around.move_sun = sim.world.t_ns, speed, move_sun
            around.update_ns = max(1, round(max(interval, 0.0) * NS_PER_S))
        around.version += 1

    def set_trace_line(_colour: list[float], _thickness: float, name: str) -> None:
        sim.drone(name)  # an unknown name is an error; the line is shown in no picture

    def count(kind: str) -> None:
        if kind not in around.drawn:
            sim.log(f"drawings of the kind {kind} are counted, and shown in no picture")
        around.drawn[kind] += 1

    def plotted(kind: str, name: str, size: str, default: float) -> Method:
        return method(
            name, lambda *_: count(kind), points("points"), colour, optional(size, FLOAT, default), duration, persistent
        )

    def arrows(begin: list[Vector], end: list[Vector], *_: Any) -> None:
        if len(begin) != len(end):
            raise RpcError(f"{len(begin)} starts and {len(end)} ends of arrows; there must be as many of both")
        count("arrows")

    def strings(first: list[Any], second: list[Any], *_: Any) -> None:
        if len(first) != len(second):
            raise RpcError(f"{len(first)} strings and {len(second)} positions; there must be as many of both")
        count("strings")

    def named_transforms(poses: list[Any], names: list[str], *_: Any) -> None:
        if len(poses) != len(names):
            raise RpcError(f"{len(poses)} poses and {len(names)} names; there must be as many of both")
        count("transforms")

    def points(name: str) -> Parameter:
        return Parameter(name, list_of(VECTOR, most=_MOST_POINTS))

    colour = optional("color_rgba", COLOUR, _RED)
    duration = optional("duration", FLOAT_OR_NAN, -1.0)
    persistent = optional("is_persistent", BOOL, False)
    thickness = optional("thickness", FLOAT, 5.0)
    poses = Parameter("poses", list_of(POSE, most=_MOST_POINTS))
    texts = list_of(TEXT, most=_MOST_POINTS)
    return [
        method("simSetWind", set_wind, Parameter("wind", VECTOR)),
        method("simEnableWeather", enable_weather, Parameter("enable", BOOL)),
        method(
            "simSetWeatherParameter",
            set_weather,
            Parameter("param", one_of("WeatherParameter", *range(9))),
            Parameter("val", FLOAT),
        ),
        method(
            "simSetTimeOfDay",
            set_time,
            Parameter("is_enabled", BOOL),
            optional("start_datetime", TEXT, ""),
            optional("is_start_datetime_dst", BOOL, False),
            optional("celestial_clock_speed", FLOAT, 1.0),
            optional("update_interval_secs", FLOAT, 60.0),
            optional("move_sun", BOOL, True),
        ),
        method(
            "simSetTraceLine",
            set_trace_line,
            Parameter("color_rgba", COLOUR),
            optional("thickness", FLOAT, 1.0),
            VEHICLE,
        ),
        method("simFlushPersistentMarkers", lambda: None),
        plotted("points", "simPlotPoints", "size", 10.0),
        plotted("line_strip", "simPlotLineStrip", "thickness", 5.0),
        plotted("line_list", "simPlotLineList", "thickness", 5.0),
        method(
            "simPlotArrows",
            arrows,
            points("points_start"),
            points("points_end"),
            colour,
            thickness,
            optional("arrow_size", FLOAT, 2.0),
            duration,
            persistent,
        ),
        method(
            "simPlotStrings",
            strings,
            Parameter("strings", texts),
            points("positions"),
            optional("scale", FLOAT, 5.0),
            colour,
            duration,
        ),
        method(
            "simPlotTransforms",
            lambda *_: count("transforms"),
            poses,
            optional("scale", FLOAT, 5.0),
            thickness,
            duration,
            persistent,
        ),
        method(
            "simPlotTransformsWithNames",
            named_transforms,
            poses,
            Parameter("names", texts),
            optional("tf_scale", FLOAT, 5.0),
            optional("tf_thickness", FLOAT, 5.0),
            optional("text_scale", FLOAT, 10.0),
            optional("text_color_rgba", COLOUR, _RED),
            duration,
        ),
    ]
