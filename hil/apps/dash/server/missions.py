"""Missions that pages bring: files that were uploaded, and courses that were drawn on the map.

They are kept in one folder, from which the start form offers them, and are checked before: a file that `hil run` would
refuse is not kept. Scripts are not taken, because they may name files and modules of this machine.
"""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from hil.config.missions import load_mission
from signals.documents.validate import StrictModel
from signals.errors import ConfigError
from signals.geodesy import LocalFrame, Site
from signals.samples import Vec3

MAX_FILE_BYTES = 1 << 20
_MAX_FILES = 200
_SUFFIXES = (".plan", ".waypoints")
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_. -]{0,80}\Z")
_ACCEPTANCE_RADIUS_M = 0.65  # PX4 cuts the corners of short legs by more than the default limit with its own 2 m
_WAYPOINT, _LAND, _TAKEOFF, _CHANGE_SPEED = 16, 21, 22, 178

_Metres = Annotated[float, Field(ge=-50_000.0, le=50_000.0)]


class Drawn(StrictModel):
    """Course that was drawn: east and north of the scene's site."""

    points_m: Annotated[list[tuple[_Metres, _Metres]], Field(min_length=1, max_length=500)]
    height_m: Annotated[float, Field(ge=1.0, le=1000.0)]  # above home
    speed_mps: Annotated[float, Field(ge=0.5, le=20.0)]
    land_at_start: bool = False


def keep_file(name: str, data: bytes, folder: Path) -> Path:
    """Check a mission file and keep it under its name. Raises ConfigError or ValueError with what is wrong with it."""
    if not _NAME.match(name) or Path(name).suffix not in _SUFFIXES:
        raise ValueError(f"{name[:80]!r} is not a mission of QGroundControl; give a file NAME.plan or NAME.waypoints")
    if len(data) > MAX_FILE_BYTES:
        raise ValueError(f"{name} has more than {MAX_FILE_BYTES >> 20} MB, which no mission needs")
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / name).exists() and sum(1 for _ in folder.iterdir()) >= _MAX_FILES:
        raise ValueError(f"{folder} has {_MAX_FILES} files already; remove those that are not needed")
    with tempfile.TemporaryDirectory(dir=folder, prefix=".") as checked:  # the readers name the file in messages
        path = Path(checked) / name
        path.write_bytes(data)
        try:
            load_mission(path)
        except ConfigError as error:
            raise ValueError(
                str(error).replace(f"{checked}/", "").replace(f"{os.path.relpath(checked)}/", "")
            ) from None
        os.replace(path, folder / name)
    return folder / name


def keep_drawn(course: Mapping[str, Any], site: Site, start_W: Vec3, folder: Path) -> Path:
    """Write a course that was drawn as a mission, named by the time. Raises ValueError for one that is wrong.

    `start_W`: where the vehicle starts.
    """
    try:
        drawn = Drawn.model_validate(course)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    stem = f"drawn-{time.strftime('%Y%m%d-%H%M%S')}"
    taken = {path.name for path in folder.glob(f"{stem}*")} if folder.is_dir() else set()
    name = next(name for n in range(len(taken) + 1) if (name := f"{stem}{f'-{n}' if n else ''}.waypoints") not in taken)
    return keep_file(name, waypoints_text(drawn, site, start_W).encode(), folder)


def waypoints_text(drawn: Drawn, site: Site, start_W: Vec3) -> str:
    """Return a course as a file "QGC WPL 110": take-off at the start, the points in order, landing."""
    frame, height_m = LocalFrame(site), drawn.height_m
    home = frame.geodetic_from_enu(start_W)
    places = [frame.geodetic_from_enu((east, north, start_W[2]))[:2] for east, north in drawn.points_m]
    if drawn.land_at_start:
        places.append(home[:2])
    rows: list[tuple[int, int, Sequence[float], tuple[float, float, float]]] = [
        (0, _WAYPOINT, (), home),
        (3, _TAKEOFF, (), (0.0, 0.0, height_m)),  # where it stands
        (2, _CHANGE_SPEED, (1.0, drawn.speed_mps, -1.0), (0.0, 0.0, 0.0)),
    ]
    rows += [(3, _WAYPOINT, (0.0, _ACCEPTANCE_RADIUS_M), (*place, height_m)) for place in places]
    rows.append((3, _LAND, (), (*places[-1], 0.0)))
    lines = ["QGC WPL 110"]
    for index, (mav_frame, command, params, (latitude_deg, longitude_deg, altitude_m)) in enumerate(rows):
        four = "\t".join(f"{value:g}" for value in [*params, 0.0, 0.0, 0.0, 0.0][:4])
        place = f"{latitude_deg:.9f}\t{longitude_deg:.9f}\t{altitude_m:.3f}"
        lines.append(f"{index}\t0\t{mav_frame}\t{command}\t{four}\t{place}\t1")
    return "\n".join(lines) + "\n"
