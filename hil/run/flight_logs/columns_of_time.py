"""Series made of raw columns without rows that repeat a time or are not finite; positions at an attitude's times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.flight_log import Series

Column = NDArray[np.float64]

_NO_ROTATION = 0.05  # of a quaternion's norm; single precision has 1e-7
_POSITION_GAP_S = 1.0  # autopilots log positions at 5 Hz and more; over a longer time no curve is where it flew


def series_of(t_s: Column, values: NDArray[np.float64]) -> Series | None:
    """Return the finite rows in the order of their times, the first of those with one time; None if there is none."""
    values = np.asarray(values, np.float64)
    values = values[:, None] if values.ndim == 1 else values
    t_s = np.asarray(t_s, np.float64)
    kept = np.isfinite(t_s) & np.isfinite(values).all(axis=1)
    t_s, values = t_s[kept], values[kept]
    if not len(t_s):
        return None
    t_s, first = np.unique(t_s, return_index=True)
    return Series(np.ascontiguousarray(t_s), np.ascontiguousarray(values[first]))


def pose_of(attitude: Series, position: Series, velocity: Series | None) -> Series | None:
    """Return p_WB and q_WB at the attitude's times within the position's, outside its gaps; signs of q without jumps.

    An autopilot logs attitudes more often than positions. Between two positions p is the cubic with the positions and
    velocities of both (Hermite), or the straight line without velocities. The attitude, which has the fast motion, is
    taken as it is, where it is a rotation: a damaged log may have zeros there.
    """
    inside = (attitude.t_s >= position.t_s[0]) & (attitude.t_s <= position.t_s[-1])
    before = np.searchsorted(position.t_s, attitude.t_s, "right") - 1
    after = np.searchsorted(position.t_s, attitude.t_s, "left")
    last = len(position) - 1
    step_s = position.t_s[np.clip(after, 0, last)] - position.t_s[np.clip(before, 0, last)]
    inside &= step_s <= _POSITION_GAP_S
    inside &= np.abs(np.linalg.norm(attitude.values, axis=1) - 1.0) < _NO_ROTATION
    t_s = attitude.t_s[inside]
    if not len(t_s):
        return None
    q = continuous_quaternions(attitude.values[inside])
    return Series(np.ascontiguousarray(t_s), np.hstack([_positions_at(t_s, position, velocity), q]))


def continuous_quaternions(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit quaternions with the sign for which each is nearest to the one before it."""
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    dot = np.einsum("ij,ij->i", q[1:], q[:-1])
    flips = np.concatenate([[1.0], np.cumprod(np.where(dot < 0.0, -1.0, 1.0))])
    return q * flips[:, None]


def _positions_at(t_s: Column, position: Series, velocity: Series | None) -> NDArray[np.float64]:
    p, at = position.values, position.t_s
    if velocity is None or len(at) < 2 or len(velocity) < 2:
        return np.stack([np.interp(t_s, at, p[:, k]) for k in range(3)], axis=1)
    v = np.stack([np.interp(at, velocity.t_s, velocity.values[:, k]) for k in range(3)], axis=1)
    i = np.clip(np.searchsorted(at, t_s, "right") - 1, 0, len(at) - 2)
    step = (at[i + 1] - at[i])[:, None]
    s = (t_s - at[i])[:, None] / step
    return (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2 * p[i]
        + s * (1.0 - s) ** 2 * step * v[i]
        + s * s * (3.0 - 2.0 * s) * p[i + 1]
        + s * s * (s - 1.0) * step * v[i + 1]
    )
