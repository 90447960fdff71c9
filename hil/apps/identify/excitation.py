"""Tells which parameters flights excite, before anything is fitted: the information matrix of a linearised model.

Measured are specific force and angular acceleration in B on an even grid; y(p) is the vehicle file's model of both:

    f_B = sum_i (k O_i^2 n_i - k_d O_i (v - v_n n_i) - k_z O_i v_n n_i) / m - (d_1 v + d_2 |v| v) / m
    dw/dt = (tau - w x I w) / I,        O_i from commands by the lag of rotor_model.py

    J_p = (y(p + h s_p) - y(p)) / h / sigma        s_p the parameter's size, or a typical one where it is 0
    M = sum over samples of J' J,  with wind, accelerometer and torque biases of each flight as further unknowns
    relative sigma of p = sqrt((M^-1)_pp)          a parameter is excited below `EXCITED`

sigma is the noise seen between neighbouring samples times `_MODEL_ERROR`, because what a model misses is larger than
noise and lasts longer. The matrix is scaled to ones on its diagonal; a small eigenvalue belongs to a combination that
the flights leave open, and its vector names the parameters in it. Mass is in none of them: motion shows forces and
moments per mass only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.rates_of_change import at, attitude_at, derivative, grid_s, rotated, smoothed
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.flight_logs.rotor_model import lagged_speeds_radps, steady_speeds_radps, wrench
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.vehicle import Vehicle

Rows = NDArray[np.float64]

EXCITED = 0.1  # greatest relative sigma of a parameter that a fit can be expected to find
_STEP_S = 0.01
_CUTOFF_HZ = 20.0
_MODEL_ERROR = 5.0
_H = 1e-3
_WEAK = 1e-4  # eigenvalue of the scaled matrix below which its vector is named
_NUISANCE = 9  # of each flight: wind, bias of specific force, bias of angular acceleration
_WIND_SCALE_MPS, _FORCE_SCALE_MPS2, _TURN_SCALE_RADPS2 = 3.0, 0.3, 1.0  # typical sizes, as weak knowledge of them


@dataclass(frozen=True)
class Parameter:
    """A parameter, or a ratio of some, that flights may excite. `keys` are those of the vehicle file in it."""

    name: str
    keys: tuple[str, ...]
    missing: str  # what a flight lacks that does not show it
    manoeuvre: str  # that shows it; a name of excite.MANOEUVRES


PARAMETERS = (
    Parameter(
        "thrust per mass",
        ("rotor_constants.thrust_coefficient_n_per_radps2",),
        "flight with the motors' outputs and an accelerometer or positions",
        "climb",
    ),
    Parameter("roll inertia per thrust", ("inertia_kgm2.0",), "fast changes of roll", "roll"),
    Parameter("pitch inertia per thrust", ("inertia_kgm2.1",), "fast changes of pitch", "pitch"),
    Parameter(
        "yaw inertia per rotor torque", ("inertia_kgm2.2", "rotor_constants.moment_ratio_m"), "changes of yaw", "yaw"
    ),
    Parameter(
        "motor lag, rising", ("rotor_constants.time_constant_up_s",), "sudden rises of the motors' commands", "roll"
    ),
    Parameter(
        "motor lag, falling", ("rotor_constants.time_constant_down_s",), "sudden falls of the motors' commands", "roll"
    ),
    Parameter("rotor drag", ("rotor_constants.drag_kg_per_rad",), "horizontal speed in opposite directions", "legs"),
    Parameter("inflow", ("rotor_constants.axial_drag_kg_per_rad",), "climbs and descents at several speeds", "climb"),
    Parameter(
        "body drag, horizontal",
        ("body_drag_quadratic_n_per_m2ps2.0", "body_drag_quadratic_n_per_m2ps2.1"),
        "high horizontal speed, and low",
        "legs",
    ),
    Parameter(
        "body drag, vertical",
        ("body_drag_quadratic_n_per_m2ps2.2",),
        "fast climbs and descents, and slow ones",
        "climb",
    ),
)  # fmt: skip
THRUST, ROLL, PITCH, YAW, UP, DOWN, ROTOR_DRAG, INFLOW, BODY, VERTICAL = range(len(PARAMETERS))


@dataclass(frozen=True)
class Excited:
    """One parameter with the relative 1 sigma that these flights allow; infinite if nothing shows it."""

    parameter: Parameter
    relative_sigma: float

    @property
    def excited(self) -> bool:
        return self.relative_sigma < EXCITED


@dataclass(frozen=True)
class Excitation:
    """Excited parameters, the eigenvalues of the scaled information matrix, and its open combinations."""

    parameters: Sequence[Excited]
    eigenvalues: Sequence[float]  # smallest first; 1 for each if every parameter acts by itself
    combinations: Sequence[tuple[float, Mapping[str, float]]]  # weak eigenvalue; shares of the parameters' names

    @property
    def missing(self) -> list[Parameter]:
        return [item.parameter for item in self.parameters if not item.excited]


@dataclass(frozen=True)
class _Signals:
    """Signals of one flight that the model needs, on a grid: motors' times have their own."""

    log: FlightLog
    t_s: Rows
    steady: Rows  # speeds [n, rotors] at the motors' times
    velocity_B: Rows | None
    rate_B: Rows


