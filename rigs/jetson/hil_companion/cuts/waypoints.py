"""Flies through the bench's waypoints on a minimum-snap path, and lands at the last one.

    take-off   straight up to the first waypoint's height, then across to it if it is not straight above
    path       through the waypoints, in simulated time; planned before the first frame comes
    descent    straight down from the last waypoint until the vehicle stands on the ground; its path ends below ground
    land       the landing command, until the vehicle is down or `land_s` have passed

The vehicle's position is read from `truth` if the bench sends that topic. Otherwise the vehicle is assumed to start
below the first waypoint and to keep to the schedule, and the landing command does the descent. The commands depend on
the frames only, so the same frames give the same flight.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from hil_companion.cuts.planning import SAME_PLACE_M, Limits, plan, without_repeats
from hil_companion.cuts.settings import number
from hil_companion.cuts.snap_path import PathPoint, SnapPath
from hil_companion.desired import Desired
from hil_companion.errors import CutError
from hil_companion.frame import Frame
from hil_companion.link.protocol import Welcome
from hil_companion.navigation.rotation import matrix_of, roll_pitch_yaw

ARRIVED_M = 0.3  # nearer than this to the end of a phase, the vehicle has reached it
AHEAD_S = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)  # times of the knots sent ahead; a computer may take this long for an answer
BELOW_M = 0.5  # the descent ends this far below the start, so that the vehicle reaches the ground
SINK_MPS, SINK_MPS2 = 0.7, 0.5  # limits of the descent, gentle because it ends on the ground
# The vehicle has landed if it was at most this high above the start and slower than this, for this long.
DOWN_M, DOWN_MPS, DOWN_S = 0.15, 0.1, 1.0
TURN_FROM_MPS = 0.3  # below this horizontal speed the path defines no heading
TRUTH = "truth"
HALVINGS = 30  # bisection steps for a time between two frames


@dataclass(frozen=True)
class WaypointsSettings:
    """Settings of `waypoints`. Raises OptionError."""

    speed_mps: float = 4.0
    accel_mps2: float = 3.0
    corridor_m: float = 0.25  # radius about the straight legs that the path stays within
    takeoff_speed_mps: float = 1.0
    yaw: float | str = "forward"  # radians from east, or "forward"
    yaw_rate_radps: float = 1.0
    # Time from the frame to the commanded point of the path. "measured": the measured latency of the previous frame;
    # then the bench does not extrapolate, and the flight depends on the speed of this machine.
    lookahead_s: float | str = 0.0
    wait_s: float = 30.0  # timeout for reaching the end of a phase
    land_s: float = 60.0  # timeout for the landing
    busy_s: float = 0.0  # shortest computing time of an answer, to fly as with a slower computer

    def __post_init__(self) -> None:
        for name in ("speed_mps", "accel_mps2", "corridor_m", "takeoff_speed_mps", "yaw_rate_radps"):
            number("waypoints", name, getattr(self, name), above=0.0)
        for name in ("wait_s", "land_s", "busy_s"):
            number("waypoints", name, getattr(self, name))
        if self.yaw != "forward":
            number("waypoints", "yaw", self.yaw)
        if self.lookahead_s != "measured":
            number("waypoints", "lookahead_s", self.lookahead_s)


class Waypoints:
    """The CUT `waypoints`. Keyword arguments: the fields of `WaypointsSettings`."""

    topics = (TRUTH,)
    control = True
    settings_type = WaypointsSettings

    def __init__(self, **settings: Any) -> None:
        s = self._settings = WaypointsSettings(**settings)
        self.finished = False
        self.hold = s.lookahead_s == "measured"
        self._limits = Limits(s.speed_mps, s.accel_mps2, s.corridor_m)
        self._climb_limits = Limits(s.takeoff_speed_mps, s.accel_mps2, s.corridor_m)
        self._sink_limits = Limits(min(s.takeoff_speed_mps, SINK_MPS), min(s.accel_mps2, SINK_MPS2), s.corridor_m)
        self._waypoints_W = np.zeros((0, 3))
        self._path: SnapPath | None = None  # through the waypoints; None for a single one
        self._phases: list[SnapPath] = []
        self._reset()

    def _reset(self) -> None:
        self.finished = False
        self._phases = []
        self._begun = False
        self._phase = 0
        self._descent = -1  # index of the descent among the phases, -1 if there is none
        self._phase_t_ns = 0  # start time of the present phase
        self._t_ns: int | None = None  # time of the previous frame
        self._state_before: State | None = None  # in the previous frame
        self._state_now: State | None = None
        self._yaw_rad = 0.0
        self._start_W = np.zeros(3)
        self._down_since_ns: int | None = None

    def start(self, welcome: Welcome) -> None:
        """Begin a session: plan the path through the bench's waypoints. Raises CutError if the bench has none."""
        if not welcome.waypoints_W:
            raise CutError("waypoints: the bench has none to fly; give it a mission with waypoints")
        self._reset()
        self._waypoints_W = without_repeats(np.array(welcome.waypoints_W, float))
        self._path = plan(self._waypoints_W, self._limits) if len(self._waypoints_W) > 1 else None

    def __call__(self, frame: Frame) -> Desired | None:
        begun_s = time.perf_counter()
        desired = self._desire(frame)
        while time.perf_counter() - begun_s < self._settings.busy_s:
            pass
        return desired

    def _desire(self, frame: Frame) -> Desired | None:
        p_W, v_W = _true_state(frame)
        if not self._begun:
            self._begin(frame, p_W)
        dt_s = 0.0 if self._t_ns is None else (frame.t_ns - self._t_ns) * 1e-9
        self._t_ns = frame.t_ns
        t_s = (frame.t_ns - self._phase_t_ns) * 1e-9
        self._state_before = self._state_now
        self._state_now = None if p_W is None else State(frame.t_ns, p_W, v_W)
        while self._phase < len(self._phases):
            over_s = self._over_since(t_s, p_W, v_W)
            if over_s is None:
                break
            # The next phase begins at the computed time, not at this frame's, so the frame rate does not shift it.
            self._phase += 1
            self._phase_t_ns += round((t_s - over_s) * 1e9)
            t_s = over_s
        if self._phase == len(self._phases):
            return self._land(frame, t_s, p_W, v_W)
        t_s += self._ahead_s(frame)
        point = self._phases[self._phase].at(t_s)
        self._turn(point, dt_s)
        return Desired(
            p_W=point.p_W.tolist(),
            v_W=point.v_W.tolist(),
            a_W=point.a_W.tolist(),
            yaw_rad=self._yaw_rad,
            ahead=[] if self.hold else self._path_ahead(t_s, p_W),
        )

    def _path_ahead(self, t_s: float, p_W: np.ndarray | None) -> list[Any]:
        """Return knots (seconds later, position, velocity) of the path from `t_s` of the present phase on.

        The knots continue into the next phase only if the vehicle keeps up with the path, because otherwise the next
        phase will begin later.
        """
        commanded_W = self._phases[self._phase].at(t_s).p_W
        keeps_up = p_W is None or float(np.linalg.norm(p_W - commanded_W)) < ARRIVED_M
        knots = []
        for dt_s in AHEAD_S:
            phase, at_s = self._phase, t_s + dt_s
            while keeps_up and at_s > self._phases[phase].duration_s and phase + 1 < len(self._phases):
                at_s -= self._phases[phase].duration_s
                phase += 1
            point = self._phases[phase].at(at_s)
            knots.append((dt_s, point.p_W.tolist(), point.v_W.tolist()))
        return knots

    def _begin(self, frame: Frame, p_W: np.ndarray | None) -> None:
        """Plan the phases from the first frame's position on."""
        first = self._waypoints_W[0]
        self._start_W = np.array([first[0], first[1], 0.0]) if p_W is None else p_W
        above = np.array([self._start_W[0], self._start_W[1], first[2]])
        for points, limits in (([self._start_W, above], self._climb_limits), ([above, first], self._limits)):
            if float(np.linalg.norm(points[1] - points[0])) > SAME_PLACE_M:
                self._phases.append(plan(np.array(points), limits))
        if self._path is not None:
            self._phases.append(self._path)
        self._descent = -1
        last = self._waypoints_W[-1]
        if p_W is not None:
            self._descent = len(self._phases)
            ground = [last[0], last[1], min(p_W[2], last[2]) - BELOW_M]
            self._phases.append(plan(np.array([last, ground]), self._sink_limits))
        self._begun = True
        self._phase_t_ns = frame.t_ns
        q_WB = frame[TRUTH]["q_WB"] if TRUTH in frame and "q_WB" in frame[TRUTH] else None
        if self._settings.yaw != "forward":
            self._yaw_rad = float(self._settings.yaw)
        elif q_WB is not None:
            self._yaw_rad = roll_pitch_yaw(matrix_of(np.asarray(q_WB, float).reshape(-1, 4)[-1]))[2]

    def _over_since(self, t_s: float, p_W: np.ndarray | None, v_W: np.ndarray | None) -> float | None:
        """Return the seconds since the end of the present phase; None while it has not ended.

        A phase ends when its time has passed and the vehicle has reached its last point, or `wait_s` later at the
        latest.
        """
        path = self._phases[self._phase]
        past_s = t_s - path.duration_s
        if self._phase == self._descent and p_W is not None and v_W is not None:
            above_m = float(p_W[2] - path.at(t_s).p_W[2])
            if above_m > ARRIVED_M and float(np.linalg.norm(v_W)) < DOWN_MPS:
                return 0.0  # it stands on something above the path's end
        if past_s < 0.0:
            return None
        if p_W is None:
            return past_s
        end_W = path.at(t_s).p_W
        if float(np.linalg.norm(p_W - end_W)) >= ARRIVED_M:
            wait_s = self._settings.wait_s
            return past_s - wait_s if past_s > wait_s else None
        before, now = self._state_before, self._state_now
        if before is None or now is None or float(np.linalg.norm(before.p_W - end_W)) < ARRIVED_M:
            return past_s
        return min(past_s, came_within_s(before, now, end_W, ARRIVED_M))

    def _land(self, frame: Frame, t_s: float, p_W: np.ndarray | None, v_W: np.ndarray | None) -> Desired:
        down = p_W is not None and v_W is not None and p_W[2] - self._start_W[2] < DOWN_M
        if not (down and v_W is not None and float(np.linalg.norm(v_W)) < DOWN_MPS):
            self._down_since_ns = None
        elif self._down_since_ns is None:
            self._down_since_ns = frame.t_ns
        still_s = 0.0 if self._down_since_ns is None else (frame.t_ns - self._down_since_ns) * 1e-9
        self.finished = self.finished or still_s >= DOWN_S or t_s >= self._settings.land_s
        return Desired(yaw_rad=self._yaw_rad, land=True)

    def _ahead_s(self, frame: Frame) -> float:
        lookahead_s = self._settings.lookahead_s
        return frame.latency_ns * 1e-9 if lookahead_s == "measured" else float(lookahead_s)

    def _turn(self, point: PathPoint, dt_s: float) -> None:
        """Turn the commanded yaw towards the path's direction, by the smaller angle, at the allowed rate at most."""
        east, north = float(point.v_W[0]), float(point.v_W[1])
        if self._settings.yaw != "forward" or math.hypot(east, north) < TURN_FROM_MPS:
            return
        error_rad = math.remainder(math.atan2(north, east) - self._yaw_rad, 2.0 * math.pi)
        max_rad = self._settings.yaw_rate_radps * dt_s
        self._yaw_rad = math.remainder(self._yaw_rad + min(max(error_rad, -max_rad), max_rad), 2.0 * math.pi)


