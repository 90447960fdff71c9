"""The planned path of a mission: its legs as straight lines in W (ENU, metres)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from hil.config.missions.item_values import DELAY
from hil.config.missions.mission import (
    CHANGE_SPEED,
    GLOBAL_FRAMES,
    JUMP,
    RETURN,
    SET_HOME,
    TERRAIN_FRAMES,
    Mission,
)
from hil.config.missions.places import (
    ACCEPTING,
    LAND_COMMANDS,
    LOITER_TURNS,
    PLACE_COMMANDS,
    TAKEOFF_COMMANDS,
    TIMES,
    WAYPOINT_COMMANDS,
)
from hil.config.missions.regimes import TRANSITION
from signals.geodesy import LocalFrame
from signals.mission import MissionItem
from signals.samples import Vec3
from sim.scene.scene import Scene

MAX_LEGS = 5_000  # after so many legs a mission counts as endless
ACCEPTANCE_RADIUS_M = 2.0  # PX4's default of NAV_ACC_RAD, for items without a radius
WINGS_REACH_M = 20.0  # a waypoint flown to on wings counts within the radius of a turn and this, at least
SAME_M = 0.05  # places nearer than this are one place, to which nothing is flown


class LegKind(Enum):
    """Purpose of a leg."""

    CLIMB = "climb"  # take-off
    FLY = "fly"  # to a waypoint
    APPROACH = "approach"  # level flight to above the landing place
    DESCENT = "descent"  # landing
    ENDLESS = "endless"  # marks the end of a path that was cut off, because the jump `seq` never ends
    RETURN = "return"  # home, at a height that the autopilot chooses; heights of start and end are meaningless


class Leg(NamedTuple):
    """One straight line of a mission. `seq` is the item it ends at.

    `acceptance_radius_m` is that within which its end counts as reached, at most half of its length (but no less than
    the default): the vehicle would reach a greater one, and those of waypoints around it, without flying there.
    `wait_s` is the time that a multirotor waits at its end, with that of the delays that follow, and `turns` the number
    of circles that it flies about it, clockwise positive. `speed_mps` is the speed that the plan commands of a
    multirotor on the way, 0 if it leaves that to the autopilot.
    """

    kind: LegKind
    seq: int
    start_W: Vec3
    end_W: Vec3
    acceptance_radius_m: float = ACCEPTANCE_RADIUS_M
    wait_s: float = 0.0
    turns: float = 0.0
    speed_mps: float = 0.0


class PlanPoint(NamedTuple):
    """The end of a leg with its label: the number of a waypoint from 1, or a word."""

    p_W: Vec3
    label: str


_WORDS = {LegKind.CLIMB: "take-off", LegKind.DESCENT: "landing", LegKind.RETURN: "return"}


def waypoint_legs(legs: Sequence[Leg]) -> list[Leg]:
    """Return the legs that end at a waypoint, in flying order; take-off, return and landing are not waypoints.

    Wherever waypoints are counted or numbered for people (run.json, verdict, console, report, dashboard), waypoint n is
    the n-th of these legs, from 1. A waypoint that a jump repeats counts each time.
    """
    return [leg for leg in legs if leg.kind is LegKind.FLY]


def plan_points(legs: Sequence[Leg]) -> list[PlanPoint]:
    """Return the end of every leg with its label; the point above a landing place has none."""
    numbers = {id(leg): str(number) for number, leg in enumerate(waypoint_legs(legs), start=1)}
    return [PlanPoint(leg.end_W, numbers.get(id(leg)) or _WORDS.get(leg.kind, "")) for leg in legs]


def planned_path(mission: Mission, scene: Scene, *, home_W: Vec3 = (0.0, 0.0, 0.0)) -> tuple[Leg, ...]:
    """Return the legs of a mission, with jumps followed, from the start position `home_W` [m].

    Heights above home count from `home_W`, or from where DO_SET_HOME has put it, heights above sea level from the
    scene's site, heights above terrain from the ground z = 0. Landings come down to the height of the start. Splines
    and circles become straight lines between their points. A mission that does not end within `MAX_LEGS` is cut off
    there and ends with a leg of kind `ENDLESS`.
    """
    frame = LocalFrame(scene.site)
    legs: list[Leg] = []
    here = home_W
    ground_m = home_W[2]
    order, endless_seq = _flown_order(mission.items)
    speed_mps = 0.0
    waits = False  # at the end of the newest leg: after a transition, a VTOL is elsewhere
    for item in order:
        kind = item.command
        waits = kind in PLACE_COMMANDS or (waits and kind != TRANSITION)
        if kind == RETURN:
            above = (home_W[0], home_W[1], here[2])
            ground = (home_W[0], home_W[1], ground_m)
            legs += [Leg(LegKind.RETURN, item.seq, here, above), Leg(LegKind.DESCENT, item.seq, above, ground)]
            here = ground
        elif kind in LAND_COMMANDS:
            there = _place(item, frame, scene, here, home_W)
            above = (there[0], there[1], here[2])
            ground = (there[0], there[1], ground_m)
            if above != here:
                legs.append(Leg(LegKind.APPROACH, item.seq, here, above))
            legs.append(Leg(LegKind.DESCENT, item.seq, above, ground))
            here = ground
        elif kind in TAKEOFF_COMMANDS or kind in WAYPOINT_COMMANDS:
            there = _place(item, frame, scene, here, home_W)
            leg_kind = LegKind.CLIMB if kind in TAKEOFF_COMMANDS else LegKind.FLY
            radius_m = min(named_radius_m(item) or ACCEPTANCE_RADIUS_M, _greatest_radius_m(legs, here, there))
            wait_s = max(item.param1, 0.0) if kind in TIMES and item.param1 == item.param1 else 0.0
            legs.append(Leg(leg_kind, item.seq, here, there, radius_m, wait_s, turns_of(item), speed_mps))
            here = there
        elif kind == CHANGE_SPEED:
            speed_mps = _speed_mps(item)
        elif kind == SET_HOME:
            home_W = here if item.param1 == 1.0 or not (item.lat_degE7 or item.lon_degE7) else _new_home(item, frame)
        elif kind == DELAY and waits and item.param1 > 0.0:
            legs[-1] = legs[-1]._replace(wait_s=legs[-1].wait_s + item.param1)
    if endless_seq is not None:
        legs.append(Leg(LegKind.ENDLESS, endless_seq, here, here))
    return tuple(legs)


def turns_of(item: MissionItem) -> float:
    """Return the number of circles that a loiter with turns makes, clockwise positive; without a number one."""
    turns = 1.0 if item.param1 != item.param1 else item.param1
    return math.copysign(turns, item.param3) if item.command == LOITER_TURNS else 0.0


def _speed_mps(item: MissionItem) -> float:
    """Return the speed after a DO_CHANGE_SPEED, 0 if it is the autopilot's own.

    For a multirotor all autopilots take an airspeed (0) as one over ground (1). A speed of climb or descent (2, 3) is
    for PX4 and the mock one over ground, too, and for ArduCopter leaves that as it was; -1 is for PX4 its own.
    """
    return item.param2 if item.param1 in (0.0, 1.0) and item.param2 > 0.0 else 0.0


def named_radius_m(item: MissionItem) -> float | None:
    """Return the acceptance radius that an item names: param 2 of a plain waypoint."""
    return item.param2 if item.command in ACCEPTING and item.param2 > 0.0 else None


def _greatest_radius_m(legs: Sequence[Leg], start_W: Vec3, end_W: Vec3) -> float:
    """Return the greatest acceptance radius at the end of a leg; at a place again, that of the time before serves."""
    length_m = math.dist(start_W[:2], end_W[:2])
    before_m = legs[-1].acceptance_radius_m if legs and length_m <= SAME_M else 0.0
    return max(ACCEPTANCE_RADIUS_M, 0.5 * length_m, before_m)


def _flown_order(items: tuple[MissionItem, ...]) -> tuple[list[MissionItem], int | None]:
    """Return the items in the order in which they are flown, and the sequence number of an endless jump, or None.

    DO_JUMP leads to item `param1`, `param2` times (-1: without end).
    """
    order: list[MissionItem] = []
    jumped: dict[int, int] = {}  # index of a jump -> times it was followed
    index = 0
    last_jump: int | None = None
    # Bounded, because an endless loop of items without a place would never fill `order`.
    for _ in range(20 * MAX_LEGS):
        if index >= len(items):
            return order, None
        if len(order) >= MAX_LEGS:
            break
        item = items[index]
        if item.command == JUMP:
            done = jumped.get(index, 0)
            if item.param2 < 0 or done < item.param2:
                jumped[index] = done + 1
                last_jump = index
                index = int(item.param1)
                continue
        else:
            order.append(item)
        index += 1
    return order, last_jump


def _new_home(item: MissionItem, frame: LocalFrame) -> Vec3:
    """Return the place of a DO_SET_HOME in W [m]; its altitude is above sea level whatever its frame."""
    return frame.enu_from_geodetic(item.lat_degE7 / 1e7, item.lon_degE7 / 1e7, item.alt_m)


def _place(item: MissionItem, frame: LocalFrame, scene: Scene, here: Vec3, home_W: Vec3) -> Vec3:
    """Return the place of an item in W [m]. If the item leaves it open, it is above or below `here`."""
    if item.frame in GLOBAL_FRAMES:
        up = item.alt_m - scene.site.altitude_m
    elif item.frame in TERRAIN_FRAMES:
        up = item.alt_m
    else:
        up = home_W[2] + item.alt_m
    if item.lat_degE7 == 0 and item.lon_degE7 == 0:
        return (here[0], here[1], up)
    latitude_deg, longitude_deg = item.lat_degE7 / 1e7, item.lon_degE7 / 1e7
    east, north, _ = frame.enu_from_geodetic(latitude_deg, longitude_deg, scene.site.altitude_m + up)
    return (east, north, up)