def excitation_of(flights: Sequence[FlightLog], vehicle: Vehicle) -> Excitation:
    """Return what the flights excite together."""
    count = len(PARAMETERS)
    size = count + _NUISANCE * len(flights)
    information = np.zeros((size, size))
    for number, flight in enumerate(flights):
        own = _information(flight, vehicle)
        if own is None:
            continue
        places = [*range(count), *range(count + number * _NUISANCE, count + (number + 1) * _NUISANCE)]
        information[np.ix_(places, places)] += own
    information[range(count, size), range(count, size)] += 1.0  # a weak prior of the nuisances, in their scales
    sigmas = _relative_sigmas(information)[:count]
    marginal = _marginal(information, count)
    scale = np.sqrt(np.maximum(np.diag(marginal), 1e-300))
    eigenvalues, vectors = np.linalg.eigh(marginal / np.outer(scale, scale))
    combinations = []
    for value, vector in zip(eigenvalues, vectors.T, strict=True):
        shares = {
            PARAMETERS[i].name: float(vector[i] ** 2) for i in np.argsort(-np.abs(vector)) if vector[i] ** 2 > 0.1
        }
        if value < _WEAK and len(shares) > 1:
            combinations.append((float(value), shares))
    found = [Excited(parameter, float(sigma)) for parameter, sigma in zip(PARAMETERS, sigmas, strict=True)]
    return Excitation(found, [float(x) for x in eigenvalues], combinations)


def _relative_sigmas(information: Rows) -> Rows:
    """Return sqrt of the diagonal of the inverse; infinite where the matrix has nothing."""
    diagonal = np.diag(information)
    there = diagonal > 0.0
    scale = np.sqrt(diagonal[there])
    inner = information[np.ix_(there, there)] / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(inner)
    inverse = (vectors * vectors / np.maximum(values, 1e-12)).sum(axis=1)
    sigmas = np.full(len(diagonal), math.inf)
    sigmas[there] = np.sqrt(inverse) / scale
    return sigmas


def _marginal(information: Rows, count: int) -> Rows:
    """Return the information of the first `count` unknowns with the others unknown (Schur complement)."""
    a, b, c = information[:count, :count], information[:count, count:], information[count:, count:]
    return np.asarray(a - b @ np.linalg.solve(c, b.T), np.float64) if len(c) else a


def _information(log: FlightLog, vehicle: Vehicle) -> Rows | None:
    """Return J' J of one flight for the parameters and its nuisances."""
    t_s = grid_s(log.start_s, log.end_s, _STEP_S)
    force = _measured_force(log, t_s)
    if len(t_s) < 50 or (log.rate is None and force is None):
        return None
    rate = smoothed(at(log.rate, t_s), _STEP_S, _CUTOFF_HZ) if log.rate is not None else np.zeros((len(t_s), 3))
    signals = _Signals(log, t_s, steady_speeds_radps(log, vehicle), _velocity_B(log, t_s), rate)
    sizes = _sizes(vehicle)
    base = _model(signals, vehicle, sizes, np.zeros(len(sizes)), np.zeros(3))
    columns = [
        (_model(signals, vehicle, sizes, _H * np.eye(len(sizes))[i], np.zeros(3)) - base) / _H
        for i in range(len(sizes))
    ]
    for k in range(3):
        wind = np.eye(3)[k]
        columns.append(_WIND_SCALE_MPS * (_model(signals, vehicle, sizes, np.zeros(len(sizes)), wind) - base))
    for k in range(6):
        bias = np.zeros_like(base)
        bias[:, k] = _FORCE_SCALE_MPS2 if k < 3 else _TURN_SCALE_RADPS2
        columns.append(bias)
    weights = _weights(log, force, rate)
    jacobian = np.stack([(column * weights).ravel() for column in columns], axis=1)
    return jacobian.T @ jacobian


def _measured_force(log: FlightLog, t_s: Rows) -> Rows | None:
    """Return the specific force [n, 3]: the accelerometer's, else the velocity's derivative with gravity."""
    if log.accel is not None:
        return at(log.accel, t_s)
    if log.pose is None or log.velocity is None:
        return None
    a_W = derivative(smoothed(at(log.velocity, t_s), _STEP_S, _CUTOFF_HZ), _STEP_S)
    return rotated(attitude_at(log.pose, t_s), a_W + np.array([0.0, 0.0, STANDARD_GRAVITY_MPS2]), back=True)


