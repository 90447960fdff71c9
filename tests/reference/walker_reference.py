"""A walker in Python, from the equations of walk_path.py (bit for bit) and of sim/native/gait.hpp (by angles)."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_sin
from sim.scene.maps.walk_path import Corner, Straight, WalkPath, smoothstep, smoothstep_slope
from sim.scene.maps.walker import Walker

Place = tuple[float, float, float, float, float, float, float]
_PIECES = 16  # of a corner


def progress(path: WalkPath, t_ns: int) -> tuple[int, float, float]:
    """Return whole laps, metres into the lap, and speed at `t_ns`."""
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
    """Return value and slope at t of the quintic with these values, slopes and second derivatives at 0 and 1."""
    d = p1 - p0 - v0 - 0.5 * a0
    e = v1 - v0 - a0
    f = a1 - a0
    c3 = 10.0 * d - 4.0 * e + 0.5 * f
    c4 = -15.0 * d + 7.0 * e - f
    c5 = 6.0 * d - 3.0 * e + 0.5 * f
    value = p0 + t * (v0 + t * (0.5 * a0 + t * (c3 + t * (c4 + t * c5))))
    slope = v0 + t * (a0 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    return value, slope


class Steps(NamedTuple):
    """The gait fitted to a figure's speed, from the values of `sim._kernels.fit_gait`."""

    cycle: float
    stance: float
    bob: float
    arm_rad: float
    lift: float
    ahead: float

    @staticmethod
    def of(walker: Walker) -> Steps:
        return Steps(*walker.gait[14:20])


def foot(walker: Walker, phase: float) -> tuple[float, float, float]:
    """Return x and z of the ankle and pitch of the foot that strikes at phase 0, in H."""
    f, g = walker.figure, Steps.of(walker)

    def stance(phase: float) -> tuple[float, float, float]:
        toe_up, heel_up = phase / (0.18 * g.stance), (phase / g.stance - 0.58) / 0.42
        pitch = -0.3 * (1.0 - smoothstep(toe_up)) if toe_up < 1.0 else smoothstep(heel_up) if heel_up > 0.0 else 0.0
        pivot_x = f.heel_m if heel_up < 0.0 else -f.ball_m  # from the ankle's foot point, backwards
        c, s = math.cos(pitch), math.sin(pitch)
        x = g.ahead - g.cycle * phase - pivot_x + pivot_x * c + f.ankle_m * s
        return x, f.ankle_m * c - pivot_x * s, pitch

    if phase <= g.stance:
        return stance(phase)
    u = (phase - g.stance) / (1.0 - g.stance)
    (x0, z0, _), (x1, z1, _) = stance(g.stance), stance(0.0)
    slope, blend = -g.cycle * (1.0 - g.stance), smoothstep(u)
    z = z0 + (z1 - z0) * blend + g.lift * (4.0 * u * (1.0 - u)) ** 3
    return x0 + slope * u + (x1 - x0 - slope) * blend, z, 1.0 - 1.3 * blend


def limbs(walker: Walker, phase: float) -> list[tuple[float, float, float, float, float]]:
    """Return x, y, z, pitch and yaw of every limb in H, in the order of LIMBS."""
    f, g, hip_m = walker.figure, Steps.of(walker), walker.gait[24]
    turn = 2.0 * math.pi * phase
    hip_z = hip_m + g.bob * math.sin(2.0 * turn - 0.7 * math.pi)
    yaw, torso_yaw, lean = -0.1 * math.cos(turn), 0.07 * math.cos(turn), 0.04

    def along(above_m: float) -> tuple[float, float]:
        return above_m * math.sin(lean), hip_z + above_m * math.cos(lean)

    (torso_x, torso_z), (head_x, head_z) = along(f.torso_above_hip_m), along(f.head_above_hip_m)
    found = [(0.0, 0.0, hip_z, 0.0, yaw), (torso_x, 0.0, torso_z, lean, torso_yaw), (head_x, 0.0, head_z, 0.0, 0.0)]
    for sign in (1.0, -1.0):
        x, z = along(f.shoulder_above_hip_m)
        x, y = x - sign * f.shoulder_half_m * math.sin(torso_yaw), sign * f.shoulder_half_m * math.cos(torso_yaw)
        upper = sign * g.arm_rad * math.cos(turn) - 0.05
        fore = upper - 0.22 - 0.175 * (1.0 - sign * math.cos(turn))
        for pitch, to_middle_m, length_m in (
            (upper, 0.5 * f.upper_arm_m, f.upper_arm_m),
            (fore, 0.5 * f.forearm_m, f.forearm_m),
            (fore, f.hand_m, 0.0),
        ):
            found.append((x - to_middle_m * math.sin(pitch), y, z - to_middle_m * math.cos(pitch), pitch, 0.0))
            x, z = x - length_m * math.sin(pitch), z - length_m * math.cos(pitch)
    for sign, shift in ((1.0, 0.0), (-1.0, 0.5)):
        hip_x, y = -sign * f.hip_half_m * math.sin(yaw), sign * f.hip_half_m
        ankle_x, ankle_z, pitch = foot(walker, (phase + shift) % 1.0)
        reach = math.hypot(ankle_x - hip_x, ankle_z - hip_z)
        # The law of cosines at the hip; the knee lies before the line from hip to ankle.
        bend = math.acos((f.thigh_m**2 + reach**2 - f.shank_m**2) / (2.0 * f.thigh_m * reach))
        thigh = math.atan2(hip_x - ankle_x, hip_z - ankle_z) - bend
        knee_x, knee_z = hip_x - f.thigh_m * math.sin(thigh), hip_z - f.thigh_m * math.cos(thigh)
        shank = math.atan2(knee_x - ankle_x, knee_z - ankle_z)
        found.append((0.5 * (hip_x + knee_x), y, 0.5 * (hip_z + knee_z), thigh, 0.0))
        found.append((0.5 * (knee_x + ankle_x), y, 0.5 * (knee_z + ankle_z), shank, 0.0))
        found.append((ankle_x, y, ankle_z, pitch, 0.0))
    return found


def pose(walker: Walker, t_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return p_WB and q_WB (w-x-y-z, w not negative) of all limbs."""
    _, s_m, _ = progress(walker.path, t_ns)
    at_x, at_y, c, s, *_ = place(walker.path, s_m)
    p, q = [], []
    for x, y, z, pitch, yaw in limbs(walker, s_m * walker.cycles_per_m % 1.0):
        p.append((at_x + c * x - s * y, at_y + s * x + c * y, z + walker.ground_m))
        half_z, half_y = 0.5 * (math.atan2(s, c) + yaw), 0.5 * pitch
        zc, zs, tc, ts = math.cos(half_z), math.sin(half_z), math.cos(half_y), math.sin(half_y)
        q.append(upright((zc * tc, -zs * ts, zc * ts, zs * tc)))
    return np.array(p), np.array(q)


def upright(q: Any) -> Any:
    """Return the rotation's quaternion whose w is not negative."""
    return q if q[0] >= 0.0 else tuple(-component for component in q)
