"""From waypoints and limits to a path: times, corridor, and the way round a missing solver.

With CasADi the path flies through the waypoints within the corridor. Without it the closed form is used, which knows no
corridor: it stops at both ends of every leg that it would leave, until it leaves none; a leg between two stops is
straight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hil_companion.cuts import corridor
from hil_companion.cuts.snap_path import SnapPath
from hil_companion.cuts.snap_program import SnapProgram

SAME_PLACE_M = 0.05
MAX_LEGS = 12  # flown in one; the solver is dense, and its time grows with the cube
PARTS = (1, 2, 3)  # segments a leg, tried in turn: more of them bend more where the corridor asks for it
MARGIN = 1.001  # peaks lie between the samples


@dataclass(frozen=True)
class Limits:
    speed_mps: float
    accel_mps2: float
    corridor_m: float


def without_repeats(waypoints_W: np.ndarray) -> np.ndarray:
    """The waypoints without those that lie where the one before does."""
    kept: list[np.ndarray] = []
    for p_W in np.asarray(waypoints_W, float).reshape(-1, 3):
        if not kept or float(np.linalg.norm(p_W - kept[-1])) > SAME_PLACE_M:
            kept.append(p_W)
    return np.array(kept).reshape(-1, 3)


def plan(waypoints_W: np.ndarray, limits: Limits, *, solver: bool | None = None) -> SnapPath:
    """A path from rest at the first to rest at the last waypoint. At least two different waypoints are needed."""
    points = without_repeats(waypoints_W)
    if len(points) < 2:
        raise ValueError("a path needs at least two waypoints that are not at the same place")
    with_solver = corridor.available() if solver is None else solver
    whole: SnapPath | None = None
    for first in range(0, len(points) - 1, MAX_LEGS):
        path = _timed(_shape(points[first : first + MAX_LEGS + 1], limits, with_solver), limits)
        whole = path if whole is None else whole.followed_by(path)
    assert whole is not None
    return whole


def _shape(points_W: np.ndarray, limits: Limits, with_solver: bool) -> SnapPath:
    times_s = leg_times_s(points_W, limits)
    if with_solver:
        for parts in PARTS:
            path = corridor.path_within(SnapProgram(points_W, times_s, parts=parts), limits.corridor_m)
            if path is not None:
                return path
    return with_stops(points_W, limits)


def with_stops(points_W: np.ndarray, limits: Limits) -> SnapPath:
    """The closed form, with rests at the ends of every leg that would be left."""
    stops: set[int] = set()
    while True:
        program = SnapProgram(points_W, leg_times_s(points_W, limits, stops), stops=stops)
        path = program.path(program.least())
        left = np.flatnonzero(corridor.distances_m(path, points_W).max(axis=1) > limits.corridor_m)
        more = {int(n) for leg in left for n in (leg, leg + 1)} - stops - {0, len(points_W) - 1}
        if not more:
            return path
        stops |= more


def leg_times_s(points_W: np.ndarray, limits: Limits, stops: set[int] | None = None) -> np.ndarray:
    """A first guess: at the speed limit, and longer by what slowing down for the turn at each end costs."""
    legs = np.diff(points_W, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    slow = np.ones(len(points_W))  # share of the speed that is lost: all where it rests
    for i in range(1, len(points_W) - 1):
        if stops is None or i not in stops:
            slow[i] = 0.5 * (1.0 - legs[i - 1] @ legs[i] / (lengths[i - 1] * lengths[i]))
    reached = np.minimum(limits.speed_mps, np.sqrt(limits.accel_mps2 * lengths))
    times: np.ndarray = lengths / reached + 0.5 * (slow[:-1] + slow[1:]) * reached / limits.accel_mps2
    return times


def _timed(path: SnapPath, limits: Limits) -> SnapPath:
    """As fast as the limits allow."""
    speed = float(np.linalg.norm(path.sampled(1), axis=2).max())
    accel = float(np.linalg.norm(path.sampled(2), axis=2).max())
    return path.stretched(MARGIN * max(speed / limits.speed_mps, (accel / limits.accel_mps2) ** 0.5))
