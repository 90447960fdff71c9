"""From a path to velocities: as fast as can be stopped within what has been seen, and no faster.

    v <= speed_mps
    v <= v_stop(known)          known: along the path to the first cell that is unknown or blocked
    v <= v_stop(free)           free: along the velocity that is flown, to what the newest sweep shows there
    v <= v_near(d)              from slow_mps at `hard` from obstacles to speed_mps at `comfort`
    v <= v_corner(s)            v_i^2 + 2 a s to the corner that is s ahead; v_i^2 = a R, R the arc that fits into it
                                with a quarter of a metre to its tip
    v <= v_stop(left)           to the goal

v_stop is `FlightSettings.speed_that_stops_mps`. The velocity points at the path a little ahead and changes by no more
than `accel_mps2` allows, braking by twice that where something stands in the way.

The retreat rule: within the orange band of an obstacle move straight away from it until out of the band.

    red      nearer than the clearance leaves: stop, then back off
    orange   away from the obstacle, perpendicular to its surface at the nearest point, until the band is left
    clear    the plan is flown

The band is left with some way to spare, so that the rule does not switch on and off at its edge. Where another obstacle
leaves no room to give way, the vehicle stays between the two and the plan is flown slowly: a passage that was planned
is wide enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hil_companion.explore.plan_map import Berth, PlanMap
from hil_companion.explore.route import nearest_on
from hil_companion.explore.senses import Nearby
from hil_companion.explore.settings import FlightSettings

_LOOK_FIRST_M, _LOOK_S, _LOOK_MOST_M = 0.8, 0.5, 2.5
_CORNER_TIP_M = 0.25
_SEEN_AHEAD_M = 15.0
_KNOWN_SPARE_M = 0.3
_TURN_FROM_MPS = 0.3
_GOAL_GAIN_PER_S = 0.6  # near the goal: metres left to metres per second
_CREEP_MPS = 0.3  # where the next unknown cell is nearer than can be stopped for, but the sweep shows nothing there
_SPARE_M = 0.15
_RETREAT_MPS = 0.6
_STOPPED_MPS = 0.4  # slower than this it may back off: braking comes first


@dataclass(frozen=True)
class Retreat:
    """What the rule wants: a velocity, or None where the plan may be flown."""

    band: str  # "clear", "orange", "red"
    v_W: tuple[float, float] | None


class RetreatRule:
    """Remembers whether it is retreating."""

    def __init__(self) -> None:
        self._retreating = False

    def apply(
        self,
        berth: Berth,
        nearest_m: float,
        towards: tuple[float, float],
        v_W: tuple[float, float],
        room_behind_m: float,
    ) -> Retreat:
        """`towards`: unit vector to the nearest obstacle; `room_behind_m`: free distance on the side away from it."""
        limit_m = berth.orange_m + (_SPARE_M if self._retreating else 0.0)
        if not nearest_m < limit_m:
            self._retreating = False
            return Retreat("clear", None)
        band = "red" if nearest_m < berth.red_m else "orange"
        self._retreating = True
        closing_mps = v_W[0] * towards[0] + v_W[1] * towards[1]
        if band == "red" and closing_mps > _STOPPED_MPS:
            return Retreat(band, (0.0, 0.0))
        if room_behind_m < nearest_m + 0.1:  # as near on the other side: it is in the middle already
            return Retreat(band, None)
        speed_mps = _RETREAT_MPS if band == "red" else _RETREAT_MPS * min(1.0, max(0.4, (limit_m - nearest_m) / 0.3))
        return Retreat(band, (-speed_mps * towards[0], -speed_mps * towards[1]))


class Steering:
    """Remembers the last command: it never jumps."""

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self.v_W = np.zeros(2)
        self.yaw_rad: float | None = None

    def follow(
        self,
        around: PlanMap,
        berth: Berth,
        near: Nearby,
        path_W: np.ndarray,
        p_W: np.ndarray,
        v_W: np.ndarray,
        dt_s: float,
        *,
        most_mps: float = math.inf,
    ) -> np.ndarray:
        """The velocity along a path; `v_W` is the one that is flown."""
        s = self._settings
        at, place = nearest_on(path_W, p_W)
        speed_mps = float(np.hypot(*v_W))
        look_m = min(_LOOK_FIRST_M + _LOOK_S * speed_mps, _LOOK_MOST_M)
        target = _ahead(path_W, at, place, look_m)
        towards = target - p_W
        distance_m = float(np.hypot(*towards))
        left_m = float(np.hypot(*(path_W[-1] - p_W)))
        if distance_m < 1e-6:
            return self.slew(np.zeros(2), dt_s)
        direction = towards / distance_m
        known_m, blocked_m = _ahead_on_map(around, berth, path_W, at, place)
        known_mps = s.speed_that_stops_mps(known_m - _KNOWN_SPARE_M)
        heading = v_W / speed_mps if speed_mps > _TURN_FROM_MPS else direction
        free_m = min(free_ahead_m(near, p_W, heading, berth.red_m), free_ahead_m(near, p_W, direction, berth.red_m))
        if free_m > _SEEN_AHEAD_M / 3 and blocked_m > 1.0:
            known_mps = max(known_mps, _CREEP_MPS)
        d = min(around.distance_at(*p_W), around.distance_at(*(p_W + heading * min(1.0, left_m))))
        share = (d - berth.hard_m) / max(berth.comfort_m - berth.hard_m, 1e-6)
        near_mps = s.slow_mps + (s.speed_mps - s.slow_mps) * min(max(share, 0.0), 1.0)
        free_mps = s.speed_that_stops_mps(free_m)
        goal_mps = min(s.speed_that_stops_mps(left_m), max(_GOAL_GAIN_PER_S * left_m, 0.1))
        corner_mps = _corner_mps(s, path_W, at, place)
        least_mps = min(s.speed_mps, most_mps, known_mps, free_mps, near_mps, corner_mps, goal_mps)
        return self.slew(direction * least_mps, dt_s, hard=free_mps < speed_mps - 0.3)

    def slew(self, wanted_W: np.ndarray, dt_s: float, *, hard: bool = False) -> np.ndarray:
        """Towards a velocity, by what the acceleration allows; `hard` braking allows twice that."""
        change = wanted_W - self.v_W
        size = float(np.hypot(*change))
        most = self._settings.accel_mps2 * dt_s * (2.0 if hard else 1.0)
        self.v_W = wanted_W.copy() if size <= most else self.v_W + change * (most / size)
        return self.v_W

    def stop(self, dt_s: float) -> np.ndarray:
        """Brake."""
        return self.slew(np.zeros(2), dt_s, hard=True)

    def turn(self, yaw_rad: float, v_W: np.ndarray, dt_s: float) -> float:
        """Towards where it flies, the short way round; `yaw_rad` is where it looks now, for the first time."""
        if self.yaw_rad is None:
            self.yaw_rad = yaw_rad
        if float(np.hypot(*v_W)) > _TURN_FROM_MPS:
            off = math.remainder(math.atan2(float(v_W[1]), float(v_W[0])) - self.yaw_rad, 2.0 * math.pi)
            most = self._settings.yaw_rate_radps * dt_s
            self.yaw_rad = math.remainder(self.yaw_rad + min(max(off, -most), most), 2.0 * math.pi)
        return self.yaw_rad


def free_ahead_m(near: Nearby, p_W: np.ndarray, direction: np.ndarray, half_width_m: float) -> float:
    """How far a disc of this radius can go in this direction before it touches what the sweep shows."""
    if not len(near.level_W):
        return _SEEN_AHEAD_M
    d = near.level_W - p_W
    along = d @ direction
    beside = np.abs(d[:, 0] * direction[1] - d[:, 1] * direction[0])
    hits = (beside < half_width_m) & (along > 0.0)
    if not hits.any():
        return _SEEN_AHEAD_M
    touch = along[hits] - np.sqrt(half_width_m * half_width_m - beside[hits] ** 2)
    return float(min(max(touch.min(), 0.0), _SEEN_AHEAD_M))


def _ahead(path_W: np.ndarray, at: int, place: np.ndarray, distance_m: float) -> np.ndarray:
    """The point of the path so far behind a place on segment `at`."""
    here = place
    for point in path_W[at + 1 :]:
        leg_m = float(np.hypot(*(point - here)))
        if leg_m >= distance_m:
            return np.asarray(here + (point - here) * (distance_m / leg_m))
        distance_m -= leg_m
        here = point
    return path_W[-1]


def _samples(around: PlanMap, path_W: np.ndarray, at: int, place: np.ndarray) -> np.ndarray:
    """Points of the path from here on, a cell apart."""
    step_m = around.cell_m
    points, sofar = [], 0.0
    here = place
    for point in path_W[at + 1 :]:
        leg_m = float(np.hypot(*(point - here)))
        count = int(min(leg_m, _SEEN_AHEAD_M - sofar) / step_m) + 1
        points.append(here + np.arange(count)[:, None] * (step_m / max(leg_m, 1e-9)) * (point - here))
        sofar += leg_m
        here = point
        if sofar >= _SEEN_AHEAD_M:
            break
    return np.concatenate(points)


def _ahead_on_map(around: PlanMap, berth: Berth, path_W: np.ndarray, at: int, place: np.ndarray) -> tuple[float, float]:
    """Along the path to the first place that is unknown or too near to something, and to the first that is too near."""
    points, step_m = _samples(around, path_W, at, place), around.cell_m
    rows, columns = around.fine(points)
    blocked = around.distance_m[rows, columns] < berth.red_m
    bad = blocked | around.unknown[rows, columns]
    bad[: int(0.5 / step_m)] = False  # where it is, it can be
    known_m = math.inf  # to its end
    if bad.any():
        known_m = int(np.argmax(bad)) * step_m
    elif len(points) * step_m >= _SEEN_AHEAD_M - 1.0:
        known_m = len(points) * step_m
    return known_m, float(np.argmax(blocked)) * step_m if blocked.any() else math.inf


def _corner_mps(s: FlightSettings, path_W: np.ndarray, at: int, place: np.ndarray) -> float:
    """The speed from which the corners ahead can still be taken."""
    ahead_m = float(np.hypot(*(path_W[at + 1] - place)))
    most = math.inf
    for i in range(at + 1, len(path_W) - 1):
        if ahead_m > _SEEN_AHEAD_M:
            break
        a, b = path_W[i] - path_W[i - 1], path_W[i + 1] - path_W[i]
        turn = abs(math.atan2(float(a[0] * b[1] - a[1] * b[0]), float(a @ b)))
        if turn > 0.05:
            # An arc tangent to both legs stays R (1 / cos(turn / 2) - 1) from the corner.
            radius_m = _CORNER_TIP_M / max(1.0 / max(math.cos(0.5 * turn), 1e-3) - 1.0, 1e-6)
            corner = max(s.accel_mps2 * radius_m, s.slow_mps * s.slow_mps * 0.5)
            before_m = max(ahead_m - s.reaction_s * s.slow_mps, 0.0)
            most = min(most, math.sqrt(corner + 2.0 * s.accel_mps2 * before_m))
        ahead_m += float(np.hypot(*b))
    return most