def _true_state(frame: Frame) -> Any:
    """Return position and velocity from the topic truth; None and None without it."""
    if TRUTH not in frame:
        return None, None
    truth = frame[TRUTH]
    return tuple(np.asarray(truth[name], float).reshape(-1, 3)[-1] for name in ("p_WB", "v_WB_W"))


@dataclass(frozen=True)
class State:
    """Position and velocity of the vehicle in one frame."""

    t_ns: int
    p_W: np.ndarray
    v_W: np.ndarray


def came_within_s(before: State, now: State, place_W: np.ndarray, radius_m: float) -> float:
    """Return the seconds before `now` at which the vehicle came within the radius of a place.

    The vehicle was outside at `before` and is inside at `now`. Between them it is interpolated by the cubic through
    both positions and velocities (Hermite), so the result hardly depends on the frame rate.
    """
    h_s = (now.t_ns - before.t_ns) * 1e-9
    d, b0, b1 = now.p_W - before.p_W, h_s * before.v_W, h_s * now.v_W
    c2, c3 = 3.0 * d - 2.0 * b0 - b1, b0 + b1 - 2.0 * d
    outside, inside = 0.0, 1.0
    for _ in range(HALVINGS):
        s = 0.5 * (outside + inside)
        p_W = before.p_W + (b0 + (c2 + c3 * s) * s) * s
        if float(np.linalg.norm(p_W - place_W)) < radius_m:
            inside = s
        else:
            outside = s
    return (1.0 - inside) * h_s
