"""Rotor speeds as they were, from telemetry that is noisy.

Noise in a regressor biases what multiplies it towards zero: with 1 % of noise on the speeds of a small quadrotor, half
of the differences between motors is noise, and its inertia comes out twice too large. A smoothed speed has the
opposite property (Berkson): its error is uncorrelated with itself, and the fit stays unbiased. Per motor,
    O_k+1 = O_k + V_k h,  V_k+1 = phi V_k + w_k,  y_k = O_k + n_k
with the variances of w and n by maximum likelihood over the log, smoothed by Rauch, Tung and Striebel's recursion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.flight_log import Series

Array = NDArray[np.float64]
_LEAP, _LEAP_RADPS, _MOST_DOUBTED = 0.5, 100.0, 3  # of a speed from one sample to the next
_LEARN_FROM = 600  # samples at the start, for the variances
_CORRELATION_S = 0.03  # of a motor's acceleration: about the lag of small motors
_RATIOS = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # of the noise to the speed's change within a sample


def _filter(y: Array, h: float, phi: float, q: float, r: float) -> tuple[Array, Array, Array, Array, float]:
    n = y.shape[0]
    F = np.array([[1.0, h], [0.0, phi]])
    Q = np.array([[0.0, 0.0], [0.0, q]])
    xs, Ps = np.zeros((n, 2, y.shape[1])), np.zeros((n, 2, 2))
    xp, Pp = np.zeros_like(xs), np.zeros_like(Ps)
    x, P = np.vstack([y[0], np.zeros(y.shape[1])]), np.diag([r, q / max(1e-9, 1 - phi * phi)])
    squares, logs = 0.0, 0.0
    for k in range(n):
        if k:
            x, P = F @ x, F @ P @ F.T + Q
        xp[k], Pp[k] = x, P
        e, S = y[k] - x[0], P[0, 0] + r
        squares += float((e * e).sum()) / S
        logs += np.log(S) * len(e)
        K = P[:, 0] / S
        x, P = x + K[:, None] * e, P - np.outer(K, P[0])
        xs[k], Ps[k] = x, P
    return xs, Ps, xp, Pp, squares + logs


def without_spikes(y: Array) -> Array:
    """Return speeds in which one that no rotor can reach within a sample is the one before it; three in a row are true.

    Telemetry of speed controllers has a wrong value now and then, 10 to 50 times too large. Only the past decides.
    """
    found = y.copy()
    for motor in found.T:
        doubted = 0
        for k in range(1, len(motor)):
            if abs(motor[k] - motor[k - 1]) > _LEAP * motor[k - 1] + _LEAP_RADPS and doubted < _MOST_DOUBTED:
                motor[k], doubted = motor[k - 1], doubted + 1
            else:
                doubted = 0
    return found


def smoothed(series: Series, *, lag: int | None = None) -> tuple[Array, Array]:
    """Return speeds and slopes at the telemetry's times, from all of it or from what comes up to `lag` samples later.

    Evenly spaced telemetry is assumed to within a sample.
    """
    y = without_spikes(series.values)
    h = float(np.median(np.diff(series.t_s)))
    phi = float(np.exp(-h / _CORRELATION_S))
    part = y[: min(len(y), _LEARN_FROM)]
    scale = max(float(np.var(np.diff(part, axis=0))), 1e-12)
    q0 = scale / (h * h) * (1 - phi * phi)
    best = min(
        ((q, r) for q in (0.1 * q0, 0.3 * q0, q0) for r in (scale * x for x in _RATIOS)),
        key=lambda pair: _filter(part, h, phi, *pair)[4],
    )
    F = np.array([[1.0, h], [0.0, phi]])
    xs, Ps, xp, Pp, _ = _filter(y, h, phi, *best)
    C = Ps[:-1] @ F.T @ np.linalg.inv(Pp[1:])
    if lag is None:
        for k in range(len(y) - 2, -1, -1):
            xs[k] += C[k] @ (xs[k + 1] - xp[k + 1])
        return np.ascontiguousarray(xs[:, 0, :]), np.ascontiguousarray(xs[:, 1, :])
    found = xs.copy()
    for _ in range(lag):  # each time from one sample more
        found[:-1] = xs[:-1] + C @ (found[1:] - xp[1:])
    return np.ascontiguousarray(found[:, 0, :]), np.ascontiguousarray(found[:, 1, :])
