"""Closed walking path, a pure function of time: straight legs, rounded corners, lower speed in corners.

Along a corner of length l the heading turns by psi(u) = psi_0 + d_psi S(u), u = s/l, with the smoothstep S = 10 u^3 -
15 u^4 + 6 u^5, so heading, yaw rate and yaw acceleration are continuous. The position is the integral of the heading's
direction, tabulated at knots and interpolated by quintic Hermite polynomials; the velocity is their exact derivative.
Speed changes between cruise and corner by the same smoothstep in time.

This file makes the tables; `sim._kernels.WalkPath` evaluates them (in Python: tests/reference/walker_reference.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, sqrt

import numpy as np

from signals._kernel import det_atan2, det_cos, det_sin
from sim import _kernels

_KNOTS = 16  # pieces of a corner; error of the position < 1e-7 of the corner's length
_SUBSTEPS = 8  # Simpson panels within a piece
_PEAK_OF_SLOPE = 1.875  # largest S'(u)
_MAX_YAW_RATE_RADPS = 2.6
_BRAKING_MPS2 = 1.2

Piece = tuple[float, float, float, float, float]  # start time, duration, start s, speed before, speed after
Straight = tuple[float, float, float, float, float]  # start s, x, y, cos and sin of the heading
# Start s, length, heading, turn; then for each knot x, y and their first and second derivatives by s.
Corner = tuple[float, float, float, float, *tuple[float, ...]]


def smoothstep(u: float) -> float:
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def smoothstep_slope(u: float) -> float:
    return 30.0 * u * u * (1.0 - u) * (1.0 - u)


def _wrap(angle_rad: float) -> float:
    if angle_rad > pi:
        return angle_rad - 2.0 * pi
    return angle_rad + 2.0 * pi if angle_rad < -pi else angle_rad


def _unit_corner(turn_rad: float) -> list[tuple[float, float]]:
    """Return the positions at the knots of a corner of length 1 from the origin along x (Simpson's rule)."""
    points = [(0.0, 0.0)]
    x = y = 0.0
    step = 1.0 / (_KNOTS * _SUBSTEPS)
    for i in range(_KNOTS * _SUBSTEPS):
        for weight, u in ((1.0, i * step), (4.0, (i + 0.5) * step), (1.0, (i + 1) * step)):
            heading = turn_rad * smoothstep(u)
            x += weight * step / 6.0 * det_cos(heading)
            y += weight * step / 6.0 * det_sin(heading)
        if (i + 1) % _SUBSTEPS == 0:
            points.append((x, y))
    return points


class WalkPath(_kernels.WalkPath):
    """Path round a polygon, lap after lap. `start_lap`: position at t = 0, in laps from the first straight's start."""

    def __init__(
        self,
        vertices: Sequence[tuple[float, float]],
        speed_mps: float,
        *,
        corner_m: float = 1.5,
        start_lap: float = 0.0,
        max_yaw_rate_radps: float = _MAX_YAW_RATE_RADPS,
    ) -> None:
        """`corner_m`: distance before a vertex at which its corner begins; less if edges are short."""
        if len(vertices) < 3:
            raise ValueError("a closed path needs at least three vertices; for one along a line see `there_and_back`")
        self.speed_mps = speed_mps
        n = len(vertices)
        edges = [(vertices[(i + 1) % n][0] - x, vertices[(i + 1) % n][1] - y) for i, (x, y) in enumerate(vertices)]
        lengths = [sqrt(dx * dx + dy * dy) for dx, dy in edges]
        headings = [det_atan2(dy, dx) for dx, dy in edges]
        cut = [min(corner_m, 0.499 * lengths[i - 1], 0.499 * lengths[i]) for i in range(n)]  # before and after vertex i
        self.straights: list[Straight] = []
        self.corners: list[Corner] = []
        s = 0.0
        corner_speed = speed_mps
        spans: list[tuple[str, float]] = []
        for i in range(n):
            cos, sin = edges[i][0] / lengths[i], edges[i][1] / lengths[i]
            x, y = vertices[i][0] + cut[i] * cos, vertices[i][1] + cut[i] * sin
            after = (i + 1) % n
            straight_m = lengths[i] - cut[i] - cut[after]
            self.straights.append((s, x, y, cos, sin))
            spans.append(("straight", straight_m))
            s += straight_m
            turn = _wrap(headings[after] - headings[i])
            corner = _make_corner(
                s, (x + straight_m * cos, y + straight_m * sin), headings[i], turn, cut[after], lengths[after]
            )
            self.corners.append(corner)
            corner_length_m = corner[1]
            spans.append(("corner", corner_length_m))
            s += corner_length_m
            if turn != 0.0:
                corner_speed = min(corner_speed, max_yaw_rate_radps * corner_length_m / (_PEAK_OF_SLOPE * abs(turn)))
        self.lap_m = s
        self.pieces, self.lap_s = self._time_pieces(spans, corner_speed)
        self.offset_s = start_lap * self.lap_s
        super().__init__(
            pieces=np.array(self.pieces),
            straights=np.array(self.straights),
            corners=np.array(self.corners),
            lap_s=self.lap_s,
            offset_s=self.offset_s,
        )

    @property
    def max_speed_mps(self) -> float:
        """Greatest speed; corners are interpolated, so it differs slightly from the nominal one."""
        return 1.05 * self.speed_mps

    def _time_pieces(self, spans: list[tuple[str, float]], corner_speed: float) -> tuple[list[Piece], float]:
        """Return the pieces of the lap, and its duration [s]."""
        pieces: list[Piece] = []
        t = s = 0.0

        def add(duration_s: float, v0: float, v1: float) -> None:
            nonlocal t, s
            if duration_s > 0.0:
                pieces.append((t, duration_s, s, v0, v1))
                t += duration_s
                s += 0.5 * (v0 + v1) * duration_s

        for kind, length_m in spans:
            if kind == "corner":
                add(length_m / corner_speed, corner_speed, corner_speed)
                continue
            # Each change of speed takes (v^2 - v_c^2) / (2 a) metres, so short straights have a lower top speed.
            reachable = sqrt(corner_speed * corner_speed + length_m * _BRAKING_MPS2)
            top = min(self.speed_mps, reachable)
            change_s = (top - corner_speed) / _BRAKING_MPS2
            add(change_s, corner_speed, top)
            add((length_m - (top + corner_speed) * change_s) / top, top, top)
            add(change_s, top, corner_speed)
        return pieces, t


def _make_corner(
    start_m: float, begin: tuple[float, float], heading_rad: float, turn_rad: float, cut_m: float, next_edge_m: float
) -> Corner:
    unit = _unit_corner(turn_rad)
    end_x, end_y = unit[-1]
    chord = sqrt(end_x * end_x + end_y * end_y)
    # A corner begins and ends `cut` from its vertex: chord = 2 cut cos(turn/2).
    length = 2.0 * cut_m * det_cos(0.5 * turn_rad) / chord
    if not length > 1e-6 * next_edge_m:
        raise ValueError("a walking path turns back on itself; add a vertex in between")
    c, s = det_cos(heading_rad), det_sin(heading_rad)
    knots: list[float] = []
    for i, (px, py) in enumerate(unit):
        u = i / _KNOTS
        angle = heading_rad + turn_rad * smoothstep(u)
        bend = turn_rad * smoothstep_slope(u) / length
        ca, sa = det_cos(angle), det_sin(angle)
        x, y = begin[0] + length * (c * px - s * py), begin[1] + length * (s * px + c * py)
        knots += [x, y, ca, sa, -bend * sa, bend * ca]
    return start_m, length, heading_rad, turn_rad, *knots


def there_and_back(
    start: tuple[float, float],
    end: tuple[float, float],
    speed_mps: float,
    *,
    lane_m: float = 0.6,
    start_lap: float = 0.0,
) -> WalkPath:
    """Return a path from start to end and back on two lanes, `lane_m` apart, on both sides of the line start-end.

    The walker keeps to the right of the line.
    """
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = sqrt(dx * dx + dy * dy)
    nx, ny = 0.5 * lane_m * dy / length, -0.5 * lane_m * dx / length  # offset to the right of the way out
    vertices = [
        (start[0] + nx, start[1] + ny),
        (end[0] + nx, end[1] + ny),
        (end[0] - nx, end[1] - ny),
        (start[0] - nx, start[1] - ny),
    ]
    return WalkPath(vertices, speed_mps, corner_m=lane_m / 2, start_lap=start_lap)
