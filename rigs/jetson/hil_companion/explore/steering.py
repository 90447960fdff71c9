"""Velocity commands along a path, at most as fast as the vehicle can stop within the space that it has seen.

    v <= speed_mps
    v <= v_stop(known)          known: along the path to the first cell that is unknown or blocked
    v <= v_stop(free)           free: along the present velocity to the first obstacle of the newest sweep
    v <= v_near(d)              from slow_mps at `hard_m` from obstacles to speed_mps at `comfort_m`
    v <= v_corner(s)            v^2 = v_i^2 + 2 a s at a distance s before a corner; v_i^2 = a R, with R the radius of
                                an arc that passes 0.25 m from the corner
    v <= v_stop(left)           left: to the goal

v_stop is `FlightSettings.speed_that_stops_mps`. The velocity points at the path a little ahead. It changes with at most
`accel_mps2`, and with twice that when it brakes for an obstacle.

The retreat rule: nearer than `orange_m` to an obstacle, the vehicle moves straight away from it.

    red      nearer than `red_m`: stop, then back off
    orange   away from the nearest point of the obstacle until the band is left
    clear    follow the plan

The rule ends a little beyond `orange_m`, so that it does not switch on and off at the limit. If another obstacle leaves
no room to retreat, the vehicle stays between the two and follows the plan slowly, since a planned passage is wide
enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hil_companion.explore.planning.flight_settings import FlightSettings
from hil_companion.explore.planning.plan_map import Clearances, PlanMap
from hil_companion.explore.planning.route import nearest_on
from hil_companion.explore.senses import Nearby

_LOOK_MIN_M, _LOOK_S, _LOOK_MAX_M = 0.8, 0.5, 2.5  # distance ahead at which the velocity points: min + time * speed
_CORNER_TIP_M = 0.25
_SEEN_AHEAD_M = 15.0
_KNOWN_SPARE_M = 0.3
_TURN_FROM_MPS = 0.3
_GOAL_GAIN_PER_S = 0.6  # speed per distance left to the goal
_CREEP_MPS = 0.3  # into unknown cells where the newest sweep shows no obstacle
_SPARE_M = 0.15
_RETREAT_MPS = 0.6
_STOPPED_MPS = 0.4  # it brakes below this closing speed before it backs off


@dataclass(frozen=True)
class Retreat:
    """Result of the rule: a velocity, or None to follow the plan."""

    band: str  # "clear", "orange", "red"
    v_W: tuple[float, float] | None


class RetreatRule:
    """The retreat rule, with the hysteresis of its band."""

    def __init__(self) -> None:
        self._retreating = False

    def apply(
        self,
        clearances: Clearances,
        nearest_m: float,
        towards: tuple[float, float],
        v_W: tuple[float, float],
        room_behind_m: float,
    ) -> Retreat:
        """Apply the rule. `towards`: unit vector to the nearest obstacle; `room_behind_m`: free distance behind."""
        limit_m = clearances.orange_m + (_SPARE_M if self._retreating else 0.0)
        if not nearest_m < limit_m:
            self._retreating = False
            return Retreat("clear", None)
        band = "red" if nearest_m < clearances.red_m else "orange"
        self._retreating = True
        closing_mps = v_W[0] * towards[0] + v_W[1] * towards[1]
        if band == "red" and closing_mps > _STOPPED_MPS:
            return Retreat(band, (0.0, 0.0))
        if room_behind_m < nearest_m + 0.1:  # it is already midway between two obstacles
            return Retreat(band, None)
        speed_mps = _RETREAT_MPS if band == "red" else _RETREAT_MPS * min(1.0, max(0.4, (limit_m - nearest_m) / 0.3))
        return Retreat(band, (-speed_mps * towards[0], -speed_mps * towards[1]))


class Steering:
    """Velocity and yaw commands that change continuously from one call to the next."""

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self.v_W = np.zeros(2)
        self.yaw_rad: float | None = None

    def follow(
        self,
        plan_map: PlanMap,
        clearances: Clearances,
        near: Nearby,
        path_W: np.ndarray,
        p_W: np.ndarray,
        v_W: np.ndarray,
        dt_s: float,
        *,
        max_mps: float = math.inf,
    ) -> np.ndarray:
        """Return the velocity command (2,) along a path (n, 2). `p_W`, `v_W`: the vehicle's position and velocity."""
        s = self._settings
        at, place = nearest_on(path_W, p_W)
        speed_mps = float(np.hypot(*v_W))
        look_m = min(_LOOK_MIN_M + _LOOK_S * speed_mps, _LOOK_MAX_M)
        target = _ahead(path_W, at, place, look_m)
        towards = target - p_W
        distance_m = float(np.hypot(*towards))
        left_m = float(np.hypot(*(path_W[-1] - p_W)))
        if distance_m < 1e-6:
            return self.slew(np.zeros(2), dt_s)
        direction = towards / distance_m
        known_m, blocked_m = _ahead_on_map(plan_map, clearances, path_W, at, place)
        known_mps = s.speed_that_stops_mps(known_m - _KNOWN_SPARE_M)
        heading = v_W / speed_mps if speed_mps > _TURN_FROM_MPS else direction
        free_m = min(
            free_ahead_m(near, p_W, heading, clearances.red_m), free_ahead_m(near, p_W, direction, clearances.red_m)
        )
        if free_m > _SEEN_AHEAD_M / 3 and blocked_m > 1.0:
            known_mps = max(known_mps, _CREEP_MPS)
        d = min(plan_map.distance_at(*p_W), plan_map.distance_at(*(p_W + heading * min(1.0, left_m))))
        share = (d - clearances.hard_m) / max(clearances.comfort_m - clearances.hard_m, 1e-6)
        near_mps = s.slow_mps + (s.speed_mps - s.slow_mps) * min(max(share, 0.0), 1.0)
        free_mps = s.speed_that_stops_mps(free_m)
        goal_mps = min(s.speed_that_stops_mps(left_m), max(_GOAL_GAIN_PER_S * left_m, 0.1))
        corner_mps = _corner_mps(s, path_W, at, place)
        limit_mps = min(s.speed_mps, max_mps, known_mps, free_mps, near_mps, corner_mps, goal_mps)
        return self.slew(direction * limit_mps, dt_s, hard=free_mps < speed_mps - 0.3)

    def slew(self, wanted_W: np.ndarray, dt_s: float, *, hard: bool = False) -> np.ndarray:
        """Change the command towards a velocity with at most `accel_mps2`, or twice that if `hard`."""
        change = wanted_W - self.v_W
        size = float(np.hypot(*change))
        max_change = self._settings.accel_mps2 * dt_s * (2.0 if hard else 1.0)
        self.v_W = wanted_W.copy() if size <= max_change else self.v_W + change * (max_change / size)
        return self.v_W

    def stop(self, dt_s: float) -> np.ndarray:
        """Change the command towards zero as hard as allowed."""
        return self.slew(np.zeros(2), dt_s, hard=True)

    def turn(self, yaw_rad: float, v_W: np.ndarray, dt_s: float) -> float:
        """Turn the commanded yaw towards the velocity, by the smaller angle. `yaw_rad`: its value at the first call."""
        if self.yaw_rad is None:
            self.yaw_rad = yaw_rad
        if float(np.hypot(*v_W)) > _TURN_FROM_MPS:
            error_rad = math.remainder(math.atan2(float(v_W[1]), float(v_W[0])) - self.yaw_rad, 2.0 * math.pi)
            max_rad = self._settings.yaw_rate_radps * dt_s
            self.yaw_rad = math.remainder(self.yaw_rad + min(max(error_rad, -max_rad), max_rad), 2.0 * math.pi)
        return self.yaw_rad


