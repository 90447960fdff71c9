"""Quantities that follow from others by differentiation, on an even grid of times within a stretch of a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from hil.run.flight_logs.flight_log import Series

Rows = NDArray[np.float64]


def grid_s(start_s: float, end_s: float, step_s: float) -> Rows:
    """Return times from `start_s` to `end_s`, both within."""
    return np.asarray(start_s + step_s * np.arange(int((end_s - start_s) / step_s) + 1), np.float64)


def at(series: Series, t_s: Rows) -> Rows:
    """Return the values at other times, by straight lines [n, m]."""
    return np.stack([np.interp(t_s, series.t_s, column) for column in series.values.T], axis=1)


def smoothed(rows: Rows, step_s: float, cutoff_hz: float) -> Rows:
    """Return an even grid's rows without what is faster than `cutoff_hz`, without delay (Butterworth, both ways)."""
    nyquist_hz = 0.5 / step_s
    if cutoff_hz >= 0.9 * nyquist_hz or len(rows) < 30:
        return rows
    return np.asarray(sosfiltfilt(butter(2, cutoff_hz / nyquist_hz, output="sos"), rows, axis=0), np.float64)


def derivative(rows: Rows, step_s: float) -> Rows:
    """Return central differences."""
    return np.asarray(np.gradient(rows, step_s, axis=0), np.float64)


def rotated(q: Rows, rows: Rows, *, back: bool = False) -> Rows:
    """Return R(q) v for rows, with `back` R(q)' v."""
    u = -q[:, 1:] if back else q[:, 1:]
    t = 2.0 * np.cross(u, rows)
    return rows + q[:, :1] * t + np.cross(u, t)


def attitude_rate(q: Rows, step_s: float) -> Rows:
    """Return the angular velocity in B that turns the attitudes of an even grid: 2 q* dq/dt."""
    dq = derivative(q, step_s)
    w, u = q[:, :1], q[:, 1:]
    dw, du = dq[:, :1], dq[:, 1:]
    return 2.0 * (w * du - dw * u - np.cross(u, du))


def attitude_at(pose: Series, t_s: Rows) -> Rows:
    """Return unit quaternions at other times, normalised straight lines."""
    q = at(Series(pose.t_s, pose.values[:, 3:]), t_s)
    return q / np.linalg.norm(q, axis=1, keepdims=True)
