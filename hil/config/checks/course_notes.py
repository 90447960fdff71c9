"""Notes on a mission whose straight legs lead through solid things of the scene."""

from __future__ import annotations

from hil.config.bench import Bench
from hil.config.missions.path import Leg, LegKind, planned_path
from signals.samples import Vec3
from sim.physics.course import obstacles

_SHOWN = 3  # things that are told singly
_GROUND_M = 0.5  # so high over the ground begin climbs and end descents
_LEVEL = (LegKind.FLY,)
_KINDS = (LegKind.CLIMB, LegKind.FLY, LegKind.APPROACH, LegKind.DESCENT)


def course_notes(bench: Bench) -> list[str]:
    """Describe what the vehicle of a bench would touch on the straight ways of its mission, of what stands still."""
    if bench.mission is None:
        return []
    courses: dict[tuple[Vec3, Vec3], int] = {}  # each once -> the item that it first leads to
    kinds = _LEVEL if bench.vehicle.rolls else _KINDS  # what rolls climbs and lands along slopes of its own
    standing_m = bench.vehicle.standing_height_m + _GROUND_M
    for leg in planned_path(bench.mission, bench.scene, home_W=bench.config.start.p_W):
        if leg.kind in kinds:
            courses.setdefault(_in_the_air(leg, standing_m), leg.seq)
    items = list(courses.values())
    notes: dict[str, str] = {}  # by what is met
    for name, obstacle in ((each.name, each) for each in obstacles(bench.scene, bench.vehicle, courses)):
        x, y, z = obstacle.p_W
        where, item = bench.mission.sources[items[obstacle.course]]
        text = f"{where}: {item}: the straight way there meets {name} after {obstacle.after_m:.1f} m"
        notes.setdefault(name, f"{text}, at ({x:.1f}, {y:.1f}, {z:.1f}): fly higher, or around it")
    shown = list(notes.values())[:_SHOWN]
    if len(notes) > _SHOWN:
        shown[-1] += f"; {len(notes) - _SHOWN} more in the way"
    return shown


def _in_the_air(leg: Leg, standing_m: float) -> tuple[Vec3, Vec3]:
    """Return start and end of a leg without what leads from or to the ground."""
    start, end = leg.start_W, leg.end_W
    if leg.kind is LegKind.CLIMB:
        start = (start[0], start[1], min(start[2] + standing_m, end[2]))
    if leg.kind is LegKind.DESCENT:
        end = (end[0], end[1], min(end[2] + standing_m, start[2]))
    return start, end
