"""Missions with fewer waypoints, written as .waypoints files."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from hil.config import Bench
from hil.config.bench import site_of
from hil.config.missions import Geopoint, Mission, load_mission
from hil.config.missions.mission import JUMP, POSITION_FRAMES, WAYPOINT, WAYPOINT_COMMANDS
from signals.errors import file_errors
from signals.mission import MissionItem


def mission_to_cut(bench: Bench) -> tuple[Mission | None, str]:
    """Return the mission of a bench as in its file; or None, and the reason why its waypoints cannot be taken out."""
    if bench.vehicles or bench.mission is None or "mission" not in bench.files:
        return None, "the bench has no mission of its own"
    if bench.script is not None:
        return None, "the mission is a script"
    mission = load_mission(bench.files["mission"], site=site_of(bench.scene))
    if any(item.command == JUMP for item in mission.items):
        return None, "the mission has jumps"
    return mission, ""


def write_cut(mission: Mission, keep: Sequence[MissionItem], bench: Bench, folder: Path, name: str = "") -> Path:
    """Write a mission with these waypoints and all other items, and return its file. Raises RecordingError.

    The file is `name`.waypoints, by default a hash of its content.
    """
    kept = [item for item in mission.items if item.command not in WAYPOINT_COMMANDS or item in keep]
    text = waypoints_text(kept, mission.planned_home or site_of(bench.scene))
    path = folder / f"{name or hashlib.blake2b(text.encode(), digest_size=8).hexdigest()}.waypoints"
    with file_errors(path):
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return path.resolve()


def waypoints_text(items: Sequence[MissionItem], home: Geopoint) -> str:
    """Return items as the text of a .waypoints file, with the home position as its first line."""
    lines = ["QGC WPL 110", _line(0, 1, 0, WAYPOINT, (0, 0, 0, 0, *home), 1)]
    for number, item in enumerate(items, start=1):
        scale = 1e7 if item.frame in POSITION_FRAMES else 1.0
        place = (item.lat_degE7 / scale, item.lon_degE7 / scale, item.alt_m)
        params = (item.param1, item.param2, item.param3, item.param4, *place)
        lines.append(_line(number, 0, item.frame, item.command, params, item.autocontinue))
    return "\n".join(lines) + "\n"


def _line(index: int, current: int, frame: int, command: int, params: Sequence[float], autocontinue: int) -> str:
    numbers = [f"{value:.10g}" for value in params]
    return "\t".join([*map(str, (index, current, frame, command)), *numbers, str(autocontinue)])
