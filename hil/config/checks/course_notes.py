"""Notes on a mission whose straight ways lead through solid things of the scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from hil.config.bench import Bench
from hil.config.missions.path import Leg, LegKind
from signals.samples import Vec3
from sim.physics.course import Obstacle, obstacles
from sim.physics.fixed_wing import is_plane

_SHOWN = 3  # things that are told singly
_MAX_M = 3000.0  # of a mission that are looked at, in one or two seconds of processor time
_GROUND_M = 0.5  # so high over the ground begin climbs and end descents


class _Way(NamedTuple):
    """One straight way of a mission and the item that it leads to."""

    start_W: Vec3
    end_W: Vec3
    seq: int
    lands: bool

    @property
    def length_m(self) -> float:
        return math.dist(self.start_W, self.end_W)


def course_notes(bench: Bench) -> list[str]:
    """Describe what the vehicle of a bench would touch on the straight ways of its mission, of what stands still."""
    if bench.mission is None or bench.scene.is_bare:
        return []
    ways, left_m, whole_m = [], _MAX_M, 0.0
    for way in _ways(bench):
        whole_m += way.length_m
        if left_m > 0.0:
            ways.append(way)
            left_m -= way.length_m
    notes: dict[str, str] = {}  # by what is met
    for way, obstacle in _met(bench, ways):
        notes.setdefault(obstacle.name, _told(bench, way, obstacle))
    shown = list(notes.values())[:_SHOWN]
    if len(notes) > _SHOWN:
        shown[-1] += f"; {len(notes) - _SHOWN} more in the way"
    looked_m = sum(way.length_m for way in ways)
    if looked_m < whole_m:
        shown.append(f"mission: only {looked_m:.0f} m of {whole_m:.0f} m were searched for things in the way")
    return shown


def first_note(bench: Bench) -> str:
    """Return the first of these notes of the whole mission, "" if nothing is in the way."""
    return next((_told(bench, way, obstacle) for way, obstacle in _met(bench, list(_ways(bench)))), "")


def _met(bench: Bench, ways: list[_Way]) -> Iterator[tuple[_Way, Obstacle]]:
    for obstacle in obstacles(bench.scene, bench.vehicle, [(way.start_W, way.end_W) for way in ways]):
        way = ways[obstacle.course]
        if not (way.lands and obstacle.is_ground):  # the ground may be higher there than at home
            yield way, obstacle


def _told(bench: Bench, way: _Way, obstacle: Obstacle) -> str:
    assert bench.mission is not None
    where, item = bench.mission.sources[way.seq]
    x, y, z = obstacle.p_W
    place = f"({x:.1f}, {y:.1f}, {z:.1f})"
    if way.lands:
        return f"{where}: {item}: the landing there comes down on {obstacle.name}, at {place}"
    way_text = f"{where}: {item}: the straight way there meets {obstacle.name} after {obstacle.after_m:.1f} m"
    return f"{way_text}, at {place}: fly higher, or around it"


def _ways(bench: Bench) -> Iterator[_Way]:
    """Yield each way of the mission once. Climbs lead straight up first; planes climb and land along slopes."""
    told: set[tuple[Vec3, Vec3]] = set()
    returns = {leg.seq for leg in bench.legs if leg.kind is LegKind.RETURN}  # at heights that the autopilot chooses
    standing_m = bench.vehicle.standing_height_m + _GROUND_M
    for leg in bench.legs:
        if leg.seq in returns or (is_plane(bench.vehicle) and leg.kind is not LegKind.FLY):
            continue
        for start, end in _pieces(leg, standing_m):
            if (start, end) not in told:
                told.add((start, end))
                yield _Way(start, end, leg.seq, leg.kind is LegKind.DESCENT)


def _pieces(leg: Leg, standing_m: float) -> list[tuple[Vec3, Vec3]]:
    """Return the straight pieces of a leg without what leads from or to the ground."""
    (x0, y0, z0), (x1, y1, z1) = leg.start_W, leg.end_W
    if leg.kind is LegKind.CLIMB:
        over = (x0, y0, z1)
        return [((x0, y0, min(z0 + standing_m, z1)), over), *([(over, leg.end_W)] if over != leg.end_W else [])]
    if leg.kind is LegKind.DESCENT:
        return [(leg.start_W, (x1, y1, min(z1 + standing_m, z0)))]
    return [(leg.start_W, leg.end_W)] if leg.kind in (LegKind.FLY, LegKind.APPROACH) else []
