"""Reads waypoint files (.waypoints): the text format "QGC WPL 110" of QGroundControl, Mission Planner and MAVProxy.

Format: https://mavlink.io/en/file_formats/#mission_plain_text_file. One line per item, twelve columns:
index, current, frame, command, param 1 to 4, latitude, longitude, altitude, autocontinue.

Mission Planner and MAVProxy write home first, as a waypoint above mean sea level (frame 0). Such a first line is
therefore the planned home and is not flown.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from hil.config.missions.mission import (
    FRAME_GLOBAL,
    JUMP,
    WAYPOINT,
    Geopoint,
    Mission,
    RawItem,
    checked_mission,
    on_globe,
)
from signals.documents.document import read_text, shown_path
from signals.documents.validate import shown
from signals.errors import ConfigError, Problem

_LIMIT_BYTES = 16_000_000
_COLUMNS = ("index", "current", "frame", "command", "param 1", "param 2", "param 3", "param 4", "latitude",
            "longitude", "altitude", "autocontinue")  # fmt: skip
_WHOLE_NUMBERS = (0, 1, 2, 3, 11)  # indices of columns
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?(?:nan|inf|infinity)", re.I | re.A)


def read_waypoints(path: Path, *, site: Geopoint | None = None) -> Mission:
    """Read and check a .waypoints file. Raises ConfigError with every problem found."""
    return parse_waypoints(read_text(path, limit_bytes=_LIMIT_BYTES), path, site=site)


def parse_waypoints(text: str, path: Path, *, site: Geopoint | None = None) -> Mission:
    """Parse and check a mission; `path` is used only in messages. Raises ConfigError with every problem found."""
    source = shown_path(path)
    lines = text.splitlines()
    first = next((line.strip() for line in lines if line.strip()), "")
    if not first:
        raise ConfigError.at(source, "is empty")
    header = lines.index(next(line for line in lines if line.strip()))
    if first.split() != ["QGC", "WPL", "110"]:
        message = f'must begin with "QGC WPL 110", not {first[:40]!r}'
        raise ConfigError.at(f"{source}:{header + 1}", message)
    problems: list[Problem] = []
    items: list[RawItem] = []
    indices: list[int] = []
    for number, line in enumerate(lines[header + 1 :], start=header + 2):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        values = _numbers(line, f"{source}:{number}", problems)
        if values is None:
            indices.append(len(indices))
            continue
        if values[0] != len(indices):
            message = f"has the index {values[0]:g} where {len(indices)} is expected"
            problems.append(Problem(f"{source}:{number}", message, "items count from 0 without gaps"))
        indices.append(int(values[0]))
        items.append(_raw_item(values, f"{source}:{number}"))
    home, flown = _split_home(items)
    if home is not None and not on_globe(home):
        problems.append(Problem(items[0].where(None), "the planned home is not on the globe"))
    return checked_mission(path, source, flown, home, site=site, problems=problems)


def _numbers(line: str, where: str, problems: list[Problem]) -> list[float] | None:
    columns = line.split()
    if len(columns) != len(_COLUMNS):
        message = f"has {len(columns)} columns instead of the {len(_COLUMNS)} of a mission item"
        problems.append(Problem(where, message, ", ".join(_COLUMNS)))
        return None
    values: list[float] = []
    for index, (name, column) in enumerate(zip(_COLUMNS, columns, strict=True)):
        if not _NUMBER.fullmatch(column):
            problems.append(Problem(where, f"{name} must be a number, not {shown(column)}"))
            continue
        value = float(column)
        is_open = math.isnan(value) and 4 <= index < 8
        if not is_open and not (math.isfinite(value) and abs(value) < 3e38):
            problems.append(Problem(where, f"{name} is not finite: {column[:40]}"))
        elif index in _WHOLE_NUMBERS and (value != int(value) or not 0 <= value <= 65535):
            problems.append(Problem(where, f"{name} must be a whole number from 0, not {column}"))
        else:
            values.append(value)
    return values if len(values) == len(_COLUMNS) else None


def _raw_item(values: list[float], where: str) -> RawItem:
    return RawItem(
        where=lambda _: where,
        name=f"item {values[0]:g}",
        frame=int(values[2]),
        command=int(values[3]),
        params=tuple(values[4:11]),  # type: ignore[arg-type]
        autocontinue=values[11] != 0,
    )


def _split_home(items: list[RawItem]) -> tuple[Geopoint | None, list[RawItem]]:
    """Return the planned home, if the first item is one, and the other items. Jump targets are lowered by one then."""
    if not items or items[0].frame != FRAME_GLOBAL or items[0].command != WAYPOINT:
        return None, items
    home = Geopoint(*items[0].params[4:])
    flown: list[RawItem] = []
    for item in items[1:]:
        p1, *rest = item.params
        if item.command == JUMP:
            p2, p3, p4, p5, p6, p7 = rest
            item = RawItem(
                item.where, item.name, item.frame, item.command, (p1 - 1, p2, p3, p4, p5, p6, p7), item.autocontinue
            )
        flown.append(item)
    return home, flown
