"""A mission as it is uploaded to the autopilot, and the checks that missions of every file format pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from hil.config.missions.item_values import wrong_values
from hil.config.missions.places import (
    LAND_COMMANDS,
    MAY_BE_OPEN,
    PLACE_COMMANDS,
    TAKEOFF_COMMANDS,
    WAYPOINT_COMMANDS,
)
from signals.errors import ConfigError, Problem
from signals.geodesy import LocalFrame
from signals.mission import MissionItem

MAX_ITEMS = 2_000  # capacity of the mock autopilot
MAX_HEIGHT_M = 5_000.0  # above home; a multicopter of this class flies lower
MAX_DISTANCE_M = 100_000.0  # from the scene's site
_OTHER_MISSION = (
    "name the mission of this place with --mission, a scene with the site of this mission with --scene, or fly none: "
    "--set mission=null"
)

# MAV_FRAME numbers that a mission may use.
FRAME_GLOBAL, FRAME_MISSION, FRAME_RELATIVE = 0, 2, 3
GLOBAL_FRAMES = (0, 5)  # altitude above mean sea level
RELATIVE_FRAMES = (3, 6)  # altitude above home
TERRAIN_FRAMES = (10, 11)  # altitude above terrain
POSITION_FRAMES = GLOBAL_FRAMES + RELATIVE_FRAMES + TERRAIN_FRAMES

# MAV_CMD numbers.
WAYPOINT, RETURN, LAND, TAKEOFF, JUMP, CHANGE_SPEED, SET_HOME = 16, 20, 21, 22, 177, 178, 179


class Geopoint(NamedTuple):
    """A place on WGS-84; altitude above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


@dataclass(frozen=True)
class Mission:
    """Items in the order of upload, numbered from 0, the first one current.

    `planned_home` is the home position in the file, if it has one; the autopilot uses its own. `sources` are
    'file:line' and name of each item, for messages.
    """

    path: Path
    items: tuple[MissionItem, ...]
    planned_home: Geopoint | None = None
    sources: tuple[tuple[str, str], ...] = field(default=(), compare=False, repr=False)
    notes: tuple[str, ...] = ()  # what the file holds and no autopilot gets

    @property
    def waypoints(self) -> tuple[MissionItem, ...]:
        """Items that name a place to fly to, without take-off and landing."""
        return tuple(item for item in self.items if item.command in WAYPOINT_COMMANDS)

    def problem(self, seq: int, message: str, hint: str = "") -> Problem:
        """Return what is wrong with an item, at its line of the file."""
        where, name = self.sources[seq]
        return Problem(where, f"{name} {message}", hint)

    def first_of(self, found: Mapping[int, str]) -> tuple[str, str]:
        """Return the first text of what was found by item, with its line, and text of how many more there are."""
        seq, text = next(iter(found.items()))
        where, name = self.sources[seq]
        return f"{where}: {name} {text}", f"; {len(found) - 1} more such" if len(found) > 1 else ""


@dataclass(frozen=True)
class RawItem:
    """One item of a file, before scaling. NaN stands for a value that the file leaves open."""

    where: Callable[[int | None], str]  # 'file:line' of params[i], or of the item itself (None)
    name: str  # for messages: 'item 3'
    frame: int
    command: int
    params: tuple[float, float, float, float, float, float, float]
    autocontinue: bool


def checked_mission(
    path: Path,
    source: str,
    items: Sequence[RawItem],
    home: Geopoint | None,
    *,
    site: Geopoint | None,
    problems: list[Problem],
) -> Mission:
    """Scale the items to MISSION_ITEM_INT.

    Raises ConfigError with `problems`, found by the reader of the file, and the reasons why it cannot be flown.
    """
    all_problems = problems_of(source, items, site=site, complete=not problems)
    if len(items) <= MAX_ITEMS:  # of a longer mission only the length is reported
        all_problems = problems + all_problems
    if all_problems:
        raise ConfigError(all_problems)
    sources = tuple((raw.where(None), raw.name) for raw in items)
    return Mission(path, tuple(_item(seq, raw) for seq, raw in enumerate(items)), home, sources)


def _item(seq: int, raw: RawItem) -> MissionItem:
    p1, p2, p3, p4, p5, p6, p7 = raw.params
    # Frames without coordinates carry params 5 and 6 as plain whole numbers (as QGroundControl sends them).
    scale = 1e7 if raw.frame in POSITION_FRAMES else 1.0
    x, y = (0 if math.isnan(v) else round(v * scale) for v in (p5, p6))
    z = 0.0 if math.isnan(p7) else p7
    return MissionItem(seq, raw.frame, raw.command, int(seq == 0), int(raw.autocontinue), p1, p2, p3, p4, x, y, z)


def problems_of(
    source: str, items: Sequence[RawItem], *, site: Geopoint | None, complete: bool = True
) -> list[Problem]:
    """Report why a mission cannot be flown. `site` is the origin of the scene, None if unknown.

    `complete` is False if some items could not be read; missing items are then not reported.
    """
    if len(items) > MAX_ITEMS:
        message = f"has {len(items)} items, more than the {MAX_ITEMS} that are accepted"
        return [Problem(source, message, "split the mission")]
    problems: list[Problem] = []
    far: list[Problem] = []
    for raw in items:
        problems += _item_problems(raw, len(items), site, far)
    if far:  # a mission of another place: said once
        others = f", and so are {len(far) - 1} items more" if len(far) > 1 else ""
        problems.append(replace(far[0], message=far[0].message + others))
    if complete and not problems:
        problems += _pure_loops(items)
    if complete and not any(raw.command in PLACE_COMMANDS for raw in items):
        message = "has no waypoints" if items else "has no waypoints: its list of items is empty"
        problems.append(Problem(source, message, "a mission needs at least one place to fly to"))
    return problems


