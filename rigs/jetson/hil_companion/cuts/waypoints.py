"""Flies through the bench's waypoints on a path of least snap, and lands at the last.

    take-off   straight up to the first waypoint's height, and across to it where it is not above
    path       through the waypoints, at simulated time; planned before the first frame comes
    descent    straight down from the last waypoint, until it stands on the ground: the path leads below it
    land       asked for there, until the vehicle is down or `land_s` have passed

Where the vehicle is is read from `truth` if that is among the topics; else it is taken to be below the first waypoint,
and on time, and the descent is left to the landing. What is commanded depends on the frames only, so the same frames
give the same flight.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from hil_companion.cuts.planning import SAME_PLACE_M, Limits, plan, without_repeats
from hil_companion.cuts.snap_path import PathPoint, SnapPath
from hil_companion.desired import Desired
from hil_companion.errors import CutError, OptionError
from hil_companion.explore.rotation import matrix_of, roll_pitch_yaw
from hil_companion.frame import Frame
from hil_companion.protocol import Welcome

ARRIVED_M = 0.3
AHEAD_S = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)  # what a slow computer needs to keep to its path
BELOW_M = 0.5  # the place of the start: how far the descent aims, so that it ends at the ground and not above it
SINK_MPS, SINK_MPS2 = 0.7, 0.5  # the descent: gentle, since it meets the ground
DOWN_M, DOWN_MPS, DOWN_S = 0.15, 0.1, 1.0  # landed: as low as it started, this slow, for this long
TURN_FROM_MPS = 0.3  # horizontal speed below which the path says nothing of where to look
TRUTH = "truth"
HALVINGS = 30  # of the stretch between two frames, where a time within it is looked for


class Waypoints:
    """`lookahead_s`: how far ahead of the vehicle to command. From the frame's time on the bench carries on what is
    desired; with "measured" it does not, and the latency of the frame before is made up for here (then the flight
    depends on how fast this machine was). `yaw`: radians from east, or "forward". `busy_s`: every answer takes at
    least so long, computing: what a slower computer would fly like."""

    topics = (TRUTH,)
    control = True

    def __init__(
        self,
        *,
        speed_mps: float = 4.0,
        accel_mps2: float = 3.0,
        corridor_m: float = 0.25,
        takeoff_speed_mps: float = 1.0,
        yaw: float | str = "forward",
        yaw_rate_radps: float = 1.0,
        lookahead_s: float | str = 0.0,
        wait_s: float = 30.0,
        land_s: float = 60.0,
        busy_s: float = 0.0,
    ) -> None:
        limits = {"speed_mps": speed_mps, "accel_mps2": accel_mps2, "corridor_m": corridor_m}
        limits.update(takeoff_speed_mps=takeoff_speed_mps, yaw_rate_radps=yaw_rate_radps)
        for name, value in limits.items():
            _number(name, value, above=0.0)
        for name, value in (("wait_s", wait_s), ("land_s", land_s), ("busy_s", busy_s)):
            _number(name, value)
        if yaw != "forward":
            _number("yaw", yaw)
        if lookahead_s != "measured":
            _number("lookahead_s", lookahead_s)
        self.finished = False
        self.hold = lookahead_s == "measured"
        self._limits = Limits(speed_mps, accel_mps2, corridor_m)
        self._climb = Limits(takeoff_speed_mps, accel_mps2, corridor_m)
        self._sink = Limits(min(takeoff_speed_mps, SINK_MPS), min(accel_mps2, SINK_MPS2), corridor_m)
        self._yaw, self._yaw_rate_radps, self._lookahead_s = yaw, yaw_rate_radps, lookahead_s
        self._wait_s, self._land_s = wait_s, land_s
        self._busy_s = float(busy_s)
        self._waypoints_W = np.zeros((0, 3))
        self._path: SnapPath | None = None  # through the waypoints
        self._phases: list[SnapPath] = []
        self._reset()

    def _reset(self) -> None:
        self.finished = False
        self._phases = []
        self._begun = False
        self._phase = 0
        self._descent = -1  # which of the phases, if any
        self._phase_t_ns = 0  # when it began
        self._t_ns: int | None = None  # of the frame before
        self._before: Seen | None = None  # by it
        self._now: Seen | None = None
        self._yaw_rad = 0.0
        self._start_W = np.zeros(3)
        self._down_since_ns: int | None = None

    def start(self, welcome: Welcome) -> None:
        if not welcome.waypoints_W:
            raise CutError("waypoints: the bench has none to fly; give it a mission with waypoints")
        self._reset()
        self._waypoints_W = without_repeats(np.array(welcome.waypoints_W, float))
        self._path = plan(self._waypoints_W, self._limits) if len(self._waypoints_W) > 1 else None

    def __call__(self, frame: Frame) -> Desired | None:
        begun_s = time.perf_counter()
        desired = self._desire(frame)
        while time.perf_counter() - begun_s < self._busy_s:
            pass
        return desired

    def _desire(self, frame: Frame) -> Desired | None:
        p_W, v_W = _where(frame)
        if not self._begun:
            self._begin(frame, p_W)
        dt_s = 0.0 if self._t_ns is None else (frame.t_ns - self._t_ns) * 1e-9
        self._t_ns = frame.t_ns
        t_s = (frame.t_ns - self._phase_t_ns) * 1e-9
        self._before, self._now = self._now, None if p_W is None else Seen(frame.t_ns, p_W, v_W)
        while self._phase < len(self._phases):
            over_s = self._over_since(t_s, p_W, v_W)
            if over_s is None:
                break
            # Not when a frame shows it: which frames there are should not move the flight.
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
            ahead=[] if self.hold else self._ahead(t_s, p_W),
        )

    def _ahead(self, t_s: float, p_W: np.ndarray | None) -> list[Any]:
        """The path from here on. Over the end of a phase only where the vehicle keeps up: else the next one waits."""
        here = self._phases[self._phase].at(t_s).p_W
        keeps_up = p_W is None or float(np.linalg.norm(p_W - here)) < ARRIVED_M
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
        first = self._waypoints_W[0]
        self._start_W = np.array([first[0], first[1], 0.0]) if p_W is None else p_W
        above = np.array([self._start_W[0], self._start_W[1], first[2]])
        for points, limits in (([self._start_W, above], self._climb), ([above, first], self._limits)):
            if float(np.linalg.norm(points[1] - points[0])) > SAME_PLACE_M:
                self._phases.append(plan(np.array(points), limits))
        if self._path is not None:
            self._phases.append(self._path)
        self._descent = -1
        last = self._waypoints_W[-1]
        if p_W is not None:
            self._descent = len(self._phases)
            ground = [last[0], last[1], min(p_W[2], last[2]) - BELOW_M]
            self._phases.append(plan(np.array([last, ground]), self._sink))
        self._begun = True
        self._phase_t_ns = frame.t_ns
        q_WB = frame[TRUTH]["q_WB"] if TRUTH in frame and "q_WB" in frame[TRUTH] else None
        if self._yaw != "forward":
            self._yaw_rad = float(self._yaw)
        elif q_WB is not None:
            self._yaw_rad = roll_pitch_yaw(matrix_of(np.asarray(q_WB, float).reshape(-1, 4)[-1]))[2]

    def _over_since(self, t_s: float, p_W: np.ndarray | None, v_W: np.ndarray | None) -> float | None:
        """For how long its time has passed and the vehicle has been at its end, which is not waited for for ever."""
        path = self._phases[self._phase]
        past_s = t_s - path.duration_s
        if self._phase == self._descent and p_W is not None and v_W is not None:
            above_m = float(p_W[2] - path.at(t_s).p_W[2])
            if above_m > ARRIVED_M and float(np.linalg.norm(v_W)) < DOWN_MPS:
                return 0.0  # it stands
        if past_s < 0.0:
            return None
        if p_W is None:
            return past_s
        end_W = path.at(t_s).p_W
        if float(np.linalg.norm(p_W - end_W)) >= ARRIVED_M:
            return past_s - self._wait_s if past_s > self._wait_s else None
        before, now = self._before, self._now
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
        self.finished = self.finished or still_s >= DOWN_S or t_s >= self._land_s
        return Desired(yaw_rad=self._yaw_rad, land=True)

    def _ahead_s(self, frame: Frame) -> float:
        return frame.latency_ns * 1e-9 if self._lookahead_s == "measured" else float(self._lookahead_s)

    def _turn(self, point: PathPoint, dt_s: float) -> None:
        """Towards where the path goes, no faster than allowed, the short way round."""
        east, north = float(point.v_W[0]), float(point.v_W[1])
        if self._yaw != "forward" or math.hypot(east, north) < TURN_FROM_MPS:
            return
        off = math.remainder(math.atan2(north, east) - self._yaw_rad, 2.0 * math.pi)
        most = self._yaw_rate_radps * dt_s
        self._yaw_rad = math.remainder(self._yaw_rad + min(max(off, -most), most), 2.0 * math.pi)


def _where(frame: Frame) -> Any:
    """Position and velocity out of the truth, or None and None."""
    if TRUTH not in frame:
        return None, None
    truth = frame[TRUTH]
    return tuple(np.asarray(truth[name], float).reshape(-1, 3)[-1] for name in ("p_WB", "v_WB_W"))


def _number(name: str, value: Any, above: float = -math.inf) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value <= above:
        raise OptionError(f"waypoints: {name} {value!r}: a number{'' if above < 0 else ' above 0'} is needed")


@dataclass(frozen=True)
class Seen:
    """Where a frame shows the vehicle."""

    t_ns: int
    p_W: np.ndarray
    v_W: np.ndarray


def came_within_s(before: Seen, now: Seen, place_W: np.ndarray, radius_m: float) -> float:
    """How long ago it came so near: on the cubic through positions and velocities of both (Hermite's).

    It was farther away before, and is not now. However far the frames lie apart, the answer is nearly the same.
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
