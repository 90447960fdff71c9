"""Preset courses of a data set's flight, as a mission file that repeats one round without end."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hil.config.missions.mission import (
    CHANGE_SPEED,
    FRAME_GLOBAL,
    FRAME_MISSION,
    FRAME_RELATIVE,
    JUMP,
    TAKEOFF,
    WAYPOINT,
)
from hil.config.schema import Trajectory
from signals.geodesy import LocalFrame
from signals.samples import Vec3
from sim.scene.scene import Site

_CIRCLE_POINTS, _FIGURE_EIGHT_POINTS, _LANES = 24, 32, 5
_WAYPOINTS_BEFORE_JUMP = 64  # the vehicle stops briefly at the jump, so it should be rare


def course(trajectory: Trajectory) -> list[tuple[float, float]]:
    """Return the points (east, north) [m] of one round, relative to take-off; the first point is not repeated.

    The preset `points` has its own. The others, with s = `side_m`:

        square         corners (0, 0), (s, 0), (s, s), (0, s)
        circle         diameter s, through the take-off point and (0, s)
        figure_eight   Gerono's lemniscate, s wide: (0.5 s sin a, 0.5 s sin a cos a)
        survey         five lanes of length s, east and back, s / 4 apart
    """
    if trajectory.preset == "points":
        return list(trajectory.points_m)
    s = trajectory.side_m
    if trajectory.preset == "square":
        return [(0.0, 0.0), (s, 0.0), (s, s), (0.0, s)]
    if trajectory.preset == "circle":
        angles_rad = [2.0 * math.pi * k / _CIRCLE_POINTS for k in range(_CIRCLE_POINTS)]
        return [(0.5 * s * math.sin(a), 0.5 * s * (1.0 - math.cos(a))) for a in angles_rad]
    if trajectory.preset == "figure_eight":
        angles_rad = [2.0 * math.pi * k / _FIGURE_EIGHT_POINTS for k in range(_FIGURE_EIGHT_POINTS)]
        return [(0.5 * s * math.sin(a), 0.5 * s * math.sin(a) * math.cos(a)) for a in angles_rad]
    lanes = []
    for lane in range(_LANES):
        ends = [(0.0, lane * s / (_LANES - 1)), (s, lane * s / (_LANES - 1))]
        lanes += ends if lane % 2 == 0 else ends[::-1]
    return lanes


def waypoints_text(trajectory: Trajectory, site: Site, start_W: Vec3 = (0.0, 0.0, 0.0)) -> str:
    """Return the course as the text of a .waypoints file that ends with an unlimited jump back to the first waypoint.

    The text is in Mission Planner's format (`QGC WPL 110`); heights are relative to the home position at `start_W`.
    """
    frame = LocalFrame(site)
    x0, y0, _ = start_W
    latitude, longitude, altitude_m = frame.geodetic_from_enu(start_W)
    height = trajectory.height_m
    home = _row(0, FRAME_GLOBAL, WAYPOINT, (0.0,) * 4, (latitude, longitude), altitude_m)
    take_off = _row(1, FRAME_RELATIVE, TAKEOFF, (0.0,) * 4, (latitude, longitude), height)
    speed = _row(2, FRAME_MISSION, CHANGE_SPEED, (1.0, trajectory.speed_mps, -1.0, 0.0), (0.0, 0.0), 0.0)
    rows = [home, take_off, speed]
    points_W = course(trajectory)
    from_W = (0.0, 0.0)
    for x, y in points_W * max(1, _WAYPOINTS_BEFORE_JUMP // len(points_W)):
        latitude, longitude, _ = frame.geodetic_from_enu((x0 + x, y0 + y, height))
        # Clockwise from north. The vehicle looks along the legs between points; on the other courses it looks north.
        heading_deg = math.degrees(math.atan2(x - from_W[0], y - from_W[1])) if trajectory.preset == "points" else 0.0
        from_W = (x, y)
        params = (0.0, 0.0, 0.0, heading_deg)
        rows.append(_row(len(rows), FRAME_RELATIVE, WAYPOINT, params, (latitude, longitude), height))
    rows.append(_row(len(rows), FRAME_MISSION, JUMP, (3.0, -1.0, 0.0, 0.0), (0.0, 0.0), 0.0))
    return "\n".join(["QGC WPL 110", *rows, ""])


def _row(
    number: int, frame: int, command: int, params: Sequence[float], position_deg: tuple[float, float], height_m: float
) -> str:
    values = [*params, *position_deg, height_m]
    return "\t".join([str(number), str(int(number == 0)), str(frame), str(command), *(f"{v:.8f}" for v in values), "1"])