def _pure_loops(items: Sequence[RawItem]) -> list[Problem]:
    """Report endless jumps from which a mission returns to the same jump without flying to a place.

    The autopilot would never leave such a loop. Jumps with a number of repetitions come to an end and are allowed.
    """
    problems: list[Problem] = []
    for start, raw in enumerate(items):
        index = start
        for _ in range(len(items)):
            item = items[index]
            endless = item.command == JUMP and item.params[1] < 0
            if (index == start and not endless) or item.command in PLACE_COMMANDS or item.command == RETURN:
                break
            index = int(item.params[0]) if endless else index + 1
            if index == start:
                message = f"{raw.name}: the mission never ends: this jumps back for ever and flies to no place"
                problems.append(Problem(raw.where(1), message, "let it jump to a waypoint, or a number of times"))
                break
            if index >= len(items):
                break
    return problems


def on_globe(point: Geopoint) -> bool:
    """Return True if latitude and longitude are in range."""
    return abs(point.latitude_deg) <= 90.0 and abs(point.longitude_deg) <= 180.0


def _item_problems(raw: RawItem, count: int, site: Geopoint | None, far: list[Problem]) -> list[Problem]:
    """Return what is wrong with an item, but for a place too far from the site, which is added to `far`."""
    problems: list[Problem] = []

    def report(index: int | None, message: str, hint: str = "") -> None:
        problems.append(Problem(raw.where(index), f"{raw.name} {message}", hint))

    if raw.frame != FRAME_MISSION and raw.frame not in POSITION_FRAMES:
        report(
            None,
            f"has the coordinate frame {raw.frame}, which missions do not use",
            "known: 0 above sea level, 3 above home, 10 above terrain, 2 no position",
        )
        return problems
    for index, value in enumerate(raw.params):
        if math.isinf(value) or abs(value) > 3e38:
            report(index, f"has a value that is not finite: param {index + 1} = {value}")
    if problems:
        return problems
    for index, message, hint in wrong_values(raw.command, raw.params):
        report(index, message, hint)
    if raw.command == JUMP:
        target = raw.params[0]
        if not (target == target and target == int(target) and 0 <= target < count):
            report(0, "jumps to an item that does not exist")
    if raw.command not in PLACE_COMMANDS:
        if not all(math.isnan(v) or abs(v) < (200 if raw.frame in POSITION_FRAMES else 2**31) for v in raw.params[4:6]):
            report(4, f"cannot be sent: params 5 and 6 are {raw.params[4]:g} and {raw.params[5]:g}")
        return problems
    command_name = PLACE_COMMANDS[raw.command]
    if raw.frame == FRAME_MISSION:
        report(None, f"({command_name}) has the frame 2, which carries no position", "use 3: altitude above home")
        return problems
    return problems + _place_problems(raw, command_name, site, far)


def _place_problems(raw: RawItem, command_name: str, site: Geopoint | None, far: list[Problem]) -> list[Problem]:
    problems: list[Problem] = []
    latitude, longitude, altitude = raw.params[4:]

    def report(index: int, message: str, hint: str = "") -> None:
        problems.append(Problem(raw.where(index), f"{raw.name} ({command_name}) {message}", hint))

    open_place = raw.command in MAY_BE_OPEN and all(math.isnan(v) or v == 0.0 for v in (latitude, longitude))
    if not open_place:
        on_earth = True
        for index, name, value, limit in ((4, "latitude", latitude, 90.0), (5, "longitude", longitude, 180.0)):
            if math.isnan(value):
                report(index, f"has no {name}")
                on_earth = False
            elif abs(value) > limit:
                report(index, f"has the {name} {value:g} deg, outside -{limit:g} to {limit:g} deg")
                on_earth = False
        if on_earth and site is not None:
            distance_m = math.hypot(*LocalFrame(site).enu_from_geodetic(latitude, longitude, site.altitude_m))
            if distance_m > MAX_DISTANCE_M:
                message = (
                    f"{raw.name} ({command_name}) is {distance_m / 1000:.0f} km from the scene's site at "
                    f"{site.latitude_deg:.5f}, {site.longitude_deg:.5f}; "
                    f"at most {MAX_DISTANCE_M / 1000:g} km are accepted"
                )
                far.append(Problem(raw.where(4), message, _OTHER_MISSION))
    if math.isnan(altitude):
        if raw.command not in LAND_COMMANDS:
            report(6, "has no altitude")
        return problems
    ground_m: float | None = 0.0
    if raw.frame in GLOBAL_FRAMES:
        ground_m = None if site is None else site.altitude_m
    height_m = altitude - (ground_m if ground_m is not None else 0.0)
    reference = "the ground" if raw.frame in TERRAIN_FRAMES else "home" if raw.frame in RELATIVE_FRAMES else "the site"
    if height_m > MAX_HEIGHT_M + (0.0 if ground_m is not None else 9_000.0):
        report(6, f"cannot be reached: {height_m:g} m above {reference}, more than {MAX_HEIGHT_M:g} m")
    elif raw.command in TAKEOFF_COMMANDS and ground_m is not None and height_m <= 0.0:
        report(6, f"goes to {height_m:g} m above {reference}: it must climb")
    elif raw.command not in LAND_COMMANDS and ground_m is not None and height_m < 0.0:
        report(6, f"is below the ground: {-height_m:g} m below {reference}")
    return problems
