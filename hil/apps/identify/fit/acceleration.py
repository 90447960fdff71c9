"""Specific force of logged flights: the model's against the accelerometer's, and against a constant gain's.

    model           F(v, q, w, O(c)) / m + the accelerometer's bias, O by the motors' lag from the logged commands
    constant gain   g (sum u) along z, or g (sum u^2), the gain by least squares, whichever is better

Both are compared with the accelerometer after the same low-pass, `_SMOOTH_S` long: what it reads of the blades' passing
is no motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.fit import flight_model as fm
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.flight_model import FlightModel
from hil.apps.identify.fit.windows import Motors
from hil.run.flight_logs.flight_log import FlightLog, Series

Array = NDArray[np.float64]
_SMOOTH_S = 0.1


@dataclass(frozen=True)
class Forces:
    """Specific force in B along a flight [n, 3]: measured and modelled; sum of commands and of squares, and voltage."""

    measured: Array
    modelled: Array
    gains: Array  # [n, 2]
    voltage: Array


def forces_of(model: FlightModel, s: Array, log: FlightLog, nominal_v: float) -> Forces:
    """Return the forces of a flight; `s` holds the vehicle's unknowns, then those of a log, of which the bias is used.

    Raises ValueError for a log without accelerometer, velocity or attitude.
    """
    if log.accel is None or log.velocity is None or log.pose is None:
        raise ValueError(f"{log.name}: the comparison needs accelerometer, velocity and attitude")
    h = model.step_s
    t = np.arange(log.start_s, log.end_s, h)
    motors = Motors.of(log)
    delay_s = float(s[at.VEHICLE_COUNT + at.MOTOR_DELAY])
    u = motors.inputs(t + delay_s, h)
    volts = np.ones(len(t))
    if log.voltage is not None:
        volts = np.interp(t, log.voltage.t_s, log.voltage.values[:, 0]) / nominal_v
    u = np.vstack([u, volts, np.full(len(t), log.ground_or_far_below_m)])
    shifted = s.copy()
    shifted[at.VEHICLE_COUNT + at.MOTOR_DELAY] = 0.0
    S = np.repeat(shifted[:, None], len(t), axis=1)
    z = np.zeros((model.states, len(t)))
    z[fm.P], z[fm.V] = _at(log.pose, t)[:3], _at(log.velocity, t)
    z[fm.Q] = _at(log.pose, t)[3:7]
    z[fm.Q] /= np.linalg.norm(z[fm.Q], axis=0)
    if log.rate is not None:
        z[fm.W] = _at(log.rate, t)
    if model.kind == "command":
        z[fm.O : fm.O + model.rotors] = _lagged(model, shifted, u, z)
    force = model.forces.map(len(t))(z, S, u)[0].full().T
    force = force + s[at.VEHICLE_COUNT + at.ACCEL_BIAS : at.VEHICLE_COUNT + at.ACCEL_BIAS + 3]
    n = model.rotors
    held = u[:n]
    gains = np.column_stack([held.sum(axis=0), (held * held).sum(axis=0)])
    width = max(1, round(_SMOOTH_S / h))
    return Forces(_smooth(_at(log.accel, t).T, width), _smooth(force, width), _smooth(gains, width), volts * nominal_v)


def _lagged(model: FlightModel, s: Array, u: Array, z: Array) -> Array:
    """Return the rotor speeds [rotors, n] to which the commands lead, from rest at the first one's."""
    rates = model.rates[1].function
    n, own = model.rotors, slice(fm.O, fm.O + model.rotors)
    out = np.zeros((n, u.shape[1]))
    state = z[:, 0].copy()
    state[own] = 0.5 * 1000.0
    for k in range(-200, u.shape[1]):
        i = max(k, 0)
        for _ in range(2):  # half steps: the lag is short
            state[own] += 0.5 * model.step_s * np.array(rates(state, s, u[:, i])[0])[own, 0]
        out[:, i] = state[own]
    return out


def _at(series: Series, t_s: Array) -> Array:
    return np.array([np.interp(t_s, series.t_s, column) for column in series.values.T])


def _smooth(x: Array, width: int) -> Array:
    kernel = np.ones(width) / width
    return np.column_stack([np.convolve(column, kernel, "same") for column in x.T])


def constant_gain(flights: Sequence[Forces]) -> tuple[float, float]:
    """Return the least-squares gains of sum u and of sum u^2."""
    x = np.concatenate([f.gains for f in flights])
    y = np.concatenate([f.measured[:, 2] for f in flights])
    return float(x[:, 0] @ y / (x[:, 0] @ x[:, 0])), float(x[:, 1] @ y / (x[:, 1] @ x[:, 1]))


def errors(f: Forces, gains: tuple[float, float]) -> tuple[Array, Array]:
    """Return the norms of the model's errors and of the better constant gain's [m/s2], along a flight."""
    off = np.linalg.norm(f.modelled - f.measured, axis=1)
    plain = []
    for i in range(2):
        e = f.measured.copy()
        e[:, 2] -= gains[i] * f.gains[:, i]
        plain.append(np.linalg.norm(e, axis=1))
    return off, min(plain, key=lambda e: float((e * e).mean()))
