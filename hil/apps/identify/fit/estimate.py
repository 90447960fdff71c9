"""The fit of a vehicle to flights: `estimate`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.fit import flight_model as fm
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.flight_model import FlightModel, make_model
from hil.apps.identify.fit.shooting import START_SIGMA, Group, Solution, first_states, solve
from hil.apps.identify.fit.windows import Motors, Windows
from hil.apps.identify.flight_log import FlightLog
from sim.physics.vehicle import Vehicle

Array = NDArray[np.float64]
WINDOW_S = 0.5
# Share of the progress, length and greatest number of windows, greatest number of iterations. Over a short window a wrong
# model has not gone far, so the least squares are nearly linear. The last one's 600 windows are 5 min: of longer flights
# they are spread over all.
_STAGES = (
    ((0.0, 0.1), 0.08, 200, 6), ((0.1, 0.2), 0.2, 80, 6), ((0.2, 0.5), WINDOW_S, 80, 8), ((0.5, 1.0), WINDOW_S, 600, 6),
)  # fmt: skip
_STEP_S = {"speed_radps": 0.01, "command": 0.008}


def windows_of(
    log: FlightLog, number: int, step_s: float, *, parts: Callable[[float], bool], nominal_v: float,
    motors: Motors | None = None, window_s: float = WINDOW_S,
) -> Windows:  # fmt: skip
    """Return the windows of a log whose middle, as a share of the log, `parts` accepts."""
    steps = round(window_s / step_s)
    starts = np.arange(log.start_s, log.end_s - (steps + 1) * step_s, steps * step_s)
    share = (starts + 0.5 * window_s - log.start_s) / max(log.duration_s, 1e-9)
    kept = starts[[parts(float(x)) for x in share]]
    return Windows(log, number, kept, steps, step_s, motors or Motors.of(log), nominal_v)


def steady_speed(vehicle: Vehicle, unknowns: Sequence[at.Unknown]) -> Callable[[Group, Array], Array]:
    """Return the function that gives the rotor speeds to which the commands of the 0.1 s before each window lead."""

    def speeds(group: Group, s: Array) -> Array:
        w = group.windows
        f, e, tau = (unknowns[i].value(s[i]) for i in (at.SHAPE, at.VOLTAGE, at.TAU_UP))
        delay = s[at.VEHICLE_COUNT + at.MOTOR_DELAY]
        c_max = vehicle.rotor_constants.max_speed_radps
        total = np.zeros((len(vehicle.rotors), w.count))
        weight = 0.0
        for back in np.arange(1, 13):  # the lag's memory
            t = w.starts_s - back * w.step_s + delay
            u = np.clip(w.motors.inputs(t, w.step_s)[: len(vehicle.rotors)], 1e-6, 1.0)
            share = float(np.exp(-(back - 0.5) * w.step_s / tau))
            total += share * c_max * np.sqrt(np.maximum(f * u * u + (1 - f) * u, 1e-9))
            weight += share
        volts = 1.0
        if w.log.voltage is not None:
            volts = np.interp(w.starts_s, w.log.voltage.t_s, w.log.voltage.values[:, 0]) / w.nominal_v
        return total / weight * volts**e

    return speeds


def free_unknowns(
    flights: Sequence[FlightLog], unknowns: Sequence[at.Unknown], fixed: Mapping[str, float]
) -> NDArray[np.bool_]:
    """Return which unknowns these logs can touch at all."""
    free = np.ones(len(unknowns), bool)
    kind = flights[0].motors_kind
    if kind == "speed_radps":
        free[[at.TAU_UP, at.TAU_DOWN, at.SHAPE, at.VOLTAGE]] = False
    if all(log.voltage is None for log in flights):
        free[at.VOLTAGE] = False
    for number, log in enumerate(flights):
        first = at.VEHICLE_COUNT + number * at.LOG_COUNT
        if log.rate is None:
            free[first + at.GYRO_BIAS : first + at.GYRO_BIAS + 3] = False
        if log.accel is None:
            free[first + at.ACCEL_BIAS : first + at.ACCEL_BIAS + 3] = False
    for i, unknown in enumerate(unknowns):
        if unknown.key in fixed:
            free[i] = False
    return free


def fit_windows(
    flights: Sequence[FlightLog], vehicle: Vehicle, *, fixed: Mapping[str, float], parts: Callable[[float], bool],
    progress: Callable[[float, str], None], calm: bool = False,
) -> tuple[FlightModel, list[at.Unknown], Solution]:  # fmt: skip
    """Fit the windows that `parts` accepts; first a few of them, from which the others converge in a few iterations."""
    kind = flights[0].motors_kind
    step_s = _STEP_S[kind]
    unknowns = at.vehicle_unknowns(vehicle)
    nominal_v = vehicle.battery.nominal_voltage_v if vehicle.battery else 1.0
    for log in flights:
        unknowns += at.log_unknowns(log.name, calm=calm)
    model = make_model(vehicle, unknowns, kind=kind, step_s=step_s)
    free = free_unknowns(flights, unknowns, fixed)
    start = np.array([u.inverse(fixed[u.key]) if u.key in fixed else 0.0 for u in unknowns])
    priors = np.array([u.prior for u in unknowns])
    steady = steady_speed(vehicle, unknowns) if kind == "command" else None
    motors = [Motors.of(log) for log in flights]
    sigma, solution, unexplained, last_s = None, None, None, 0.0
    for share, window_s, windows, iterations in _STAGES:
        whole = [
            windows_of(log, i, step_s, parts=parts, nominal_v=nominal_v, motors=motors[i], window_s=window_s)
            for i, log in enumerate(flights)
        ]
        skip = max(1.0, sum(w.count for w in whole) / windows)
        groups = []
        for number, w in enumerate(whole):
            chosen = np.unique(np.floor(np.arange(0.0, w.count, skip)).astype(int))
            group = first_states(model, replace(w, starts_s=w.starts_s[chosen]))
            if sigma is not None:
                group.sigma = np.maximum(sigma[number], START_SIGMA) if window_s > last_s else sigma[number].copy()
            groups.append(group)
        solution = solve(
            model, groups, priors, start=start, free=free, steady=steady, progress=progress, share=share,
            most=iterations, unexplained=unexplained,
        )  # fmt: skip
        start, sigma, unexplained, last_s = solution.s, [g.sigma for g in groups], solution.unexplained, window_s
        if skip == 1.0 and window_s == WINDOW_S:
            break
    assert solution is not None
    return model, unknowns, solution
