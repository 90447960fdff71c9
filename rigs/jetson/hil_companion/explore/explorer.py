"""The explorer: flies to a goal through an unmapped place and reports the outcome.

    climb     straight up above the start to the flight's height
    fly       every frame: localise, sense obstacles, plan a route, command a velocity
    outcome   goal: the bench may land the vehicle. Any other outcome: brake, hover over bare ground, report it, and be
              finished `hover_s` later (ground.py)

    goal               within goal_radius_m of it by its own estimate, and slow
    goal_in_obstacle   the goal lies in an obstacle or in a closed area
    no_path            no path is left: the vehicle is enclosed
    stuck              no progress for stuck_s, position unknown, or time_limit_s exceeded
    lidar_lost         no usable sweep for lidar_lost_s; the vehicle brakes after a third of a second and does not climb
    imu_lost           roll and pitch unknown for imu_lost_s; the vehicle brakes at once

Only sensor data are used, never the autopilot's own position: velocity commands close the loop over the estimate. The
commands depend on the frames only.
"""

from __future__ import annotations

import math
import time
from typing import Any, Mapping

import numpy as np

from hil_companion.desired import Desired
from hil_companion.explore.ground import GROUND, UNKNOWN, Ground, Landing
from hil_companion.explore.mapping.slam import Slam, SlamEstimate
from hil_companion.explore.outcome import (
    FLYING,
    GOAL,
    GOAL_IN_OBSTACLE,
    NO_PATH,
    STUCK,
    FlightReport,
)
from hil_companion.explore.planning.flight_settings import FlightSettings
from hil_companion.explore.planning.moving import MovingObstacles
from hil_companion.explore.planning.plan_map import Clearances, PlanMap, TooFar, clearances_for, make_map, sigma_m
from hil_companion.explore.planning.route import NO_ROUTE, Route, Router
from hil_companion.explore.senses import Nearby, Senses
from hil_companion.explore.steering import RetreatRule, Steering
from hil_companion.frame import Frame

_AT_HEIGHT_M = 0.5
_HEIGHT_GAIN_PER_S, _SINK_MPS = 0.8, 1.0
_HOLD_GAIN_PER_S, _HOLD_MPS = 0.5, 0.5
_SLOW_MPS = 0.5
_WIDE_FACTOR = 3.0  # on `progress_m` and `stuck_s` for the second check of progress, which detects flying to and fro
_GROUND_M = 128.0  # half side of the ground's height map if the mapped area is not given
_NEAR_M = 6.0  # obstacles of the newest sweep within this distance enter the planning map at once
_FASTEST_SHARE, _FASTEST_MPS = 2.0, 4.0  # an estimate faster than 2 times `speed_mps` plus 4 m/s is wrong
# Standard deviation of the position: above _UNSURE_M the vehicle flies slower, above _LOST_M the position is unknown.
_UNSURE_M, _LOST_M = 0.3, 3.0


