"""The almanac of a GPS that sees the sky: its orbits take the place of the file's name in the settings.

A run's own settings then hold what the file held, which may change later.
"""

from __future__ import annotations

from pathlib import Path

from hil.config.layers import Settings
from hil.config.sensors.preset_values import named_file
from signals.documents.document import Place, shown_path
from signals.documents.validate import at
from signals.errors import ConfigError, Problem
from sim.gnss.almanac import read_almanac
from sim.sensors.gps import GpsParameters


def with_almanac(parameters: GpsParameters, settings: Settings, place: Place, problems: list[Problem]) -> GpsParameters:
    """Return the parameters with the orbits of their almanac; appends what is wrong with it to `problems`."""
    sky = parameters.sky
    if sky is None or sky.almanac is None:
        return parameters
    here = (*place, "sky", "almanac")
    if sky.orbits:
        problems.append(at(settings, here, "is given, and so are orbits", "leave one out"))
        return parameters
    if "gps" not in (sky.systems or parameters.systems):
        problems.append(at(settings, here, "holds satellites of gps, which systems leaves out", "add gps to systems"))
        return parameters
    path = named_file(sky.almanac, settings, here, problems)
    if path is None:
        return parameters
    try:
        orbits = read_almanac(Path(shown_path(path)))
    except ConfigError as error:
        problems += error.problems
        return parameters
    return parameters.model_copy(update={"sky": sky.model_copy(update={"almanac": None, "orbits": orbits})})
