"""The path that a plane can fly through the waypoints of a plan, as pieces of straight line in the x-y plane of W.

A plane turns with a finite radius, so a plan's corners cannot be flown. At every corner the two legs are joined by an
arc of radius R that touches both (a fly-by turn); where a leg is too short for it, by the largest arc that fits. A turn
back, by more than 120 degrees, may be flown anywhere within 3 R of its corner. R is
that of a level turn at the cruise airspeed with a bank of 35 degrees, R = V^2 / (g tan 35). At a loiter the path is its
circle, from which the next leg leaves along the tangent.

Cross-track error is the distance from the nearest of the pieces that belong to the leg being flown: its straight part,
the turns or circles at both ends, and the straight parts before and after.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.config.missions.path import Leg, LegKind, turns_of
from hil.config.missions.places import LAND_COMMANDS, LOITER_RADII, LOITER_TIME
from signals.mission import MissionItem

Float64 = NDArray[np.float64]
Place = tuple[float, float]
_ARC_RAD = math.radians(4.0)  # between two points of an arc: its chord is R (1 - cos 2 deg) = 0.0006 R inside it
_DEFAULT_LOITER_M = 80.0  # PX4's NAV_LOITER_RAD
_LEAST_M = 1.0
_BACK_RAD, _BACK = math.radians(120.0), 3.0  # turns back, and how many radii they may take


@dataclass(frozen=True)
class Stop:
    """A place of the plan. `loiter_m`: signed radius of the circle about it, clockwise positive; 0: flown through.

    `turns` and `time_s` are what a loiter asks for before the plan goes on.
    """

    place: Place
    loiter_m: float = 0.0
    leg: Leg | None = None  # the waypoint's; None for the start and the landing
    turns: float = 0.0
    time_s: float = 0.0


def loiter_radius_m(item: MissionItem) -> float:
    """Return the signed radius of a loiter item, 0 for any other."""
    index = LOITER_RADII.get(item.command)
    if index is None:
        return 0.0
    radius_m = (item.param1, item.param2, item.param3)[index]
    return radius_m if radius_m == radius_m and radius_m != 0.0 else _DEFAULT_LOITER_M


def stops_of(legs: Sequence[Leg], items: Sequence[MissionItem]) -> list[Stop]:
    """Return the places of a plan in flying order, from the end of the take-off to the landing."""
    stops: list[Stop] = []
    for leg in legs:
        place = (leg.end_W[0], leg.end_W[1])
        if leg.kind is LegKind.CLIMB:
            stops.append(Stop((leg.start_W[0], leg.start_W[1])))
            if math.dist(place, stops[0].place) > _LEAST_M:
                stops.append(Stop(place))
        elif leg.kind is LegKind.FLY:
            if not stops:
                stops.append(Stop((leg.start_W[0], leg.start_W[1])))
            item = items[leg.seq]
            time_s = item.param1 if item.command == LOITER_TIME and not math.isnan(item.param1) else 0.0
            stops.append(Stop(place, loiter_radius_m(item), leg, abs(turns_of(item)), time_s))
        elif leg.kind is LegKind.APPROACH and items[leg.seq].command in LAND_COMMANDS:
            stops.append(Stop(place))
    return stops


class FlyablePath:
    """Pieces of the path by the stop that they lead to."""

    def __init__(self, stops: Sequence[Stop], radius_m: float) -> None:
        self.stops = list(stops)
        self._radius_m = radius_m
        self._turns_back = [abs(self._change(i)) > _BACK_RAD for i in range(len(self.stops))]
        self._turns = [self._turn(i) for i in range(len(self.stops))]
        straight = [self._straight(i) for i in range(len(self.stops))]
        self._near = []
        for i in range(len(self.stops)):
            pieces = straight[max(i - 1, 0) : i + 2] + self._turns[max(i - 1, 0) : i + 1]
            self._near.append(np.concatenate([p for p in pieces if len(p)] or [np.zeros((0, 4))]))

    def error_m(self, target: int, place: Place) -> float | None:
        """Return the distance of a place from the path near the leg to the stop `target`."""
        for i in range(max(target - 2, 0), min(target + 1, len(self.stops))):
            if self._turns_back[i] and math.dist(place, self.stops[i].place) <= _BACK * self._radius_m:
                return 0.0
        pieces = self._near[target]
        if not len(pieces):
            return None
        a, b = pieces[:, :2], pieces[:, 2:]
        along, to = b - a, np.asarray(place) - a
        squared = np.einsum("ij,ij->i", along, along)
        s = np.clip(np.einsum("ij,ij->i", to, along) / np.where(squared > 0.0, squared, 1.0), 0.0, 1.0)
        away = to - s[:, None] * along
        return math.sqrt(float(np.min(np.einsum("ij,ij->i", away, away))))

    def points(self) -> Float64:
        """Return the starts and ends of all pieces, for drawing: (n, 4)."""
        return np.concatenate([self._near[i] for i in range(len(self.stops))] or [np.zeros((0, 4))])

    def _change(self, i: int) -> float:
        """Return the change of course at a stop that is flown through, left positive; 0 at the ends."""
        if not 0 < i < len(self.stops) - 1 or self.stops[i].loiter_m:
            return 0.0
        a, b, c = (self.stops[k].place for k in (i - 1, i, i + 1))
        if math.dist(a, b) < _LEAST_M or math.dist(b, c) < _LEAST_M:
            return 0.0
        out = math.atan2(c[1] - b[1], c[0] - b[0])
        return math.remainder(out - math.atan2(b[1] - a[1], b[0] - a[0]), math.tau)

    def _turn(self, i: int) -> Float64:
        """Return the arc at a stop, or the circle about it."""
        here = self.stops[i]
        if here.loiter_m:
            return _arc(here.place, abs(here.loiter_m), 0.0, math.tau)
        change = self._change(i)
        if abs(change) < 1e-3:
            return np.zeros((0, 4))
        before, after = self.stops[i - 1].place, self.stops[i + 1].place
        first, second = math.dist(before, here.place), math.dist(here.place, after)
        course_in = math.atan2(here.place[1] - before[1], here.place[0] - before[0])
        half = math.tan(min(0.5 * abs(change), math.radians(85.0)))
        radius = min(self._radius_m, 0.5 * min(first, second) / half)
        start = _ahead(here.place, course_in, -radius * half)
        side = math.copysign(1.0, change)  # left positive
        centre = _ahead(start, course_in + side * 0.5 * math.pi, radius)
        return _arc(centre, radius, course_in - side * 0.5 * math.pi, change)

    def _straight(self, i: int) -> Float64:
        """Return the straight part of the leg to a stop; after a loiter it begins at the tangent."""
        if i == 0:
            return np.zeros((0, 4))
        before, here = self.stops[i - 1], self.stops[i]
        start = _tangent(before.place, before.loiter_m, here.place) if before.loiter_m else before.place
        return np.array([[*start, *here.place]])


def _ahead(place: Place, course: float, distance: float) -> Place:
    return (place[0] + distance * math.cos(course), place[1] + distance * math.sin(course))


def _arc(centre: Place, radius: float, start: float, sweep: float) -> Float64:
    count = max(1, math.ceil(abs(sweep) / _ARC_RAD))
    angles = start + sweep * np.arange(count + 1) / count
    points = np.column_stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)])
    return np.hstack([points[:-1], points[1:]])


def _tangent(centre: Place, loiter_m: float, to: Place) -> Place:
    """Return where the tangent to a place leaves a circle flown clockwise (positive radius) or not."""
    radius, distance = abs(loiter_m), math.dist(centre, to)
    if distance <= radius:
        return centre
    bearing = math.atan2(to[1] - centre[1], to[0] - centre[0])
    aside = math.acos(radius / distance)
    return _ahead(centre, bearing + (aside if loiter_m > 0.0 else -aside), radius)