def free_ahead_m(near: Nearby, p_W: np.ndarray, direction: np.ndarray, half_width_m: float) -> float:
    """Return how far a disc of this radius can move in a direction before it touches a point of the sweep."""
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
    """Return the point of the path at a distance after a place on segment `at`."""
    here = place
    for point in path_W[at + 1 :]:
        leg_m = float(np.hypot(*(point - here)))
        if leg_m >= distance_m:
            return np.asarray(here + (point - here) * (distance_m / leg_m))
        distance_m -= leg_m
        here = point
    return path_W[-1]


def _samples(plan_map: PlanMap, path_W: np.ndarray, at: int, place: np.ndarray) -> np.ndarray:
    """Return points of the path after a place, a cell apart."""
    step_m = plan_map.cell_m
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


def _ahead_on_map(
    plan_map: PlanMap, clearances: Clearances, path_W: np.ndarray, at: int, place: np.ndarray
) -> tuple[float, float]:
    """Return the distances along the path to the first unknown or blocked point, and to the first blocked point."""
    points, step_m = _samples(plan_map, path_W, at, place), plan_map.cell_m
    rows, columns = plan_map.fine(points)
    blocked = plan_map.distance_m[rows, columns] < clearances.red_m
    bad = blocked | plan_map.unknown[rows, columns]
    bad[: int(0.5 / step_m)] = False  # the vehicle's own position is passable
    known_m = math.inf  # known up to its end
    if bad.any():
        known_m = int(np.argmax(bad)) * step_m
    elif len(points) * step_m >= _SEEN_AHEAD_M - 1.0:
        known_m = len(points) * step_m
    return known_m, float(np.argmax(blocked)) * step_m if blocked.any() else math.inf


def _corner_mps(s: FlightSettings, path_W: np.ndarray, at: int, place: np.ndarray) -> float:
    """Return the largest speed from which the vehicle can brake for the corners ahead."""
    ahead_m = float(np.hypot(*(path_W[at + 1] - place)))
    max_mps = math.inf
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
            max_mps = min(max_mps, math.sqrt(corner + 2.0 * s.accel_mps2 * before_m))
        ahead_m += float(np.hypot(*b))
    return max_mps
