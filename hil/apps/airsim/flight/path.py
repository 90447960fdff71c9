"""Moves along a path: AirSim's moveOnPath, moveToPosition, moveToZ, moveToGPS, takeoff and goHome.

Every 20 ms the vehicle is sent towards a point on the path that lies `lookahead` ahead of the nearest point, at the
move's speed. With `adaptive_lookahead` k the lookahead grows by k times the distance from the path. A lookahead below
0 is automatic: 0.6 s of flight with adaptive lookahead, 0.8 s without, at least 0.75 m.

Differences from AirSim, whose controller cannot do better:

- The speed falls before corners and before the end, so that the vehicle stays near the path and stops at its end.
  AirSim 1.8.1 flies past the end and comes back. The automatic lookahead follows that speed.
- The move is over once the vehicle is within 0.5 m of the end and comes no nearer, or within 0.05 m at 0.5 m/s. It
  returns True then; AirSim returns False if the vehicle stops short of the end.
- A target nearer than the lookahead is flown to. AirSim returns at once, without a movement.
- The height follows the path. AirSim does not correct one that is less than 0.5 m off.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from math import isfinite, sqrt
from typing import NamedTuple

from hil.apps.airsim.flight.move import ACCURACY_M, PERIOD_S, Clock, Command, MoveError, NedState, limit_of
from hil.apps.airsim.flight.yaw import Drivetrain, YawMode, check_heading, heading_of
from signals._kernel import det_atan2, det_cos, det_sin
from signals.rotation import cross, dot, minus, norm
from signals.samples import Vec3

TAKEOFF_HEIGHT_M, TAKEOFF_SPEED_MPS = 2.0, 0.5
_STANDING_MPS = 0.2  # AirSim: 0.05, which turbulence exceeds

_LOOKAHEAD_PERIODS, _ADAPTIVE_LOOKAHEAD_PERIODS = 40.0, 30.0
_LEAST_LOOKAHEAD_M = 1.5 * ACCURACY_M
_BRAKE_MPS2 = 2.5  # before corners; the controller brakes harder before the end of a straight
_SPEED_UP_MPS = 1.5  # above the present speed: all axes speed up together, on a straight line
_CORNER_RADPS = 2.8  # greatest turn of the course
_CORNER_MPS = 1.8  # speed through a right angle
_LEAST_CORNER_MPS = 0.5
_WIDE_CORNER_MPS2 = 4.3  # v^2 angle / lookahead; the turn is about 1.25 lookaheads long
_CLOSING_MPS = 0.1
_NEARER_M = 1e-3
_STRAIGHT = 0.999  # chord over length
_STARTING_STEPS = 25  # until a vehicle that begins near the end is under way
_ARRIVED_M, _ARRIVED_MPS = 0.05, 0.5


class PathOptions(NamedTuple):
    """Parameters that all moves along a path share."""

    velocity_mps: float
    timeout_s: float = 3e38
    drivetrain: int = Drivetrain.MAX_DEGREE_OF_FREEDOM
    yaw_mode: YawMode = YawMode()
    lookahead_m: float = -1.0
    adaptive_lookahead: float = 1.0


class Follow:
    """Flight along a path that begins where the vehicle is."""

    def __init__(self, points: Sequence[Vec3], options: PathOptions) -> None:
        for point in points:
            if not all(map(isfinite, point)):
                raise MoveError(f"a point of the path is {tuple(point)}; every coordinate has to be finite")
        _check(options)
        self.succeeded = not points
        self._empty = not points
        self._points = list(points)
        self._options = options
        self._clock = Clock(limit_of(timeout_sec=options.timeout_s))
        self._track: _Track | None = None
        self._near_steps = 0  # within 0.5 m of the end

    def start(self, state: NedState) -> list[Vec3]:
        """Return the points to fly to, from the state at the start of the move."""
        del state
        return self._points

    def step(self, state: NedState) -> Command | None:
        """Return the command towards the point ahead; None at the end or when the time is over."""
        if self._empty:
            return None
        if self._track is None:
            self._track = _Track([state.p_m, *self.start(state)], self._options)
        if self._clock.over(state.t_ns):
            return None
        track, options, p = self._track, self._options, state.p_m
        distance_m = track.advance(p, self._lookahead(self._options.velocity_mps))
        end = track.points[-1]
        to_end = minus(end, p)
        left_m = norm(to_end)
        if left_m <= ACCURACY_M and track.left_m <= 2.0 * ACCURACY_M:
            closing_mps = dot(state.v_mps, to_end) / left_m if left_m > 0.0 else 0.0
            self._near_steps += 1
            stopped = closing_mps <= _CLOSING_MPS and self._near_steps > _STARTING_STEPS
            if stopped or (left_m <= _ARRIVED_M and norm(state.v_mps) <= _ARRIVED_MPS):
                self.succeeded = True
                return None
        speed_mps = track.speed_mps()
        lookahead_m = self._lookahead(speed_mps) + abs(options.adaptive_lookahead) * distance_m
        target = track.ahead(lookahead_m)
        to_target = minus(target, p)
        heading = heading_of(options.yaw_mode, options.drivetrain, to_target[:2])._asdict()
        if track.left_m <= lookahead_m + speed_mps * speed_mps / (2.0 * _BRAKE_MPS2) and track.straight:
            return Command(p_xy_m=end[:2], z_m=end[2], speed_limit_mps=options.velocity_mps, **heading)
        to_target_m = max(norm(to_target), 1e-9)
        ahead_mps = dot(state.v_mps, to_target) / to_target_m
        scale = min(speed_mps, max(ahead_mps, 0.0) + _SPEED_UP_MPS) / to_target_m
        vx, vy, vz = (scale * component for component in to_target)
        return Command(v_xy_mps=(vx, vy), vz_mps=vz, **heading)

    def _lookahead(self, speed_mps: float) -> float:
        options = self._options
        if options.lookahead_m > 0.0:
            return options.lookahead_m
        periods = _ADAPTIVE_LOOKAHEAD_PERIODS if options.adaptive_lookahead > 0.0 else _LOOKAHEAD_PERIODS
        return max(periods * speed_mps * PERIOD_S, _LEAST_LOOKAHEAD_M)


def _check(options: PathOptions) -> None:
    velocity_mps, lookahead_m = options.velocity_mps, options.lookahead_m
    for name, value in (
        ("velocity", velocity_mps), ("lookahead", lookahead_m), ("adaptive_lookahead", options.adaptive_lookahead),
    ):  # fmt: skip
        if not isfinite(value):
            raise MoveError(f"{name} is {value}; it has to be finite")
    check_heading(options.yaw_mode, options.drivetrain)
    if not velocity_mps > 0.0:
        raise MoveError(f"velocity is {velocity_mps:g}; it has to be above 0 m/s")
    if options.drivetrain == Drivetrain.FORWARD_ONLY and options.yaw_mode.is_rate:
        raise MoveError("Yaw cannot be specified as rate if drivetrain is ForwardOnly")
    if lookahead_m == 0.0:
        raise MoveError("lookahead distance cannot be 0")
    if lookahead_m > 0.0 and PERIOD_S * velocity_mps > lookahead_m:
        raise MoveError(
            f"lookahead value {lookahead_m:g} is too small for velocity {velocity_mps:g}. "
            f"It must be at least {PERIOD_S * velocity_mps:g}"
        )
    if 0.0 < lookahead_m < ACCURACY_M:
        raise MoveError(f"lookahead value {lookahead_m:g} is smaller than drone's distance accuracy {ACCURACY_M:g}.")


class _Track:
    """Polyline with a place on it that only moves forward, and the speed that its corners allow."""

    def __init__(self, points: Sequence[Vec3], options: PathOptions) -> None:
        self.points = [points[0]]
        for point in points[1:]:
            if norm(minus(point, self.points[-1])) > 1e-6:
                self.points.append(point)
        self._way = [minus(b, a) for a, b in zip(self.points, self.points[1:], strict=False)]
        self._length = [norm(way) for way in self._way]
        self._begin = [0.0]  # path length at each point
        for length in self._length:
            self._begin.append(self._begin[-1] + length)
        self._velocity_mps, self._lookahead_m = options.velocity_mps, options.lookahead_m
        self._leg = 0
        self._s = 0.0
        self._limit = self._corner_speeds()

    @property
    def left_m(self) -> float:
        """Length of the path from the place to the end."""
        return self._begin[-1] - self._s

    @property
    def straight(self) -> bool:
        """True if only a straight leads to the end."""
        return norm(minus(self.points[-1], self._on_leg(self._leg, self._s))) >= _STRAIGHT * self.left_m

    def at(self, s: float) -> Vec3:
        """Return the point at a path length, between those of the place and the end."""
        leg = min(bisect_right(self._begin, s, self._leg) - 1, len(self._length) - 1)
        return self._on_leg(leg, s)

    def ahead(self, lookahead_m: float) -> Vec3:
        """Return the point so far ahead of the place, at most the end."""
        s = self._s + lookahead_m
        return self.points[-1] if s >= self._begin[-1] else self.at(s)

    def advance(self, p: Vec3, reach_m: float) -> float:
        """Move the place to the nearest point ahead, at most `reach_m` away; return the distance of `p` from it."""
        best_s, best_leg, best_m = self._s, self._leg, norm(minus(self._on_leg(self._leg, self._s), p))
        for leg in range(self._leg, len(self._length)):
            first = max(self._s, self._begin[leg])
            last = min(self._s + reach_m, self._begin[leg + 1])
            if first > self._s + reach_m:
                break
            along = self._begin[leg] + dot(minus(p, self.points[leg]), self._way[leg]) / self._length[leg]
            s = min(max(along, first), last)
            distance_m = norm(minus(self._on_leg(leg, s), p))
            # A later leg has to be nearer by more than rounding: a way back lies on the way there.
            if distance_m < best_m - (0.0 if leg == self._leg else _NEARER_M):
                best_s, best_leg, best_m = s, leg, distance_m
        self._s, self._leg = best_s, best_leg
        return best_m

    def speed_mps(self) -> float:
        """Return the speed at the place: braking for the corners ahead, and for the end."""
        leg = self._leg
        if not self._length:
            return self._velocity_mps
        limit, left_m = self._limit[leg + 1], self._begin[leg + 1] - self._s
        begins_m = 0.5 * (self._lookahead_m if self._lookahead_m > 0.0 else limit)  # a turn begins before its corner
        return min(self._velocity_mps, sqrt(limit * limit + 2.0 * _BRAKE_MPS2 * max(0.0, left_m - begins_m)))

    def _on_leg(self, leg: int, s: float) -> Vec3:
        if not self._length:
            return self.points[0]
        share = (s - self._begin[leg]) / self._length[leg]
        (x, y, z), (dx, dy, dz) = self.points[leg], self._way[leg]
        return (x + share * dx, y + share * dy, z + share * dz)

    def _corner_speeds(self) -> list[float]:
        """Return the greatest speed at every point, from which the vehicle can brake for all later ones."""
        count = len(self.points)
        window_m = max(0.5 * _ADAPTIVE_LOOKAHEAD_PERIODS * PERIOD_S * self._velocity_mps, _LEAST_LOOKAHEAD_M)
        limits = [self._velocity_mps] * (count - 1) + [min(self._velocity_mps, _ARRIVED_MPS)]
        for i in range(1, count - 1):
            before, after = self._seen(i, -1, window_m), self._seen(i, 1, window_m)
            came, goes = minus(self.points[i], before), minus(after, self.points[i])
            angle = det_atan2(norm(cross(came, goes)), dot(came, goes))
            limits[i] = min(self._velocity_mps, _corner_speed(angle, self._lookahead_m))
        for i in range(count - 2, 0, -1):
            reachable = sqrt(limits[i + 1] * limits[i + 1] + 2.0 * _BRAKE_MPS2 * self._length[i])
            limits[i] = min(limits[i], reachable)
        return limits

    def _seen(self, i: int, direction: int, window_m: float) -> Vec3:
        """Return the point of the path a window before or after point i."""
        s = min(max(self._begin[i] + direction * window_m, 0.0), self._begin[-1])
        leg = min(max(bisect_right(self._begin, s) - 1, 0), len(self._length) - 1)
        return self._on_leg(leg, s)


def _corner_speed(angle_rad: float, lookahead_m: float) -> float:
    """Return the speed of a turn by an angle: near the corner, or the wider one that a lookahead above 0 asks for."""
    if angle_rad < 1e-6:
        return 1e9
    if lookahead_m > 0.0:
        return max(_LEAST_CORNER_MPS, sqrt(_WIDE_CORNER_MPS2 * lookahead_m / angle_rad))
    half = 0.5 * angle_rad
    return max(_LEAST_CORNER_MPS, min(_CORNER_RADPS / angle_rad, _CORNER_MPS * det_cos(half) / det_sin(half)))


class ToZ(Follow):
    """Flight straight up or down to a height."""

    def start(self, state: NedState) -> list[Vec3]:
        """Return the point at the height over the place of the start."""
        return [(state.p_m[0], state.p_m[1], self._points[0][2])]


class TakeOff(Follow):
    """Climb by 2 m at 0.5 m/s. Raises MoveError in `step` if the vehicle is moving already."""

    def __init__(self, timeout_s: float) -> None:
        super().__init__([(0.0, 0.0, 0.0)], PathOptions(TAKEOFF_SPEED_MPS, timeout_s))

    def start(self, state: NedState) -> list[Vec3]:
        """Return the point above the vehicle."""
        speed_mps = norm(state.v_mps)
        if speed_mps > _STANDING_MPS:
            raise MoveError(
                f"Cannot perform takeoff because vehicle is already moving with velocity {speed_mps:.6f} m/s"
            )
        x, y, z = state.p_m
        return [(x, y, z - TAKEOFF_HEIGHT_M)]


def move_on_path(path: Sequence[Vec3], options: PathOptions) -> Follow:
    """Fly through points. An empty path returns True at once."""
    return Follow(path, options)


def move_to_position(position_m: Vec3, options: PathOptions) -> Follow:
    """Fly to a place. moveToGPS is this with the place turned into NED."""
    return Follow([position_m], options)


def move_to_z(z_m: float, options: PathOptions) -> Follow:
    """Fly to a height."""
    return ToZ([(0.0, 0.0, z_m)], options._replace(drivetrain=Drivetrain.MAX_DEGREE_OF_FREEDOM))


def go_home(timeout_s: float) -> Follow:
    """Fly to the start at 0.5 m/s."""
    return Follow([(0.0, 0.0, 0.0)], PathOptions(TAKEOFF_SPEED_MPS, timeout_s))
