"""Check of the almanacs that a bench names: whether they are of the days that it flies in."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from hil.config.layers import Settings
from hil.config.schema import BenchConfig
from signals.documents.validate import at
from signals.errors import Problem
from sim.gnss.gps_time import WEEK_S, utc_of
from sim.gnss.parameters import start_gps_s
from sim.scene.scene import Scene
from sim.sensors.gps import GpsParameters

# GPS satellites are brought back to their slots about once a year, and some are replaced: elements of farther away show
# the sky of another time.
_HOLDS_WEEKS = 52


def almanac_problems(config: BenchConfig, scene: Scene, settings: Settings) -> list[Problem]:
    """Report almanacs that are more than a year away from the begin of the run.

    Orbits that saved settings hold are not checked: the run whose settings they are has had them.
    """
    problems = []
    for name, sensor in config.sensors.items():
        sky = sensor.parameters.sky if isinstance(sensor.parameters, GpsParameters) else None
        stated = _sky_settings(settings, name)
        if sky is None or not sky.orbits or stated.get("orbits"):
            continue
        start_s = start_gps_s(sky, scene.light)
        farthest_s = max((orbit.epoch_s(start_s) for orbit in sky.orbits), key=lambda t_s: abs(t_s - start_s))
        weeks = abs(farthest_s - start_s) / WEEK_S
        if weeks <= _HOLDS_WEEKS:
            continue
        of, begins = _shown(utc_of(farthest_s)), _shown(utc_of(start_s))
        file = stated.get("almanac") or "of its preset"
        message = (
            f"({file}) has orbits of {of}, {weeks:.0f} weeks from the run's begin, {begins}; they hold {_HOLDS_WEEKS}"
        )
        hint = f"take one of that time, or set sky.utc to {of}"
        problems.append(at(settings, ("sensors", name, "sky", "almanac"), message, hint))
    return problems


def _sky_settings(settings: Settings, sensor: str) -> dict[str, Any]:
    """Return what the settings state of the sky of a sensor, without its preset."""
    value: Any = settings.data
    for key in ("sensors", sensor, "sky"):
        value = value.get(key) if isinstance(value, dict) else None
    return value if isinstance(value, dict) else {}


def _shown(time: datetime) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ")
