"""Methods about the surroundings: wind, an external force, weather and time of day."""

from __future__ import annotations

from datetime import UTC, datetime

from hil.apps.airsim.api.session import VEHICLE
from hil.apps.airsim.rpc.arguments import (
    BOOL,
    COLOUR,
    FLOAT,
    TEXT,
    VECTOR,
    Vector,
    one_of,
)
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.settings.settings import MOST_FORCE_N
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.surroundings import ENABLED, SUMMER_TIME
from signals.frames import ned_from_enu
from signals.time import NS_PER_S

_MOST_WIND_MPS = 100.0
_FORMAT = "%Y-%m-%d %H:%M:%S"


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""
    around = sim.surroundings
    clamped: set[int] = set()  # weather parameters whose range was told

    def set_wind(wind: Vector) -> None:
        if not all(abs(component) <= _MOST_WIND_MPS for component in wind):
            raise RpcError(f"a component of the wind {tuple(wind)} is beyond {_MOST_WIND_MPS:g} m/s")
        sim.world.set_wind(ned_from_enu((wind.x_val, wind.y_val, wind.z_val)))

    def set_force(force: Vector) -> None:
        if not sim.flies:
            raise RpcError("simSetExtForce needs vehicles that fly: SimMode Multirotor and FastPhysicsEngine")
        if not all(abs(component) <= MOST_FORCE_N for component in force):
            raise RpcError(f"a component of the force {tuple(force)} is beyond {MOST_FORCE_N:g} N")
        sim.push(ned_from_enu((force.x_val, force.y_val, force.z_val)))

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
                raise RpcError(f"'{start}' is not a date and time; write it as 2018-02-12 15:20:00") from None
            clock = clock or datetime.fromtimestamp(sim.now_ns / NS_PER_S, UTC)
            around.clock = clock - SUMMER_TIME if dst else clock
            around.clock_t_ns, around.clock_speed, around.move_sun = sim.world.t_ns, speed, move_sun
            around.update_ns = max(1, round(max(interval, 0.0) * NS_PER_S))
        around.version += 1

    def set_trace_line(_colour: list[float], _thickness: float, name: str) -> None:
        sim.drone(name)  # an unknown name is an error; the dashboard shows the trails of all vehicles

    return [
        method("simSetWind", set_wind, Parameter("wind", VECTOR)),
        method("simSetExtForce", set_force, Parameter("ext_force", VECTOR)),  # Colosseum's
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
    ]
