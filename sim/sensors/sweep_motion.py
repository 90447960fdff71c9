"""Motion of the vehicle during a sweep, interpolated between the truths at its ends.

With s <= 0 the time from the capture, and h the time since the previous truth:

    p(s)   = p + v s + c2 s^2 + c3 s^3                       cubic Hermite through (p, v) of both truths, at 0 and -h
    q(s)   = q exp(f(s)),   f(s) = w s + f2 s^2 + f3 s^3     the same for the rotation vector f, whose rate at -h is

    f' = w + f x w / 2 + f x (f x w) / 12             (inverse of exp's differential, to second order)

Error: fourth derivative times h^4 / 384, below 0.3 mm if the acceleration oscillates by 10 m/s2 at 1 Hz and h = 0.1 s.

Without a usable previous truth (first sweep, gap, rotation of more than `_MAX_TURN_RAD`), the motion is the Taylor
series at the capture: c2 = a / 2, c3 = 0, f2 = alpha / 2, f3 = w x alpha / 12. Its error is jerk times s^3 / 6.
"""

from __future__ import annotations

from signals._kernel import det_atan2
from signals.rotation import conjugate, cross, minus, norm, product
from signals.samples import Quat, TruthState, Vec3
from signals.time import NS_PER_S

_MAX_TURN_RAD = 1.0
Motion = tuple[Vec3, Vec3, Vec3, Vec3, Quat, Vec3, Vec3, Vec3]  # p, c1, c2, c3 in W; q_WB; f1, f2, f3 in B


def sweep_motion(now: TruthState, before: TruthState | None) -> Motion:
    """Return the coefficients of position and attitude over the time up to `now`."""
    if before is not None and before.t_ns < now.t_ns:
        turn = _rotation_vector(now.q_WB, before.q_WB)
        if norm(turn) <= _MAX_TURN_RAD:
            h = (now.t_ns - before.t_ns) / NS_PER_S
            step: Vec3 = minus(before.p_WB, now.p_WB)
            c2, c3 = _hermite(step, now.v_WB_W, before.v_WB_W, h)
            f2, f3 = _hermite(turn, now.w_WB_B, _rotation_rate(turn, before.w_WB_B), h)
            return now.p_WB, now.v_WB_W, c2, c3, now.q_WB, now.w_WB_B, f2, f3
    c2, f2 = _scaled(0.5, now.a_WB_W), _scaled(0.5, now.alpha_WB_B)
    f3 = _scaled(1.0 / 12.0, cross(now.w_WB_B, now.alpha_WB_B))
    return now.p_WB, now.v_WB_W, c2, (0.0, 0.0, 0.0), now.q_WB, now.w_WB_B, f2, f3


def at_rest(now: TruthState) -> Motion:
    """Return the motion of a sweep at the pose of the capture."""
    zero = (0.0, 0.0, 0.0)
    return now.p_WB, zero, zero, zero, now.q_WB, zero, zero, zero


def _hermite(step: Vec3, rate: Vec3, rate_before: Vec3, h: float) -> tuple[Vec3, Vec3]:
    """Return the coefficients of s^2 and s^3 with x(0) = 0, x'(0) = rate, x(-h) = step, x'(-h) = rate_before."""
    c2, c3 = [], []
    for d, a, b in zip(step, rate, rate_before, strict=True):
        # x(-h) + a h = c2 h^2 - c3 h^3 and x'(-h) - a = -2 c2 h + 3 c3 h^2
        u, w = (d + a * h) / (h * h), (b - a) / h
        c2.append(3.0 * u + w)
        c3.append((2.0 * u + w) / h)
    return (c2[0], c2[1], c2[2]), (c3[0], c3[1], c3[2])


def _rotation_vector(q: Quat, r: Quat) -> Vec3:
    """Return log(q^-1 r): the rotation from q to r, in the frame of q."""
    w, *vector = product(conjugate(q), r)
    v: Vec3 = (vector[0], vector[1], vector[2])
    if w < 0.0:  # the other quaternion of the same attitude is the shorter way
        w, v = -w, _scaled(-1.0, v)
    s = norm(v)
    return _scaled(2.0 * det_atan2(s, w) / s, v) if s > 1e-12 else _scaled(2.0, v)


def _rotation_rate(f: Vec3, w_B: Vec3) -> Vec3:
    """Return the rate of the rotation vector f at body rates w_B."""
    once = cross(f, w_B)
    twice = cross(f, once)
    return (
        w_B[0] + (0.5 * once[0] + twice[0] / 12.0),
        w_B[1] + (0.5 * once[1] + twice[1] / 12.0),
        w_B[2] + (0.5 * once[2] + twice[2] / 12.0),
    )


def _scaled(k: float, a: Vec3) -> Vec3:
    return k * a[0], k * a[1], k * a[2]