class Explorer:
    """One flight to a goal; call `step` for every frame, in order."""

    _landing: Landing  # from the first `_sense` on

    def __init__(
        self,
        settings: FlightSettings,
        localiser: Slam,
        goal_W: tuple[float, float],
        calibration: Mapping[str, Any] | None = None,
        *,
        mapped_W: tuple[float, float, float, float] | None = None,
        lidar: str = "lidar",
    ) -> None:
        """Prepare a flight. `mapped_W`: x and y of two corners of the area that the localiser maps."""
        self.settings, self.goal_W = settings, goal_W
        self.report = FlightReport()
        self.finished = False
        self.estimate: SlamEstimate | None = None
        self.map: PlanMap | None = None
        self.route: Route = NO_ROUTE
        self._localiser = localiser
        self._mapped_W = mapped_W
        self._ground: Ground | None = None
        x0, y0, x1, y1 = mapped_W or (-math.inf, -math.inf, math.inf, math.inf)
        self._goal_off_map = not (x0 < goal_W[0] < x1 and y0 < goal_W[1] < y1)
        self._senses = Senses(settings, calibration, lidar=lidar)
        self._obstacles = MovingObstacles()
        self._router = Router(settings.move_goal_m)
        self._steering = Steering(settings)
        self._retreat = RetreatRule()
        self._retreating = False
        self._begun_ns: int | None = None
        self._before_ns: int | None = None
        self._planned_ns: int | None = None  # time of the sweep that the route was planned with
        self._no_path_since_ns: int | None = None
        self._anchor: tuple[int, np.ndarray] | None = None  # time and position of the last progress
        self._wide_anchor: tuple[int, np.ndarray] | None = None  # the same for the second check of progress
        self._outcome_ns = 0
        self._hold_W: np.ndarray | None = None
        self._start_W: np.ndarray | None = None
        self._height_m = settings.height_m  # commanded height
        self._up_m = 0.0  # last known height
        self._command: Desired | None = None

    @property
    def near(self) -> Nearby | None:
        """Return the obstacles of the newest sweep."""
        return self._senses.near

    # --- one frame ---

    def step(self, frame: Frame) -> Desired:
        """Return the command for a frame; for a repeated or older frame, return the previous command."""
        if self._command is None or self._before_ns is None or frame.t_ns > self._before_ns:
            self._command = self._step(frame)
        return self._command

    def _step(self, frame: Frame) -> Desired:
        dt_s = 0.1 if self._before_ns is None else min((frame.t_ns - self._before_ns) * 1e-9, 1.0)
        self._before_ns = frame.t_ns
        if self._begun_ns is None:
            self._begun_ns = frame.t_ns
        began_s = time.perf_counter()
        estimate = self.estimate = self._localiser.update(frame)
        self.report.update_ms.append(1e3 * (time.perf_counter() - began_s))
        sigma = self.report.sigma_m = sigma_m(np.asarray(estimate.covariance_xy))
        if not self._usable(estimate) or sigma > _LOST_M:
            return self._brake_without_position(frame, dt_s)
        p_W, v_W = np.asarray(estimate.p_W, float), np.asarray(estimate.v_W, float)
        self._up_m = float(p_W[2])
        start_W = self._start_W = p_W[:2].copy() if self._start_W is None else self._start_W
        ground = self._sense(frame, estimate, p_W)
        if not self.finished:
            self.report.goal_distance_m = float(np.hypot(*(p_W[:2] - self.goal_W)))
        if self.report.phase == "climb":
            return self._climb(frame, estimate, start_W, p_W, dt_s)
        if self.report.outcome == FLYING:
            v_xy = self._fly(frame, estimate, p_W[:2], v_W[:2], sigma, dt_s)
        else:
            v_xy = self._hover(frame, estimate, ground, p_W[:2], v_W[:2], sigma, dt_s)
        return self._desired(v_xy, p_W[2], estimate.yaw_rad, dt_s)

    def _sense(self, frame: Frame, estimate: SlamEstimate, p_W: np.ndarray) -> Ground:
        """Take what the frame shows, and return what is known of the ground."""
        before = self._senses.near
        self._senses.update(frame, estimate)
        near = self._senses.near
        if self._ground is None:
            x, y, s = float(p_W[0]), float(p_W[1]), self.settings
            x0, y0, x1, y1 = self._mapped_W or (x - _GROUND_M, y - _GROUND_M, x + _GROUND_M, y + _GROUND_M)
            self._ground = Ground((x0, y0, x1, y1), float(p_W[2]), s.vehicle_radius_m + s.clearance_m)
            self._ground.stood_on(x, y)
            self._landing = Landing(s, self._ground)
        if near is not None and near is not before and estimate.imu_ok:
            self._ground.add(near.points_W)
        return self._ground

    def _climb(
        self, frame: Frame, estimate: SlamEstimate, start_W: np.ndarray, p_W: np.ndarray, dt_s: float
    ) -> Desired:
        lost = self._senses.lost(frame.t_ns)
        if lost is not None:
            self._end(frame, *lost)
        elif abs(p_W[2] - self.settings.height_m) < _AT_HEIGHT_M:
            self.report.phase = "fly"
        elif self._over_s(frame) > self.settings.time_limit_s:
            self._end(frame, STUCK, "the vehicle did not reach the height of the flight")
        if not self._senses.ready(frame.t_ns):
            v_xy = self._steering.stop(dt_s)
            return Desired(v_W=(float(v_xy[0]), float(v_xy[1]), 0.0), yaw_rad=self._steering.yaw_rad)
        v_xy = _limited(_HOLD_GAIN_PER_S * (start_W - p_W[:2]), _HOLD_MPS)
        return self._desired(self._steering.slew(v_xy, dt_s), p_W[2], estimate.yaw_rad, dt_s)

    def _fly(
        self, frame: Frame, estimate: SlamEstimate, p_W: np.ndarray, v_W: np.ndarray, sigma: float, dt_s: float
    ) -> np.ndarray:
        s = self.settings
        lost = self._senses.lost(frame.t_ns)
        if lost is not None:
            self._end(frame, *lost)
        near = self._senses.near
        if near is None or not self._senses.ready(frame.t_ns):
            return self._steering.stop(dt_s)
        clearances = clearances_for(s, sigma, float(estimate.grid.cell_m))
        if self._planned_ns != near.t_ns:  # one plan per sweep
            began_s = time.perf_counter()
            try:
                if self._goal_off_map:
                    raise TooFar("the goal lies beyond the area that is mapped")
                self.route = self._plan(frame, estimate, near, p_W, clearances, self.goal_W)
            except TooFar as error:
                self._end(frame, NO_PATH, str(error))
                return self._steering.stop(dt_s)
            self.report.plan_ms.append(1e3 * (time.perf_counter() - began_s))
            self.report.replans += 1
            self._planned_ns = near.t_ns
        route = self.route
        assert self.map is not None
        nearest_m, dx, dy = near.nearest(*p_W)
        self.report.nearest_m = min(self.report.nearest_m, nearest_m)
        retreat_W = self._retreat_velocity(clearances, near, p_W, v_W, nearest_m, dx, dy)
        if self._ended(frame, route, p_W, v_W):
            return self._steering.stop(dt_s)
        if retreat_W is not None:
            return self._steering.slew(retreat_W, dt_s, hard=True)
        if not route.found:
            return self._steering.stop(dt_s)
        # Without sweeps that fit the map, the position comes from GPS and IMU only, so the vehicle flies slowly.
        max_mps = s.speed_mps * min(1.0, _UNSURE_M / max(sigma, 1e-6)) if estimate.lidar_ok else s.slow_mps
        max_mps = max(s.slow_mps, max_mps)
        return self._steering.follow(self.map, clearances, near, route.points_W, p_W, v_W, dt_s, max_mps=max_mps)

    def _plan(
        self,
        frame: Frame,
        estimate: SlamEstimate,
        near: Nearby,
        p_W: np.ndarray,
        clearances: Clearances,
        goal_W: tuple[float, float],
    ) -> Route:
        s = self.settings
        gone = self._obstacles.vacated(estimate.grid, near.level_W, frame.t_ns * 1e-9)
        d = near.level_W - p_W
        close = near.level_W[(d * d).sum(axis=1) < _NEAR_M * _NEAR_M]
        ends = ((float(p_W[0]), float(p_W[1])), goal_W)
        self.map = make_map(estimate.grid, gone, close, ends, clearances, s.unknown_price)
        return self._router.route(self.map, clearances, p_W, goal_W)

    def _retreat_velocity(
        self,
        clearances: Clearances,
        near: Nearby,
        p_W: np.ndarray,
        v_W: np.ndarray,
        nearest_m: float,
        dx: float,
        dy: float,
    ) -> np.ndarray | None:
        length = math.hypot(dx, dy)
        towards = (dx / length, dy / length) if length > 1e-6 else (1.0, 0.0)
        room_m = _room_m(near, p_W, np.array([-towards[0], -towards[1]]))
        retreat = self._retreat.apply(clearances, nearest_m, towards, (float(v_W[0]), float(v_W[1])), room_m)
        if retreat.band != "clear" and not self._retreating:
            self.report.retreats += 1
        self._retreating = retreat.band != "clear"
        return None if retreat.v_W is None else np.array(retreat.v_W)

    # --- outcomes ---

    def _ended(self, frame: Frame, route: Route, p_W: np.ndarray, v_W: np.ndarray) -> bool:
        s, t_ns = self.settings, frame.t_ns
        if self._anchor is None or np.hypot(*(p_W - self._anchor[1])) > s.progress_m:
            self._anchor = (t_ns, p_W.copy())
        if self._wide_anchor is None or np.hypot(*(p_W - self._wide_anchor[1])) > _WIDE_FACTOR * s.progress_m:
            self._wide_anchor = (t_ns, p_W.copy())
        if route.found:
            self._no_path_since_ns = None
            left_m = float(np.hypot(*(p_W - route.goal_W)))
            if left_m < s.goal_radius_m and float(np.hypot(*v_W)) < _SLOW_MPS:
                moved_m = math.hypot(route.goal_W[0] - self.goal_W[0], route.goal_W[1] - self.goal_W[1])
                why = f"the goal was shifted by {moved_m:.1f} m, because it was too near to an obstacle"
                self._end(frame, GOAL, why if moved_m > 0.0 else "")
        elif self._no_path_since_ns is None:
            self._no_path_since_ns = t_ns
        elif (t_ns - self._no_path_since_ns) * 1e-9 > s.no_path_s:
            reason = "the goal lies in an obstacle" if route.why == GOAL_IN_OBSTACLE else "no path is left"
            self._end(frame, route.why, reason)
        if self.report.outcome == FLYING and (t_ns - self._anchor[0]) * 1e-9 > s.stuck_s:
            self._end(frame, STUCK, f"less than {s.progress_m:g} m of progress in {s.stuck_s:g} s")
        if self.report.outcome == FLYING and (t_ns - self._wide_anchor[0]) * 1e-9 > _WIDE_FACTOR * s.stuck_s:
            self._end(
                frame, STUCK, f"to and fro within {_WIDE_FACTOR * s.progress_m:g} m for {_WIDE_FACTOR * s.stuck_s:g} s"
            )
        if self.report.outcome == FLYING and self._over_s(frame) > s.time_limit_s:
            self._end(frame, STUCK, f"not at the goal after {s.time_limit_s:g} s")
        return self.report.outcome != FLYING

    def _end(self, frame: Frame, outcome: str, why: str) -> None:
        if self.report.phase == "climb":
            self._height_m = self._up_m  # stop climbing and keep this height
        self.report.outcome, self.report.why, self.report.t_s = outcome, why, frame.t_ns * 1e-9
        self.report.phase = "hover"
        self._outcome_ns = frame.t_ns
        self._hold_W = None

    def _hover(
        self,
        frame: Frame,
        estimate: SlamEstimate,
        ground: Ground,
        p_W: np.ndarray,
        v_W: np.ndarray,
        sigma: float,
        dt_s: float,
    ) -> np.ndarray:
        """Return the velocity command after an outcome: hold the position, and retreat from near obstacles."""
        self.report.below = ground.below(float(p_W[0]), float(p_W[1]))
        since_s = (frame.t_ns - self._outcome_ns) * 1e-9
        self.finished = self.finished or self._landing.due(self.report.outcome, self.report.below, since_s)
        near = self._senses.near
        if near is None or not self._senses.sees(frame.t_ns):
            self._hold_W = None
            return self._steering.stop(dt_s)
        clearances = clearances_for(self.settings, sigma, float(estimate.grid.cell_m))
        away = self._retreat_velocity(clearances, near, p_W, v_W, *near.nearest(*p_W))
        if away is not None:
            self._hold_W = None
            return self._steering.slew(away, dt_s, hard=True)
        if self.report.below != GROUND and not self.finished and self._senses.ready(frame.t_ns):
            v_xy = self._to_bare_ground(frame, estimate, near, p_W, v_W, clearances, dt_s)
            if v_xy is not None:
                self._hold_W = None
                return v_xy
        if self._hold_W is None:
            if float(np.hypot(*v_W)) > _SLOW_MPS:
                return self._steering.stop(dt_s)
            self._hold_W = p_W.copy()
        return self._steering.slew(_limited(_HOLD_GAIN_PER_S * (self._hold_W - p_W), _HOLD_MPS), dt_s)

    def _to_bare_ground(
        self,
        frame: Frame,
        estimate: SlamEstimate,
        near: Nearby,
        p_W: np.ndarray,
        v_W: np.ndarray,
        clearances: Clearances,
        dt_s: float,
    ) -> np.ndarray | None:
        """Return the velocity command towards bare ground; None if there is none, or no path."""
        if self._planned_ns != near.t_ns and self.map is not None:
            spot = self._landing.spot(p_W, self.map, clearances)
            try:
                self.route = NO_ROUTE if spot is None else self._plan(frame, estimate, near, p_W, clearances, spot)
            except TooFar:
                self.route = NO_ROUTE
            self._planned_ns = near.t_ns
        if self.map is None or not self.route.found:
            return None
        return self._steering.follow(
            self.map, clearances, near, self.route.points_W, p_W, v_W, dt_s, max_mps=self.settings.slow_mps
        )

    def _brake_without_position(self, frame: Frame, dt_s: float) -> Desired:
        """Return the command while the position is unknown: brake."""
        if self._anchor is None:
            self._anchor = (frame.t_ns, np.zeros(2))
        if self.report.outcome == FLYING:
            if (frame.t_ns - self._anchor[0]) * 1e-9 > self.settings.stuck_s:
                self._end(frame, STUCK, "the position is not known")
        else:
            self.report.below = UNKNOWN
            self.finished = self.finished or (frame.t_ns - self._outcome_ns) * 1e-9 >= self.settings.unsafe_hover_s
        v_xy = self._steering.stop(dt_s)
        return Desired(v_W=(float(v_xy[0]), float(v_xy[1]), 0.0), yaw_rad=self._steering.yaw_rad)

    # --- commands ---

    def _desired(self, v_xy: np.ndarray, up_m: float, yaw_rad: float, dt_s: float) -> Desired:
        s = self.settings
        climb = min(max(_HEIGHT_GAIN_PER_S * (self._height_m - float(up_m)), -_SINK_MPS), s.climb_mps)
        yaw = self._steering.turn(yaw_rad, v_xy, dt_s)
        return Desired(v_W=(float(v_xy[0]), float(v_xy[1]), climb), yaw_rad=yaw)

    def _usable(self, estimate: SlamEstimate) -> bool:
        """Return True if the estimate is finite and its speed plausible."""
        p_W, v_W = np.asarray(estimate.p_W, float), np.asarray(estimate.v_W, float)
        values = (*p_W, *v_W, estimate.yaw_rad, estimate.roll, estimate.pitch)
        fastest = _FASTEST_SHARE * self.settings.speed_mps + _FASTEST_MPS
        return all(math.isfinite(float(v)) for v in values) and float(np.linalg.norm(v_W)) < fastest

    def _over_s(self, frame: Frame) -> float:
        return (frame.t_ns - (self._begun_ns or 0)) * 1e-9


def _limited(v: np.ndarray, max_norm: float) -> np.ndarray:
    norm = float(np.hypot(*v))
    return v if norm <= max_norm else v * (max_norm / norm)


def _room_m(near: Nearby, p_W: np.ndarray, away: np.ndarray) -> float:
    """Return the distance to the nearest obstacle within 45 degrees of a direction."""
    d = near.level_W - p_W
    distances_m = np.hypot(d[:, 0], d[:, 1])
    behind = d @ away > 0.7071 * distances_m
    return float(distances_m[behind].min()) if behind.any() else math.inf
