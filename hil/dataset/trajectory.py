"""Preset courses as missions: a square, a circle, a figure of eight, a survey of lanes.

A course begins above the take-off place, closes, and is flown round and round by a jump back, so that the flight is
the same however many frames are wanted of it.

    square        corners (0, 0), (s, 0), (s, s), (0, s)
    circle        of diameter s, through the take-off place and (0, s)
    figure_eight  a lemniscate s wide (Gerono's: s / 2 sin a, s / 2 sin a cos a) about the take-off place
    survey        lanes of length s to the east, s / 4 apart, and back
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from hil.config.schema import Trajectory
from hil.missions.mission import CHANGE_SPEED as SPEED
from hil.missions.mission import FRAME_GLOBAL, FRAME_MISSION, FRAME_RELATIVE, JUMP, TAKEOFF, WAYPOINT
from hil.signals.geodesy import LocalFrame
from sim.scene.scene import Site

_CIRCLE_POINTS, _EIGHT_POINTS, _LANES = 24, 32, 5
_ITEMS = 64  # waypoints before the jump back, where the vehicle stops for a moment


def course(trajectory: Trajectory) -> list[tuple[float, float]]:
    """One round: places (east, north) [m] from the take-off place, without coming back to the first."""
    s = trajectory.side_m
    if trajectory.preset == "square":
        return [(0.0, 0.0), (s, 0.0), (s, s), (0.0, s)]
    if trajectory.preset == "circle":
        turns = [2.0 * math.pi * k / _CIRCLE_POINTS for k in range(_CIRCLE_POINTS)]
        return [(0.5 * s * math.sin(a), 0.5 * s * (1.0 - math.cos(a))) for a in turns]
    if trajectory.preset == "figure_eight":
        turns = [2.0 * math.pi * k / _EIGHT_POINTS for k in range(_EIGHT_POINTS)]
        return [(0.5 * s * math.sin(a), 0.5 * s * math.sin(a) * math.cos(a)) for a in turns]
    lanes = []
    for lane in range(_LANES):
        ends = [(0.0, lane * s / (_LANES - 1)), (s, lane * s / (_LANES - 1))]
        lanes += ends if lane % 2 == 0 else ends[::-1]
    return lanes


def waypoints_text(trajectory: Trajectory, site: Site) -> str:
    """The course as a .waypoints file."""
    frame = LocalFrame(site)
    height = trajectory.height_m
    home = _row(0, FRAME_GLOBAL, WAYPOINT, (0.0,) * 4, (site.latitude_deg, site.longitude_deg), site.altitude_m)
    take_off = _row(1, FRAME_RELATIVE, TAKEOFF, (0.0,) * 4, (site.latitude_deg, site.longitude_deg), height)
    speed = _row(2, FRAME_MISSION, SPEED, (1.0, trajectory.speed_mps, -1.0, 0.0), (0.0, 0.0), 0.0)
    rows = [home, take_off, speed]
    round_W = course(trajectory)
    for x, y in round_W * max(1, _ITEMS // len(round_W)):
        latitude, longitude, _ = frame.geodetic_from_enu((x, y, height))
        rows.append(_row(len(rows), FRAME_RELATIVE, WAYPOINT, (0.0,) * 4, (latitude, longitude), height))
    rows.append(_row(len(rows), FRAME_MISSION, JUMP, (3.0, -1.0, 0.0, 0.0), (0.0, 0.0), 0.0))
    return "\n".join(["QGC WPL 110", *rows, ""])


def _row(
    number: int, frame: int, command: int, params: Sequence[float], place: tuple[float, float], height_m: float
) -> str:
    values = [*params, *place, height_m]
    return "\t".join([str(number), str(int(number == 0)), str(frame), str(command), *(f"{v:.8f}" for v in values), "1"])
