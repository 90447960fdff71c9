"""The fit of a vehicle to flights: `estimate`."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hil.apps.identify.fit import flight_model as fm
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.fitted_vehicle import fitted_vehicle
from hil.apps.identify.fit.flight_model import FlightModel, make_model
from hil.apps.identify.fit.prediction import HORIZONS_S, Predictor, predictions
from hil.apps.identify.fit.settled import settled
from hil.apps.identify.fit.shooting import START_SIGMA, Group, Guess, Solution, first_states, solve
from hil.apps.identify.fit.windows import Motors, Windows
from hil.apps.identify.fit_result import Estimated, Fit, Residual
from hil.run.flight_logs.flight_log import FlightLog
from signals.errors import ConfigError, Problem
from sim.physics.vehicle import Vehicle

Array = NDArray[np.float64]
# Speeds from telemetry carry slow errors that a long window would sum up; what a short one shows is fast, and clean.
WINDOW_S = {"speed_radps": 0.16, "command": 0.5}
# Share of the progress, length of the windows over that, flight covered [s], greatest number of iterations. Over
# a short window a wrong model has not gone far, so the least squares are nearly linear. Five minutes are the most that
# is fitted: of longer flights they are spread over all.
_STAGES = (
    ((0.0, 0.1), 0.16, 16.0, 6),
    ((0.1, 0.2), 0.4, 16.0, 6),
    ((0.2, 0.5), 1.0, 40.0, 15),
    ((0.5, 1.0), 1.0, 300.0, 6),
)
_BLOCKS = 15  # of a flight; every third one is held out
_PREDICTION_STEP_S = 0.01
_RESOLUTION = 0.05  # of lags and delays, in steps
_SPEEDS_MPS = ((0.0, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 16.0))
_STEP_S = {"speed_radps": 0.01, "command": 0.008}
# A motor that is told something else each few milliseconds speeds up and slows down within a step of 8 ms, with two
# lags; a step sees the mean of its commands. So a step is about 4 ms long, and has whole commands (`windows_of`).
_FINE_STEP_S, _FINE_BELOW_S = 0.004, 0.006


def windows_of(
    log: FlightLog, number: int, step_s: float, *, parts: Callable[[float], bool], nominal_v: float,
    motors: Motors | None = None, window_s: float,
) -> Windows:  # fmt: skip
    """Return the windows of a log whose start and end, as shares of the log, `parts` accepts.

    Commands that come once a step change between two steps, not within one: a change within a step would be seen as a
    slope, and a lag upwards and one downwards would mix.
    """
    steps = round(window_s / step_s)
    first_s = log.start_s + (float(log.motors.t_s[0]) - log.start_s) % step_s
    starts = np.arange(first_s, log.end_s - (steps + 1) * step_s, steps * step_s)
    first = (starts - log.start_s) / max(log.duration_s, 1e-9)
    last = first + window_s / max(log.duration_s, 1e-9)
    kept = starts[[parts(float(x)) and parts(float(y)) for x, y in zip(first, last, strict=True)]]
    return Windows(log, number, kept, steps, step_s, motors or Motors.of(log), nominal_v)


def steady_speed(vehicle: Vehicle, unknowns: Sequence[at.Unknown]) -> Callable[[Group, Array], Array]:
    """Return the function that gives the rotor speeds to which the commands of the 0.1 s before each window lead."""

    def speeds(group: Group, s: Array) -> Array:
        w = group.windows
        f, e, tau = (unknowns[i].value(s[i]) for i in (at.SHAPE, at.VOLTAGE, at.TAU_UP))
        c_max = vehicle.rotor_constants.max_speed_radps
        total = np.zeros((len(vehicle.rotors), w.count))
        weight = 0.0
        for back in np.arange(1, 13):  # the lag's memory
            t = w.starts_s - back * w.step_s
            u = np.clip(w.motors.inputs(t, w.step_s)[: len(vehicle.rotors)], 1e-6, 1.0)
            share = float(np.exp(-(back - 0.5) * w.step_s / tau))
            total += share * c_max * np.sqrt(np.maximum(f * u * u + (1 - f) * u, 1e-9))
            weight += share
        volts: Array = np.ones(w.count)
        if w.log.voltage is not None:
            volts = np.interp(w.starts_s, w.log.voltage.t_s, w.log.voltage.values[:, 0]) / w.nominal_v
        return total / weight * (1.0 + e * (volts - 1.0))

    return speeds


def step_of(flights: Sequence[FlightLog]) -> float:
    """Return the step of the integration: for commands that come fast their period, or a few of them."""
    kind = flights[0].motors_kind
    periods = [float(np.median(np.diff(log.motors.t_s))) for log in flights if len(log.motors) > 1]
    if kind == "command" and periods and min(periods) <= _FINE_BELOW_S:
        period_s = min(periods)
        return round(period_s * max(1, round(_FINE_STEP_S / period_s)), 6)
    return _STEP_S[kind]


def free_unknowns(
    flights: Sequence[FlightLog], vehicle: Vehicle, unknowns: Sequence[at.Unknown], fixed: Mapping[str, float]
) -> NDArray[np.bool_]:
    """Return which unknowns these logs can touch at all."""
    free = np.ones(len(unknowns), bool)
    kind = flights[0].motors_kind
    free[list(_not_of_the_model(vehicle))] = False
    free[at.CENTRE + 2] = False  # moves drag's lever, as the moment of the air does
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


def _not_of_the_model(vehicle: Vehicle) -> set[int]:
    """Return the unknowns that this vehicle's rotor model does not have, or has switched off."""
    c, blades = vehicle.rotor_constants, vehicle.rotor_constants.blade_element
    if vehicle.rotor_model == "blade_element" and blades is not None:
        without = {at.AXIAL_DRAG}
        near_ground = blades.ground_inflow_loss > 0.0
    else:
        without = {at.INFLOW, at.HUB_SHARE}
        near_ground = c.ground_thrust_ratio > 1.0
    return without if near_ground else without | {at.GROUND, at.GROUND_RADIUS}


