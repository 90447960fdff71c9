"""Trajectory: a polyline with rounded corners, and a jerk-limited speed along it.

Path. Legs are straight. At a corner between unit directions u1 and u2 (angle theta) an arc of radius r replaces the
tip, touching both legs at a distance r tan(theta/2) from it:

    p(phi) = T + r (sin(phi) u1 + (1 - cos(phi)) n),   n = (u2 - (u1.u2) u1) / |...|,   0 <= phi <= theta

The arc leaves the legs by at most r (1 - cos(theta/2)); r is chosen so that this is `corner_deviation_m`. So the
path is smooth and its distance from the plan is bounded.

Speed. v(s) obeys the limit of the piece it is on and can always brake, at acceleration a and jerk j, to the limit v1
that begins at distance d. PX4's closed form for that (`math::trajectory::computeMaxSpeedFromDistance`):

    v = (-b + sqrt(b^2 + 4 (2 a d + v1^2))) / 2,   b = 4 a^2 / j

All in local NED, m, m/s, m/s2; only + - * / sqrt and `elementary`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, sqrt
from typing import NamedTuple

from firmware_bridge.mock_pixhawk import elementary as el

Point = tuple[float, float, float]

_STRAIGHT = 1.0 - 1e-7  # cosine of a turn that needs no arc: less than 0.03 degrees
_REVERSAL = -0.95  # cosine of a turn too sharp for an arc: turn on the spot
_CORNER_STOP_MPS = 0.15  # speed over a corner without arc; not 0, or the corner would never be reached
_SNAP_M = 0.002  # the end counts as reached within this distance
_CREEP_MPS = 0.5
_SPEED_GAIN = 4.0  # 1/s: how fast the speed approaches its target when jerk and acceleration leave room


class Limits(NamedTuple):
    """Limits of speed, acceleration and jerk along a path."""

    speed_up_mps: float
    speed_down_mps: float
    accel_mps2: float
    jerk_mps3: float
    accel_lateral_mps2: float  # in corners
    corner_deviation_m: float  # largest distance of a rounded corner from the legs


class Piece(NamedTuple):
    """A straight (radius 0) or an arc. It begins at `start` in direction `u`, at path length `s0`."""

    s0: float
    length: float
    start: Point
    u: Point
    n: Point  # towards the centre; arcs only
    radius: float
    speed: float


def _braking_speed(distance_m: float, speed_then_mps: float, accel_mps2: float, jerk_mps3: float) -> float:
    b = 4.0 * accel_mps2 * accel_mps2 / jerk_mps3
    c = 2.0 * accel_mps2 * distance_m + speed_then_mps * speed_then_mps
    return 0.5 * (sqrt(b * b + 4.0 * c) - b)


def max_speed_mps(distance_m: float, speed_then_mps: float, accel_mps2: float, jerk_mps3: float) -> float:
    """Return the highest speed from which braking to `speed_then_mps` takes at most `distance_m` >= 0."""
    v = _braking_speed(distance_m, speed_then_mps, accel_mps2, jerk_mps3)
    if v < _CREEP_MPS:
        # The closed form is slow near the end (v = 0.7/s * d). At this speed twice the jerk is allowed.
        v = max(v, min(_braking_speed(distance_m, speed_then_mps, accel_mps2, 2.0 * jerk_mps3), _CREEP_MPS))
    # For d near 0 the root is less than v1, because of the time the jerk takes.
    return max(v, speed_then_mps)


def _leg_speed(u: Point, speed: float, limits: Limits) -> float:
    horizontal = sqrt(u[0] * u[0] + u[1] * u[1])
    v = speed / horizontal if horizontal > 1e-3 else 1e3
    if u[2] < -1e-3:
        v = min(v, limits.speed_up_mps / -u[2])
    elif u[2] > 1e-3:
        v = min(v, limits.speed_down_mps / u[2])
    return v


class Trajectory:
    """A moving set-point on a path through `points`.

    `speeds[i]` is the horizontal speed of the leg that ends at points[i + 1]. `waypoint_s[i]` is the path length at
    which points[i] is passed. Coinciding points are allowed. Call `advance` once per guidance step.
    """

    __slots__ = ("_limits", "_pieces", "a", "length", "piece", "position", "s", "tangent", "v", "waypoint_s")

    def __init__(self, points: Sequence[Point], speeds: Sequence[float], limits: Limits) -> None:
        self._limits = limits
        self.s = 0.0
        self.v = 0.0
        self.a = 0.0
        self.piece = 0
        self._pieces: list[Piece] = []
        self.waypoint_s: list[float] = []
        self.length = 0.0
        self._build(list(points), list(speeds))
        self.position: Point = points[0]
        self.tangent: Point = self._pieces[0].u if self._pieces else (0.0, 0.0, 0.0)

    def _build(self, points: list[Point], speeds: list[float]) -> None:
        """Build the straights and arcs through `points`."""
        limits = self._limits
        # Legs between distinct points: (start index, unit vector, length, speed, its horizontal limit).
        legs: list[tuple[int, Point, float, float, float]] = []
        for i in range(len(points) - 1):
            a, b = points[i], points[i + 1]
            dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            length = sqrt(dx * dx + dy * dy + dz * dz)
            if length > 1e-3:
                u = (dx / length, dy / length, dz / length)
                legs.append((i, u, length, _leg_speed(u, speeds[i], limits), speeds[i]))
        passed = [0.0] * len(points)
        s = 0.0
        cut_before = 0.0
        for k, (i, u, length, speed, level) in enumerate(legs):
            next_leg = legs[k + 1] if k + 1 < len(legs) else None
            cut, arc = 0.0, None
            if next_leg is not None:
                most = min(speed, next_leg[3], level, next_leg[4])
                cut, arc = self._corner(u, length, next_leg[1], next_leg[2], most)
            a = points[i]
            start = (a[0] + cut_before * u[0], a[1] + cut_before * u[1], a[2] + cut_before * u[2])
            straight = length - cut_before - cut
            self._pieces.append(Piece(s, straight, start, u, (0.0, 0.0, 0.0), 0.0, speed))
            s += straight
            corner_s = s
            if arc is not None:
                n, radius, arc_length, arc_speed = arc
                end = (
                    start[0] + straight * u[0],
                    start[1] + straight * u[1],
                    start[2] + straight * u[2],
                )
                self._pieces.append(Piece(s, arc_length, end, u, n, radius, arc_speed))
                corner_s = s + 0.5 * arc_length
                s += arc_length
            # All points up to the start of the next leg coincide with this corner.
            last = next_leg[0] if next_leg is not None else len(points) - 1
            for index in range(i + 1, last + 1):
                passed[index] = corner_s
            cut_before = cut
        self.waypoint_s = passed
        self.length = s

    def _corner(
        self, u1: Point, len1: float, u2: Point, len2: float, speed: float
    ) -> tuple[float, tuple[Point, float, float, float] | None]:
        """Return the length cut off both legs, and (n, radius, arc length, speed) of the arc or None for no arc."""
        c = u1[0] * u2[0] + u1[1] * u2[1] + u1[2] * u2[2]
        if c > _STRAIGHT:
            return 0.0, None
        if c < _REVERSAL:
            return 0.0, ((0.0, 0.0, 0.0), 0.0, 0.0, _CORNER_STOP_MPS)
        w = (u2[0] - c * u1[0], u2[1] - c * u1[1], u2[2] - c * u1[2])
        sine = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
        n = (w[0] / sine, w[1] / sine, w[2] / sine)
        tan_half = sine / (1.0 + c)
        cos_half = sqrt(0.5 * (1.0 + c))
        radius = min(
            self._limits.corner_deviation_m / (1.0 - cos_half),
            0.45 * min(len1, len2) / tan_half,
        )
        cut = radius * tan_half
        arc_speed = min(speed, sqrt(self._limits.accel_lateral_mps2 * radius))
        turn = el.atan2(sine, c)
        # Along the arc the direction is cos(phi) u1 + sin(phi) n, 0 <= phi <= turn: steepest at `peak`, or at an end.
        up = -1.0 if u1[2] < 0.0 else 1.0
        peak = el.atan2(up * n[2], up * u1[2])
        peak = peak if peak >= 0.0 else peak + pi
        steepest = sqrt(u1[2] * u1[2] + n[2] * n[2]) if peak <= turn else max(abs(u1[2]), abs(u2[2]))
        if steepest > 1e-3:
            arc_speed = min(arc_speed, min(self._limits.speed_up_mps, self._limits.speed_down_mps) / steepest)
        return cut, (n, radius, radius * turn, arc_speed)

    @property
    def done(self) -> bool:
        """True once the set-point rests at the end of the path."""
        return self.s >= self.length

    def _allowed_speed(self) -> float:
        limits = self._limits
        accel, jerk = limits.accel_mps2, limits.jerk_mps3
        pieces = self._pieces
        speed = pieces[self.piece].speed
        horizon = speed * speed / accel + 2.0 * speed * accel / jerk + 1.0
        for piece in pieces[self.piece + 1 :]:
            ahead = piece.s0 - self.s
            if ahead > horizon:
                return speed
            if piece.speed < speed:
                speed = min(speed, max_speed_mps(max(ahead, 0.0), piece.speed, accel, jerk))
        return min(speed, max_speed_mps(max(self.length - self.s, 0.0), 0.0, accel, jerk))

    def advance(self, dt_s: float, stretch: float) -> None:
        """Advance by `dt_s`. `stretch` in 0..1 slows the set-point down for a vehicle that lags behind."""
        if not self._pieces or self.s >= self.length:
            self.s = self.length
            self.v = self.a = 0.0
            if self._pieces:
                self._update_position()
            return
        limits = self._limits
        error = self._allowed_speed() * stretch - self.v
        # Acceleration that the jerk limit can still bring to zero before the speed error is zero.
        bound = min(limits.accel_mps2, sqrt(2.0 * limits.jerk_mps3 * abs(error)), _SPEED_GAIN * abs(error))
        wanted = bound if error > 0.0 else -bound
        step = limits.jerk_mps3 * dt_s
        self.a += min(max(wanted - self.a, -step), step)
        self.v = max(self.v + self.a * dt_s, 0.0)
        self.s += self.v * dt_s
        if self.length - self.s < _SNAP_M and self.v < 0.1:
            self.s = self.length
        self.s = min(self.s, self.length)
        self._update_position()

    def _update_position(self) -> None:
        """Compute position and direction at s."""
        pieces = self._pieces
        while self.piece + 1 < len(pieces) and self.s >= pieces[self.piece + 1].s0:
            self.piece += 1
        piece = pieces[self.piece]
        x = min(self.s - piece.s0, piece.length)
        start, u = piece.start, piece.u
        if piece.radius == 0.0:
            self.position = (start[0] + x * u[0], start[1] + x * u[1], start[2] + x * u[2])
            self.tangent = u
            return
        phi = x / piece.radius
        sine, cosine = el.sin(phi), el.cos(phi)
        n, r = piece.n, piece.radius
        along, across = r * sine, r * (1.0 - cosine)
        self.position = (
            start[0] + along * u[0] + across * n[0],
            start[1] + along * u[1] + across * n[1],
            start[2] + along * u[2] + across * n[2],
        )
        self.tangent = (
            cosine * u[0] + sine * n[0],
            cosine * u[1] + sine * n[1],
            cosine * u[2] + sine * n[2],
        )

    def velocity(self) -> Point:
        """Return the velocity of the set-point."""
        t, v = self.tangent, self.v
        return (v * t[0], v * t[1], v * t[2])

    def acceleration(self) -> Point:
        """Return the acceleration of the set-point: a t + v^2 / r towards the centre."""
        t, a = self.tangent, self.a
        if not self._pieces:
            return (0.0, 0.0, 0.0)
        piece = self._pieces[self.piece]
        if piece.radius == 0.0:
            return (a * t[0], a * t[1], a * t[2])
        phi = min(self.s - piece.s0, piece.length) / piece.radius
        sine, cosine = el.sin(phi), el.cos(phi)
        k = self.v * self.v / piece.radius
        u, n = piece.u, piece.n
        return (
            a * t[0] + k * (cosine * n[0] - sine * u[0]),
            a * t[1] + k * (cosine * n[1] - sine * u[1]),
            a * t[2] + k * (cosine * n[2] - sine * u[2]),
        )

    def heading(self) -> float | None:
        """Return the direction of travel over ground [rad], or None on a vertical or empty path."""
        t = self.tangent
        if t[0] * t[0] + t[1] * t[1] < 0.01:
            return None
        return el.atan2(t[1], t[0])
