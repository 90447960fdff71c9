"""Missions: QGroundControl's .plan and .waypoints files, checked and in the units of the MAVLink mission protocol."""

from __future__ import annotations

from pathlib import Path

from hil.missions.mission import Geopoint, Mission
from hil.missions.plan_file import read_plan
from hil.missions.waypoints_file import read_waypoints
from hil.signals.documents.document import shown_path
from hil.signals.errors import ConfigError, Problem

__all__ = ["Geopoint", "Mission", "load_mission"]

_READERS = {".plan": read_plan, ".waypoints": read_waypoints}


def load_mission(path: Path, *, site: Geopoint | None = None) -> Mission:
    """Read a mission file by its suffix and check that it can be flown.

    `site` is where the scene stands; with it, places too far away and altitudes above sea level are checked too.
    Raises ConfigError with every problem found.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        message = f"is not a kind of mission that is known: {path.suffix or 'no suffix'}"
        raise ConfigError([Problem(shown_path(path), message, "known: " + ", ".join(_READERS))])
    return reader(path, site=site)
