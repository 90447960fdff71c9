"""First guess of the delays between motors, gyro and pose, by cross-correlation. The estimator refines them.

motors -> gyro   d/dt(w) against the torque of the vehicle's model; the motors' own lag is in it
gyro -> pose     the attitude's rate against the gyro's
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.rates_of_change import at, attitude_at, attitude_rate, derivative, grid_s, smoothed
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.flight_logs.rotor_model import steady_speeds_radps, wrench
from sim.physics.vehicle import Vehicle

Rows = NDArray[np.float64]

_STEP_S = 0.004
_MOST_S = 0.25
_LEAST_S = -0.1
_CUTOFF_HZ = 12.0
_MOST_MOTOR_STEP_S = 0.025  # rarer outputs were held or changed in between, which no correlation shows
_LEAST_CORRELATION = 0.4  # below it no peak stands out


@dataclass(frozen=True)
class Delays:
    """Delays of one flight [s]; None where the flight does not show them. Positive: the second is later."""

    motors_to_gyro_s: float | None
    gyro_to_pose_s: float | None


def delays_of(log: FlightLog, vehicle: Vehicle) -> Delays:
    """Return the delays at which the series of a flight fit each other best."""
    if log.rate is None:
        return Delays(None, None)
    t_s = grid_s(log.start_s, log.end_s, _STEP_S)
    gyro = smoothed(at(log.rate, t_s), _STEP_S, _CUTOFF_HZ)
    torque = wrench(steady_speeds_radps(log, vehicle), vehicle)[:, 3:]
    # A command holds until the next one, so it acts half a period later than a straight line between both says.
    held = torque[np.clip(np.searchsorted(log.motors.t_s, t_s, "right") - 1, 0, None)]
    motors = None
    if len(log.motors) > 1 and float(np.median(np.diff(log.motors.t_s))) <= _MOST_MOTOR_STEP_S:
        motors = lag_s(smoothed(held, _STEP_S, _CUTOFF_HZ)[:, :2], derivative(gyro, _STEP_S)[:, :2])
    pose = None
    if log.pose is not None and len(log.pose) > 50:
        turned = smoothed(attitude_rate(attitude_at(log.pose, t_s), _STEP_S), _STEP_S, _CUTOFF_HZ)
        pose = lag_s(gyro, turned)
    return Delays(motors, pose)


def lag_s(cause: Rows, effect: Rows, step_s: float = _STEP_S) -> float | None:
    """Return by how much `effect` is later than `cause`: the peak of their correlation, between grid points.

    Both are [n, m] on one even grid; their columns count together, each with its own scale. None without a peak.
    """
    if len(cause) < 100:
        return None
    a, b = _standard(cause), _standard(effect)
    lags = np.arange(round(_LEAST_S / step_s), round(_MOST_S / step_s) + 1)
    values = np.array([_correlation(a, b, int(lag)) for lag in lags])
    best = int(np.argmax(values))
    if values[best] < _LEAST_CORRELATION or best in (0, len(lags) - 1):
        return None
    before, peak, after = values[best - 1 : best + 2]
    curvature = before - 2.0 * peak + after
    between = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    return float(step_s * (lags[best] + between))


def _standard(rows: Rows) -> Rows:
    centred = rows - rows.mean(axis=0)
    return np.asarray(centred / np.maximum(centred.std(axis=0), 1e-12), np.float64)


def _correlation(a: Rows, b: Rows, lag: int) -> float:
    first, second = (a[: len(a) - lag], b[lag:]) if lag >= 0 else (a[-lag:], b[:lag])
    norm = math.sqrt(float((first * first).sum()) * float((second * second).sum()))
    return float((first * second).sum()) / norm if norm > 0.0 else 0.0
