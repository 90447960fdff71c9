"""Smooth flight along a path, as the true state at every tick: rest, climb, hover, the path, hover.

There is no autopilot: positions follow a curve, and attitude, rates and accelerations are those of a quadrotor that
flies it (thrust along its z axis against gravity and linear drag). A hundred such flights take as long as one flight
with an autopilot. The bench's sensors can sample them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from signals.samples import TruthState
from signals.units import STANDARD_GRAVITY_MPS2

Float64 = NDArray[np.float64]

_DRAG_PER_S = 0.12
_REST_S, _HOVER_S = 3.0, 2.0
_CLIMB_MPS, _MAX_ACCEL_MPS2, _MAX_SIDEWAYS_MPS2 = 1.5, 1.2, 1.5
_SMOOTH_S = 0.45  # standard deviation of the Gaussian that smooths the positions
_START_HEIGHT_M = 0.2
_SWAY_M = 0.1  # sideways amplitude
_TICK_NS = 4_000_000


@dataclass(frozen=True)
class Flight:
    """True states by tick, and the start pose x, y, z [m], yaw [rad] in W."""

    truths: tuple[TruthState, ...]
    tick_ns: int
    start_W: tuple[float, float, float, float]


def fly(path_xy: Float64, *, height_m: float, speed_mps: float, nose_along_path: bool = True) -> Flight:
    """Fly along a path (n, 2) in W [m]; the nose points along the path or east."""
    dt = _TICK_NS * 1e-9
    xy = _positions_by_tick(_rounded(path_xy), speed_mps, dt)
    climb = np.arange(0.0, 1.0, dt * _CLIMB_MPS / max(height_m - _START_HEIGHT_M, 0.5))
    rest, hover = round(_REST_S / dt), round(_HOVER_S / dt)
    z = np.concatenate(
        [
            np.full(rest, _START_HEIGHT_M),
            _START_HEIGHT_M + (height_m - _START_HEIGHT_M) * climb,
            np.full(hover, height_m),
        ]
    )
    path_start = len(z)
    p = np.empty((path_start + len(xy) + hover, 3))
    path_end = path_start + len(xy)
    p[:path_start, :2], p[path_start:path_end, :2], p[path_end:, :2] = xy[0], xy, xy[-1]
    p[:path_start, 2], p[path_start:, 2] = z, height_m
    p = _smoothed(p, round(_SMOOTH_S / dt))
    t = np.arange(len(p)) * dt
    course = _course(np.asarray(np.gradient(p, dt, axis=0)), dt)
    sway_share = _smoothed(np.clip((p[:, 2:] - _START_HEIGHT_M - 0.5) / 2.0, 0.0, 1.0), round(_SMOOTH_S / dt))
    sway = _SWAY_M * np.stack([np.sin(1.9 * t), np.sin(2.3 * t + 1.0), 0.6 * np.sin(1.3 * t + 0.5)], axis=-1)
    p = p + sway * sway_share
    v = np.asarray(np.gradient(p, dt, axis=0))
    a = np.asarray(np.gradient(v, dt, axis=0))
    yaw = course if nose_along_path else np.zeros(len(p))
    return Flight(_truths(p, v, a, yaw), _TICK_NS, (*p[0].tolist(), float(yaw[0])))


def _rounded(path_xy: Float64) -> Float64:
    """Return the path resampled every 0.1 m, with rounded corners."""
    for sigma_m in (0.0, 1.2):
        lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path_xy, axis=0), axis=1))])
        s = np.linspace(0.0, lengths[-1], max(2, round(lengths[-1] / 0.1)))
        path_xy = np.stack([np.interp(s, lengths, path_xy[:, k]) for k in (0, 1)], axis=-1)
        if sigma_m > 0.0:
            path_xy = _smoothed(path_xy, round(sigma_m / 0.1))
    return path_xy


def _smoothed(rows: Float64, sigma: int) -> Float64:
    """Return the rows filtered by a Gaussian of `sigma` rows, extended with the end values."""
    return np.asarray(gaussian_filter1d(rows, sigma, axis=0, mode="nearest", truncate=3.0))


def _positions_by_tick(xy: Float64, speed_mps: float, dt: float) -> Float64:
    """Return the positions at every tick, at the greatest speed within the limits of speed and acceleration."""
    step = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    tangent = np.diff(xy, axis=0) / np.maximum(step, 1e-9)[:, None]
    curvature = np.linalg.norm(np.diff(tangent, axis=0), axis=1) / np.maximum(step[1:], 1e-9)
    max_mps = np.full(len(xy), speed_mps)
    max_mps[1:-1] = np.minimum(max_mps[1:-1], np.sqrt(_MAX_SIDEWAYS_MPS2 / np.maximum(curvature, 1e-6)))
    max_mps[0] = max_mps[-1] = 0.05
    for indices in (range(1, len(xy)), range(len(xy) - 2, -1, -1)):
        neighbour = -1 if indices.step == 1 else 1
        for i in indices:
            gap = step[min(i, i + neighbour)]
            max_mps[i] = min(max_mps[i], (max_mps[i + neighbour] ** 2 + 2.0 * _MAX_ACCEL_MPS2 * gap) ** 0.5)
    t = np.concatenate([[0.0], np.cumsum(2.0 * step / (max_mps[1:] + max_mps[:-1]))])
    ticks = np.arange(0.0, t[-1], dt)
    return np.stack([np.interp(ticks, t, xy[:, k]) for k in (0, 1)], axis=-1)


def _course(v: Float64, dt: float) -> Float64:
    """Return the smoothed direction of motion [rad from east]; below 0.3 m/s it is interpolated."""
    fast = np.hypot(v[:, 0], v[:, 1]) > 0.3
    if not fast.any():
        return np.zeros(len(v))
    heading = np.unwrap(np.arctan2(v[fast, 1], v[fast, 0]))
    fast_indices = np.flatnonzero(fast)
    return _smoothed(np.interp(np.arange(len(v)), fast_indices, heading), round(0.5 / dt))


def _truths(p: Float64, v: Float64, a: Float64, yaw: Float64) -> tuple[TruthState, ...]:
    dt = _TICK_NS * 1e-9
    up = a + _DRAG_PER_S * v + np.array([0.0, 0.0, STANDARD_GRAVITY_MPS2])
    up /= np.linalg.norm(up, axis=1)[:, None]
    # Rotation by yaw, then the shortest rotation from world up to `up`.
    tilt = np.stack([-up[:, 1], up[:, 0], np.zeros(len(up)), 1.0 + up[:, 2]], axis=-1)
    R_WB = Rotation.from_quat(tilt) * Rotation.from_rotvec(yaw[:, None] * np.array([0.0, 0.0, 1.0]))
    q = R_WB.as_quat()[:, [3, 0, 1, 2]]
    w_B = (R_WB[:-1].inv() * R_WB[1:]).as_rotvec() / dt
    rates = np.concatenate([w_B[:1], w_B])
    alpha = np.concatenate([np.zeros((1, 3)), np.diff(rates, axis=0) / dt])
    rows = zip(*(map(tuple, values.tolist()) for values in (p, q, v, rates, a, alpha)), strict=True)
    return tuple(
        TruthState(k, k * _TICK_NS, p_k, q_k, v_k, w_k, a_k, alpha_k, (), False)
        for k, (p_k, q_k, v_k, w_k, a_k, alpha_k) in enumerate(rows)
    )
