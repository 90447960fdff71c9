"""A walker in Python, from the equations of walk_path.py and walker.py: what the native one must equal bit for bit."""

from __future__ import annotations

from bisect import bisect_right
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from sim._kernels import det_cos, det_sin
from sim.scene.maps.walk_path import Corner, Straight, WalkPath, smoothstep, smoothstep_slope
from sim.scene.maps.walker import Walker

Place = tuple[float, float, float, float, float, float, float]
_PIECES = 16  # of a corner


def progress(path: WalkPath, t_ns: int) -> tuple[int, float, float]:
    """Whole laps, metres into the lap, and speed at `t_ns`."""
    t_s = t_ns / 1_000_000_000 + path.offset_s
    laps = int(t_s // path.lap_s)
    t_s -= laps * path.lap_s
    begun = bisect_right([piece[0] for piece in path.pieces], t_s)
    start_s, duration_s, start_m, v0, v1 = path.pieces[max(begun - 1, 0)]
    elapsed = t_s - start_s
    if v0 == v1:
        return laps, start_m + v0 * elapsed, v0
    u = elapsed / duration_s
    dv = v1 - v0
    integral = u * u * u * u * (2.5 + u * (u - 3.0))  # of the smoothstep
    return laps, start_m + v0 * elapsed + dv * duration_s * integral, v0 + dv * smoothstep(u)


def place(path: WalkPath, s_m: float) -> Place:
    """x, y [m], cos and sin of the heading, dx/ds, dy/ds, and heading change per metre, `s_m` into the lap."""
    segments = [segment for leg in zip(path.straights, path.corners, strict=True) for segment in leg]
    segment = segments[max(bisect_right([segment[0] for segment in segments], s_m) - 1, 0)]
    return _on_straight(segment, s_m) if len(segment) == 5 else _round_corner(segment, s_m)


def _on_straight(straight: Straight, s_m: float) -> Place:
    start_m, x, y, cos, sin = straight
    d = s_m - start_m
    return x + d * cos, y + d * sin, cos, sin, cos, sin, 0.0


def _round_corner(corner: Corner, s_m: float) -> Place:
    start_m, length_m, heading_rad, turn_rad, *knots = corner
    u = min(max((s_m - start_m) / length_m, 0.0), 1.0)
    heading = heading_rad + turn_rad * smoothstep(u)
    i = min(int(u * _PIECES), _PIECES - 1)
    h = length_m / _PIECES
    t = u * _PIECES - i
    a, b = knots[6 * i : 6 * i + 6], knots[6 * i + 6 : 6 * i + 12]
    x, dx = _hermite(a[0], a[2] * h, a[4] * h * h, b[0], b[2] * h, b[4] * h * h, t)
    y, dy = _hermite(a[1], a[3] * h, a[5] * h * h, b[1], b[3] * h, b[5] * h * h, t)
    yaw_per_m = turn_rad * smoothstep_slope(u) / length_m
    return x, y, det_cos(heading), det_sin(heading), dx / h, dy / h, yaw_per_m


def _hermite(
    p0: float, v0: float, a0: float, p1: float, v1: float, a1: float, t: float
) -> tuple[float, float]:  # fmt: skip
    """Value and slope at t of the quintic with these values, slopes and second derivatives at 0 and 1."""
    d = p1 - p0 - v0 - 0.5 * a0
    e = v1 - v0 - a0
    f = a1 - a0
    c3 = 10.0 * d - 4.0 * e + 0.5 * f
    c4 = -15.0 * d + 7.0 * e - f
    c5 = 6.0 * d - 3.0 * e + 0.5 * f
    value = p0 + t * (v0 + t * (0.5 * a0 + t * (c3 + t * (c4 + t * c5))))
    slope = v0 + t * (a0 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    return value, slope


def pose(walker: Walker, t_ns: int) -> tuple[NDArray[np.float64], ...]:
    """p_WB, q_WB, v_WB_W and w_WB_W of all limbs."""
    _, s_m, speed = progress(walker.path, t_ns)
    place_x, place_y, c, s, dx_ds, dy_ds, yaw_per_m = place(walker.path, s_m)
    per_m = walker.cycles_per_m
    rate, yaw_rate = speed * per_m, speed * yaw_per_m
    hc = sqrt(0.5 * (1.0 + c)) if c > -0.5 else 0.5 * abs(s) / sqrt(0.5 * (1.0 - c))  # half the heading
    hs = sqrt(0.5 * (1.0 - c)) if c < 0.5 else 0.5 * abs(s) / hc
    hs = -hs if s < 0.0 else hs
    p, q, v, w = [], [], [], []
    for x, y, z, tc, ts, yc, ys, dx, dy, dz, d_theta, d_yaw in walker.gait.rows(s_m * per_m % 1.0):
        rx, ry = c * x - s * y, s * x + c * y
        p.append((place_x + rx, place_y + ry, z + walker.ground_m))
        vx, vy = dx * rate, dy * rate
        v.append(
            (
                speed * dx_ds - yaw_rate * ry + (c * vx - s * vy),
                speed * dy_ds + yaw_rate * rx + (s * vx + c * vy),
                dz * rate,
            )
        )
        zc, zs = hc * yc - hs * ys, hs * yc + hc * ys
        q.append((zc * tc, -zs * ts, zc * ts, zs * tc))
        pitch_rate = d_theta * rate
        w.append((-pitch_rate * (2.0 * zc * zs), pitch_rate * (zc * zc - zs * zs), yaw_rate + d_yaw * rate))
    return np.array(p), np.array(q), np.array(v), np.array(w)