def fit_windows(
    flights: Sequence[FlightLog], vehicle: Vehicle, *, fixed: Mapping[str, float], parts: Callable[[float], bool],
    progress: Callable[[float, str], None],
) -> tuple[FlightModel, list[at.Unknown], Solution]:  # fmt: skip
    """Fit the windows that `parts` accepts; first a few of them, from which the others converge in a few iterations."""
    kind = flights[0].motors_kind
    step_s = step_of(flights)
    unknowns = at.vehicle_unknowns(vehicle)
    nominal_v = vehicle.battery.nominal_voltage_v if vehicle.battery else 1.0
    for log in flights:
        unknowns += at.log_unknowns(log.name)
    model = make_model(vehicle, unknowns, kind=kind, step_s=step_s)
    free = free_unknowns(flights, vehicle, unknowns, fixed)
    start = np.array([u.inverse(fixed[u.key]) if u.key in fixed else 0.0 for u in unknowns])
    priors = np.array([u.prior for u in unknowns])
    steady = steady_speed(vehicle, unknowns) if kind == "command" else None
    motors = [Motors.of(log) for log in flights]
    sigma, solution, unexplained, last_s = None, None, None, 0.0
    longest_s = WINDOW_S[kind]
    workers = ThreadPoolExecutor(_threads(), "fit")
    for share, part, covered_s, iterations in _STAGES:
        window_s = max(part * longest_s, 5 * step_s)
        windows = covered_s / window_s
        whole = [
            windows_of(
                log,
                i,
                step_s,
                parts=parts,
                nominal_v=nominal_v,
                motors=motors[i],
                window_s=window_s,
            )
            for i, log in enumerate(flights)
        ]
        skip = max(1.0, sum(w.count for w in whole) / windows)
        groups = []
        for number, w in enumerate(whole):
            chosen = np.unique(np.floor(np.arange(0.0, w.count, skip)).astype(int))
            delay_s = float(start[at.VEHICLE_COUNT + number * at.LOG_COUNT + at.MOTOR_DELAY])
            group = first_states(model, replace(w, starts_s=w.starts_s[chosen]), delay_s)
            if sigma is not None:
                group.sigma = np.maximum(sigma[number], START_SIGMA) if window_s > last_s else sigma[number].copy()
            groups.append(group)
        solution = solve(
            model,
            groups,
            Guess(start, priors, free, unexplained),
            steady=steady,
            progress=_part_of(progress, share),
            most=iterations,
            workers=workers,
        )
        start, sigma, unexplained, last_s = solution.s, [g.sigma for g in groups], solution.unexplained, window_s
        if skip == 1.0 and part == 1.0:
            break
    workers.shutdown()
    assert solution is not None
    if kind == "command":
        _add_resolution(unknowns, solution, step_s)
    return model, unknowns, solution