def _velocity_B(log: FlightLog, t_s: Rows) -> Rows | None:
    if log.velocity is None or log.pose is None:
        return None
    return rotated(attitude_at(log.pose, t_s), at(log.velocity, t_s), back=True)


def _weights(log: FlightLog, force: Rows | None, rate: Rows) -> Rows:
    """Return 1/sigma of each of the six measured quantities; 0 for those that the log does not have."""
    weights = np.zeros(6)
    if force is not None:
        weights[:3] = 1.0 / (_MODEL_ERROR * np.maximum(_noise(smoothed(force, _STEP_S, _CUTOFF_HZ)), 0.05))
    if log.rate is not None:
        weights[3:] = 1.0 / (_MODEL_ERROR * np.maximum(_noise(derivative(rate, _STEP_S)), 0.05))
    # Samples closer than the filter's memory say the same thing twice.
    return weights * math.sqrt(_STEP_S * 2.0 * _CUTOFF_HZ)


def _noise(rows: Rows) -> Rows:
    """Return the deviation of each column's second differences, as that of white noise with the same ones."""
    return np.asarray(np.std(np.diff(rows, 2, axis=0), axis=0) / math.sqrt(6.0), np.float64)


def _sizes(vehicle: Vehicle) -> Rows:
    """Return the size s_p of each parameter; where it is 0, a tenth of hover thrust at 10 m/s."""
    c = vehicle.rotor_constants
    count = max(1, len(vehicle.rotors))
    weight_n = vehicle.mass_kg * STANDARD_GRAVITY_MPS2
    hover_radps = math.sqrt(weight_n / (count * c.thrust_coefficient_n_per_radps2))
    per_rotor, per_square = 0.1 * weight_n / (10.0 * count * hover_radps), 0.1 * weight_n / 100.0
    quadratic = vehicle.body_drag_quadratic_n_per_m2ps2
    sizes = np.ones(len(PARAMETERS))
    sizes[UP], sizes[DOWN] = c.time_constant_up_s, c.time_constant_down_s
    sizes[ROTOR_DRAG] = c.drag_kg_per_rad or per_rotor
    sizes[INFLOW] = c.axial_drag_kg_per_rad or per_rotor
    sizes[BODY] = max(quadratic[:2]) or per_square
    sizes[VERTICAL] = quadratic[2] or per_square
    return sizes


def _model(signals: _Signals, vehicle: Vehicle, sizes: Rows, change: Rows, wind_W: Rows) -> Rows:
    """Return [n, 6] specific force and angular acceleration, with each parameter changed by `change` times its size."""
    c, log = vehicle.rotor_constants, signals.log
    lagged = lagged_speeds_radps(
        log,
        signals.steady,
        up_s=c.time_constant_up_s + change[UP] * sizes[UP],
        down_s=c.time_constant_down_s + change[DOWN] * sizes[DOWN],
    )
    speeds = np.stack([np.interp(signals.t_s, log.motors.t_s, column) for column in lagged.T], axis=1)
    forces = wrench(speeds, vehicle)
    inertia = np.array(vehicle.inertia_kgm2)
    force = forces[:, :3] / vehicle.mass_kg * (1.0 + change[THRUST])
    # k appears in forces and torques: a change of an inertia is one of its ratio to the thrust.
    turn = forces[:, 3:] / (inertia * (1.0 + change[[ROLL, PITCH, YAW]]))
    turn = turn - np.cross(signals.rate_B, signals.rate_B * inertia) / inertia
    if signals.velocity_B is not None:
        v = signals.velocity_B
        if wind_W.any() and log.pose is not None:
            q = attitude_at(log.pose, signals.t_s)
            v = v - rotated(q, np.broadcast_to(wind_W, v.shape), back=True)
        force = force + _drag(v, speeds, vehicle, sizes, change) / vehicle.mass_kg
    return np.hstack([force, turn])


def _drag(v: Rows, speeds: Rows, vehicle: Vehicle, sizes: Rows, change: Rows) -> Rows:
    """Return the forces of air on rotors (upright ones) and body [N]."""
    c = vehicle.rotor_constants
    total = speeds.sum(axis=1)[:, None]
    across = c.drag_kg_per_rad + change[ROTOR_DRAG] * sizes[ROTOR_DRAG]
    along = c.axial_drag_kg_per_rad + change[INFLOW] * sizes[INFLOW]
    linear = np.array(vehicle.body_drag_linear_n_per_mps)
    quadratic = np.array(vehicle.body_drag_quadratic_n_per_m2ps2)
    quadratic = quadratic + sizes[[BODY, BODY, VERTICAL]] * change[[BODY, BODY, VERTICAL]]
    speed = np.linalg.norm(v, axis=1)[:, None]
    return -total * v * np.array([across, across, along]) - linear * v - quadratic * speed * v
