"""Missions from .plan and .waypoints files, checked and converted to the units of the MAVLink mission protocol."""

from __future__ import annotations

from pathlib import Path

from hil.config.missions.mission import Geopoint, Mission
from hil.config.missions.plan_file import read_plan
from hil.config.missions.waypoints_file import read_waypoints
from signals.documents.document import shown_path
from signals.errors import ConfigError

__all__ = ["Geopoint", "Mission", "load_mission"]

_READERS = {".plan": read_plan, ".waypoints": read_waypoints}


def load_mission(path: Path, *, site: Geopoint | None = None) -> Mission:
    """Read a .plan or .waypoints file and check that it can be flown.

    `site` is the origin of the scene. With it, distances from the scene and altitudes above sea level are checked too.
    Raises ConfigError with every problem found.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        message = f"is not a known kind of mission file: {path.suffix or 'no suffix'}"
        raise ConfigError.at(shown_path(path), message, "known: " + ", ".join(_READERS))
    return reader(path, site=site)
