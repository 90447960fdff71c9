"""A smooth flight along a way, as truth at every tick: rest, climb, hover, the way at a speed, hover.

Nothing flies it: positions are a curve, and attitude, rates and accelerations are what a quadrotor needs for it (thrust
along its own z, against gravity and a drag that is linear in speed). So a hundred flights cost what one with an
autopilot does, and its sensors are the bench's own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from hil.signals.samples import TruthState
from hil.signals.units import STANDARD_GRAVITY_MPS2

Float64 = NDArray[np.float64]

_DRAG_PER_S = 0.12
_REST_S, _HOVER_S = 3.0, 2.0
_CLIMB_MPS, _ACCEL_MPS2, _SIDE_MPS2 = 1.5, 1.2, 1.5
_SMOOTH_S = 0.45  # standard deviation of the window over positions
_GROUND_M = 0.2
_SWAY_M = 0.1  # to the sides
_TICK_NS = 4_000_000


@dataclass(frozen=True)
class Flight:
    """Truth by tick."""

    truths: tuple[TruthState, ...]
    tick_ns: int
    start_W: tuple[float, float, float, float]  # x, y, z, yaw


def fly(way_xy: Float64, *, height_m: float, speed_mps: float, turns: bool = True) -> Flight:
    """Along a way (n, 2). `turns`: looks where it goes; else east."""
    dt = _TICK_NS * 1e-9
    xy = _along(_rounded(way_xy), speed_mps, dt)
    climb = np.arange(0.0, 1.0, dt * _CLIMB_MPS / max(height_m - _GROUND_M, 0.5))
    rest, hover = round(_REST_S / dt), round(_HOVER_S / dt)
    z = np.concatenate([np.full(rest, _GROUND_M), _GROUND_M + (height_m - _GROUND_M) * climb, np.full(hover, height_m)])
    before = len(z)
    p = np.empty((before + len(xy) + hover, 3))
    p[:before, :2], p[before : before + len(xy), :2], p[before + len(xy) :, :2] = xy[0], xy, xy[-1]
    p[:before, 2], p[before:, 2] = z, height_m
    p = _smoothed(p, round(_SMOOTH_S / dt))
    t = np.arange(len(p)) * dt
    course = _course(np.asarray(np.gradient(p, dt, axis=0)), dt)
    share = _smoothed(np.clip((p[:, 2:] - _GROUND_M - 0.5) / 2.0, 0.0, 1.0), round(_SMOOTH_S / dt))
    swing = _SWAY_M * np.stack([np.sin(1.9 * t), np.sin(2.3 * t + 1.0), 0.6 * np.sin(1.3 * t + 0.5)], axis=-1)
    p = p + swing * share
    v = np.asarray(np.gradient(p, dt, axis=0))
    a = np.asarray(np.gradient(v, dt, axis=0))
    yaw = course if turns else np.zeros(len(p))
    return Flight(_truths(p, v, a, yaw), _TICK_NS, (*p[0].tolist(), float(yaw[0])))


def _rounded(way_xy: Float64) -> Float64:
    """Evenly spaced every 0.1 m, corners rounded."""
    for sigma_m in (0.0, 1.2):
        lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way_xy, axis=0), axis=1))])
        s = np.linspace(0.0, lengths[-1], max(2, round(lengths[-1] / 0.1)))
        way_xy = np.stack([np.interp(s, lengths, way_xy[:, k]) for k in (0, 1)], axis=-1)
        if sigma_m > 0.0:
            way_xy = _smoothed(way_xy, round(sigma_m / 0.1))
    return way_xy


def _smoothed(rows: Float64, sigma: int) -> Float64:
    """Gaussian window, the ends held."""
    return np.asarray(gaussian_filter1d(rows, sigma, axis=0, mode="nearest", truncate=3.0))


def _along(xy: Float64, speed_mps: float, dt: float) -> Float64:
    """Positions at every tick: as fast as speed, bends and the ends allow."""
    step = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    tangent = np.diff(xy, axis=0) / np.maximum(step, 1e-9)[:, None]
    bend = np.linalg.norm(np.diff(tangent, axis=0), axis=1) / np.maximum(step[1:], 1e-9)
    most = np.full(len(xy), speed_mps)
    most[1:-1] = np.minimum(most[1:-1], np.sqrt(_SIDE_MPS2 / np.maximum(bend, 1e-6)))
    most[0] = most[-1] = 0.05
    for order in (range(1, len(xy)), range(len(xy) - 2, -1, -1)):
        back = -1 if order.step == 1 else 1
        for i in order:
            gap = step[min(i, i + back)]
            most[i] = min(most[i], (most[i + back] ** 2 + 2.0 * _ACCEL_MPS2 * gap) ** 0.5)
    t = np.concatenate([[0.0], np.cumsum(2.0 * step / (most[1:] + most[:-1]))])
    ticks = np.arange(0.0, t[-1], dt)
    return np.stack([np.interp(ticks, t, xy[:, k]) for k in (0, 1)], axis=-1)


def _course(v: Float64, dt: float) -> Float64:
    """Heading of the motion, held where it is slow, turned smoothly."""
    fast = np.hypot(v[:, 0], v[:, 1]) > 0.3
    if not fast.any():
        return np.zeros(len(v))
    heading = np.unwrap(np.arctan2(v[fast, 1], v[fast, 0]))
    at = np.flatnonzero(fast)
    return _smoothed(np.interp(np.arange(len(v)), at, heading), round(0.5 / dt))


def _truths(p: Float64, v: Float64, a: Float64, yaw: Float64) -> tuple[TruthState, ...]:
    dt = _TICK_NS * 1e-9
    up = a + _DRAG_PER_S * v + np.array([0.0, 0.0, STANDARD_GRAVITY_MPS2])
    up /= np.linalg.norm(up, axis=1)[:, None]
    # The shortest turn from world up to `up`, after one by yaw.
    lean = np.stack([-up[:, 1], up[:, 0], np.zeros(len(up)), 1.0 + up[:, 2]], axis=-1)
    R_WB = Rotation.from_quat(lean) * Rotation.from_rotvec(yaw[:, None] * np.array([0.0, 0.0, 1.0]))
    q = R_WB.as_quat()[:, [3, 0, 1, 2]]
    turn = (R_WB[:-1].inv() * R_WB[1:]).as_rotvec() / dt
    rates = np.concatenate([turn[:1], turn])
    alpha = np.concatenate([np.zeros((1, 3)), np.diff(rates, axis=0) / dt])
    rows = zip(*(map(tuple, values.tolist()) for values in (p, q, v, rates, a, alpha)), strict=True)
    return tuple(
        TruthState(k, k * _TICK_NS, p_k, q_k, v_k, w_k, a_k, alpha_k, (), False)
        for k, (p_k, q_k, v_k, w_k, a_k, alpha_k) in enumerate(rows)
    )