def _threads() -> int:
    """Return the number of processors that this process may use; more than four find too little to share."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, 4)


def _part_of(progress: Callable[[float, str], None], share: tuple[float, float]) -> Callable[[float, str], None]:
    """Return a progress that runs through this part of another one."""
    first, last = share
    return lambda done, what: progress(first + (last - first) * done, what)


def _add_resolution(unknowns: Sequence[at.Unknown], solution: Solution, step_s: float) -> None:
    """Add to the variances of lags and delays what the step leaves open.

    Within a step commands are a straight line. What they do faster than that moves a lag against the delay.
    """
    diagonal = np.einsum("ii->i", solution.covariance)
    resolution_s = _RESOLUTION * step_s
    for i, unknown in enumerate(unknowns):
        if (i in (at.TAU_UP, at.TAU_DOWN) or unknown.key.endswith(("motor_delay_s", "pose_delay_s"))) and diagonal[
            i
        ] > 0.0:
            diagonal[i] += (resolution_s / unknown.slope(float(solution.s[i]))) ** 2


def estimate(
    flights: Sequence[FlightLog],
    vehicle: Vehicle,
    *,
    fixed: Mapping[str, float],
    progress: Callable[[float, str], None],
) -> Fit:
    """Fit a vehicle to flights; every third block of `BLOCK_S` of each flight is held out and predicted.

    Raises ConfigError for flights that have no poses, or motors of two kinds.
    """
    _check(flights)
    model, unknowns, solution = fit_windows(
        flights, vehicle, fixed=fixed, parts=_is_fitted, progress=lambda share, what: progress(0.85 * share, what)
    )
    s, sigma, kept = settled(unknowns, solution, free_unknowns(flights, vehicle, unknowns, fixed))
    fitted = fitted_vehicle(vehicle, unknowns, s)
    parameters = _report(vehicle, unknowns, s, sigma, kept, fixed)
    progress(0.9, "predicting what was held out")
    kind, step_s = flights[0].motors_kind, _PREDICTION_STEP_S
    before, after = (
        predictions(Predictor(each, kind, step_s=step_s), flights, part=held_out, every=2) for each in (vehicle, fitted)
    )
    residuals = residuals_of(model, solution)
    progress(1.0, "done")
    return Fit(parameters, fitted, before, after, residuals)


def _check(flights: Sequence[FlightLog]) -> None:
    problems = [
        Problem(f"{log.source}: {log.name}", "has neither poses nor an estimate of them", "log position and attitude")
        for log in flights
        if log.pose is None
    ]
    kinds = sorted({log.motors_kind for log in flights})
    if len(kinds) > 1:
        problems.append(Problem(str(flights[0].source), f"motors are {' in one log and '.join(kinds)} in another",
                                "fit logs of one kind at a time"))  # fmt: skip
    if problems:
        raise ConfigError(problems)


def _is_fitted(share: float) -> bool:
    return int(share * _BLOCKS) % 3 != 2


def held_out(log: FlightLog, t_s: Array) -> NDArray[np.bool_]:
    """Return which instants begin a prediction that lies in a block which is not fitted: every third of fifteen."""
    first = ((t_s - log.start_s) / max(log.duration_s, 1e-9) * _BLOCKS).astype(int)
    last = ((t_s + max(HORIZONS_S) - log.start_s) / max(log.duration_s, 1e-9) * _BLOCKS).astype(int)
    return (first % 3 == 2) & (first == last)


def _report(
    vehicle: Vehicle, unknowns: Sequence[at.Unknown], s: Array, sigma: Array, kept: NDArray[np.bool_],
    fixed: Mapping[str, float],
) -> list[Estimated]:  # fmt: skip
    given = "mass_kg" in fixed
    why = "motion shows every force and moment per mass: weigh the vehicle, --fix mass_kg=..."
    found = [Estimated("mass_kg", vehicle.mass_kg, 0.0 if given else math.inf, "kg", given, "" if given else why)]
    without = _not_of_the_model(vehicle)
    for i, (u, x, deviation, is_kept) in enumerate(zip(unknowns, s, sigma, kept, strict=True)):
        width = float(abs(u.slope(float(x))) * deviation)
        if u.key in fixed or i in without:
            continue
        if is_kept:
            reason = f"the flights do not show it; {u.sense} to see it" if u.sense else "the flights do not show it"
            width = max(width, u.prior * (u.start if u.law == "exp" else 1.0)) if deviation == 0.0 else width
            found.append(Estimated(u.key, u.value(float(x)), width, u.unit, False, reason))
        else:
            found.append(Estimated(u.key, u.value(float(x)), width, u.unit, True))
    return found


def residuals_of(model: FlightModel, solution: Solution) -> list[Residual]:
    """Return what each window's motion left unexplained, by axis and by speed: a_W turned into B, and b_B."""
    a, b, speed = [], [], []
    for g in solution.groups:
        z = g.z0
        turn = Rotation.from_quat(z[[4, 5, 6, 3]].T)
        a.append(turn.inv().apply(z[model.disturbance : model.disturbance + 3].T))
        b.append(z[model.disturbance + 3 :].T)
        speed.append(np.linalg.norm(z[fm.V], axis=0))
    v = np.concatenate(speed)
    out = []
    for quantity, values in (("force", np.concatenate(a)), ("turn", np.concatenate(b))):
        for i, axis in enumerate("xyz"):
            for bounds in (None, *_SPEEDS_MPS):
                chosen = np.ones(len(v), bool) if bounds is None else (v >= bounds[0]) & (v < bounds[1])
                if chosen.any():
                    x = values[chosen, i]
                    middle = None if bounds is None else 0.5 * (bounds[0] + bounds[1])
                    out.append(
                        Residual(quantity, axis, middle, float(x.mean()), float(np.sqrt((x * x).mean())), len(x))
                    )
    return out
