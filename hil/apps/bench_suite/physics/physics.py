"""`hil bench physics`: error and run time of the flight physics, compared with MuJoCo's own integrators.

Cases (hil.apps.bench_suite.physics.flight_cases), with the same vehicle and forces for all methods:

    hover      5 s near hover                       greatest position error [m]
    vigorous   5 s to 10 rad/s and 24 m/s           greatest position error [m]
    gust       3 s in a wind front of 12 m/s        greatest position error [m]
    switching  5 s with rotors that stop and start  greatest position error [m]; this project only, with all effects
    hexa_x, octa_x, x8, y6, tilted hexa_x           as vigorous, of these vehicles; this project only, with all effects
    quadratic ...                                   the same with `rotor_model: quadratic`; all others fly with
                                                    blade-element momentum theory
    motors, motors switching, wind tunnel           the x500 with motors, vigorous and as switching; with the
                                                    coefficients of a wind tunnel
    tumble     20 rad/s without torque, 60 s        greatest relative drift of energy or angular momentum
    landing    a fall of 0.25 m onto the feet       deepest penetration [m]
    several vehicles                                see hil.apps.bench_suite.physics.vehicle_groups
    planes                                          see hil.apps.bench_suite.physics.plane_cases

Errors of all but the last two are relative to the CasADi model of multirotor_reference.py, solved by CVODES at 1e-14.
Times are the best of several runs in one process, with the methods run in turn, and include Python. Time and error come
from the same code.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial

import numpy as np

from hil.apps.bench_suite.physics import multirotor_reference as reference
from hil.apps.bench_suite.physics.flight_cases import (
    Flight,
    Float64,
    PlainMujoco,
    ThisProject,
    attitude_error_rad,
    gust,
    hover,
    landing,
    of_shipped_vehicle,
    of_x500,
    spin_drift,
    switching,
    tumble,
    vigorous,
)
from hil.apps.bench_suite.physics.landing_checks import landing_checks
from hil.apps.bench_suite.physics.plane_cases import plane_rows
from hil.apps.bench_suite.physics.vehicle_groups import group_rows
from hil.apps.bench_suite.physics.vtol_cases import vtol_rows
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.timing import best_times
from sim.physics.vehicle import load_vehicle

TITLE = "Flight physics: error against wall time"
Method = ThisProject | PlainMujoco
_STEPS_MS = (4.0, 2.0, 1.0, 0.5)
_EULER_1MS = "MuJoCo Euler @ 1 ms"
_DIVERGED = 1e6  # stands for an unbounded drift, because JSON and plots have no infinity
_OWN = "this project, order 8 @ 4 ms"
_MANY_ROTORS = ("hexa_x", "octa_x", "x8", "y6")


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Fly every case with every method."""
    result = BenchmarkResult(time_label="wall seconds per simulated second")
    methods = _methods()
    own: list[Method] = [method for method in methods if isinstance(method, ThisProject)]
    flights = {"hover": hover(), "vigorous": vigorous(), "gust": gust()}
    with_all_effects = {"switching": switching()} | {name: of_shipped_vehicle(name) for name in _MANY_ROTORS}
    with_all_effects["tilted hexa_x"] = of_shipped_vehicle("hexa_x", tilt_deg=20.0)
    with_all_effects["quadratic switching"] = switching(model="quadratic")
    with_all_effects["quadratic hexa_x"] = of_shipped_vehicle("hexa_x", model="quadratic")
    with_all_effects["motors"] = of_x500(motor=True)
    with_all_effects["motors switching"] = of_x500(motor=True, starts_and_stops=True)
    with_all_effects["wind tunnel"] = of_x500(motor=False, model="wind_tunnel")
    for name, flight in (flights | with_all_effects).items():
        compared = own if name in with_all_effects else methods
        status(f"{name}: reference")
        exact = reference.fly(
            flight.vehicle,
            flight.start,
            reference.Inputs(
                flight.commands,
                wind_W=np.tile(flight.wind_W_mps, (len(flight.commands) + 1, 1)),
                effects=flight.effects.model_dump(),
                site=flight.site,
            ),
            tick_s=flight.tick_ns / 1e9,
            gravity_mps2=flight.scene.gravity_mps2,
        )
        status(name)
        times = _best_times(flight, compared, rounds=2 if quick else 7)
        for method in compared:
            flown = method.fly(flight, record=True)
            details = {"attitude_error_rad": attitude_error_rad(flown, exact)}
            error = _position_error_m(flown, exact)
            result.rows.append(Row(name, method.name, error, "m", times[method.name], details))
    _tumble_rows(result, methods, status)
    _landing_rows(result, methods, rounds=2 if quick else 5)
    status("checks")
    result.checks += _flight_checks(result)
    result.checks += _order_checks()
    result.checks += _hour_checks(status)
    result.checks += landing_checks(status)
    rows, checks = group_rows(status)
    result.rows += rows
    result.checks += checks
    rows, checks = plane_rows(status, quick=quick)
    more_rows, more_checks = vtol_rows(status, quick=quick)
    rows, checks = [*rows, *more_rows], [*checks, *more_checks]
    result.rows += rows
    result.checks += checks
    return result


def _methods() -> list[Method]:
    methods: list[Method] = [ThisProject(step) for step in (4.0, 2.0, 1.0)]
    methods += [ThisProject(step, method="classical") for step in _STEPS_MS]
    methods += [PlainMujoco(integrator, step) for integrator in ("Euler", "implicitfast", "RK4") for step in _STEPS_MS]
    methods += [PlainMujoco("RK4", step, lag="filter") for step in _STEPS_MS]
    return methods


def _best_times(flight: Flight, methods: Sequence[Method], *, rounds: int) -> dict[str, float]:
    """Return wall seconds per simulated second by method. A slow method runs once, the others `rounds` times."""
    runs = {method.name: partial(method.fly, flight, record=False) for method in methods}
    best = best_times(runs, rounds=rounds, once_above_s=0.1 * flight.duration_s)
    return {name: took / flight.duration_s for name, took in best.items()}


def _position_error_m(flown: Float64, exact: Float64) -> float:
    return float(np.max(np.linalg.norm(flown[:, :3] - exact[:, :3], axis=1)))


def _tumble_rows(result: BenchmarkResult, methods: Sequence[Method], status: ShowStatus) -> None:
    for method in methods:
        flight = tumble(60.0)
        status(f"tumble: {method.name}")
        began = time.perf_counter()
        end = method.fly(flight, record=False)[-1]
        took = (time.perf_counter() - began) / flight.duration_s
        finite = bool(np.isfinite(end).all())
        drift = spin_drift(flight, end) if finite else dict.fromkeys(("energy", "momentum", "norm"), _DIVERGED)
        error = min(_DIVERGED, max(drift["energy"], drift["momentum"]))
        details = {"finite": finite, **drift}
        result.rows.append(Row("tumble", method.name, error, "1", took, details))


def _landing_rows(result: BenchmarkResult, methods: Sequence[Method], *, rounds: int) -> None:
    flight = landing()
    standing_m = flight.vehicle.standing_height_m
    times = _best_times(flight, methods, rounds=rounds)
    for method in methods:
        flown = method.fly(flight, record=True)
        depth = max(0.0, standing_m - float(flown[:, 2].min()))
        speed = float(np.abs(flown[-1, 7:13]).max())
        result.rows.append(Row("landing", method.name, depth, "m", times[method.name], {"speed_at_end": speed}))


def _flight_checks(result: BenchmarkResult) -> list[Check]:
    row = {(r.case, r.method): r for r in result.rows}
    own, euler = row["vigorous", _OWN], row["vigorous", _EULER_1MS]
    switched = max(row[name, _OWN].error for name in ("switching", "quadratic switching", "motors switching"))
    driven = max(row[name, _OWN].error for name in ("motors", "wind tunnel"))
    many_rotors = max(row[name, _OWN].error for name in (*_MANY_ROTORS, "tilted hexa_x", "quadratic hexa_x"))
    hexa, quadratic_hexa = row["hexa_x", _OWN], row["quadratic hexa_x", _OWN]
    return [
        Check("hexa, octa, X8, Y6, tilted rotors, 5 s: position error", many_rotors, "<=", 1e-6, "m"),
        Check("motors, wind-tunnel rotors, 5 s: position error", driven, "<=", 1e-6, "m"),
        Check("vigorous flight, 5 s: position error", own.error, "<=", 1e-6, "m"),
        Check("vigorous flight, 5 s: attitude error", own.details["attitude_error_rad"], "<=", 1e-6, "rad"),
        Check("rotors that stop and start, 5 s: position error", switched, "<=", 1e-6, "m"),
        Check("vigorous flight: processor time per simulated second", 1e3 * own.time_s, "<=", 2.0, "ms", "speed"),
        Check(
            "hexa_x: processor time over that of the quadratic rotors",
            hexa.time_s / quadratic_hexa.time_s,
            "<=",
            1.5,
            "x",
            "speed",
        ),
        Check("times more accurate than MuJoCo Euler at 1 ms", euler.error / own.error, ">=", 1000.0, "x"),
        Check("processor time over that of MuJoCo Euler at 1 ms", own.time_s / euler.time_s, "<=", 1.0, "x", "speed"),
    ]


def _order_checks() -> list[Check]:
    """Return checks of the orders of convergence: the slopes of log error over log step.

    The classical method flies with the x500's own motor lag.

    From 8 ms down the error of the order-8 method is below the reference's own error. Its order is therefore measured
    at coarser steps, with slow motors and from rest, because it halves its steps for fast motors and high speeds.
    """
    x500 = load_vehicle("x500")
    steps_ms = (8.0, 4.0, 2.0, 1.0)
    flight = vigorous(tick_ns=8_000_000, vehicle=x500)
    classical = _errors_by_step(flight, steps_ms, "classical")
    coarse_ms = (64.0, 32.0)
    coarse = _errors_by_step(vigorous(0.128, tick_ns=64_000_000), coarse_ms, "order8")
    longest = _errors_by_step(flight, (8.0,), "order8")[0]
    return [
        Check("order of convergence, classical, 8 to 1 ms", _slope(steps_ms, classical), ">=", 3.8, "1"),
        Check("order of convergence, order 8, 64 to 32 ms", _slope(coarse_ms, coarse), ">=", 3.8, "1"),
        Check("order 8 with a step of 8 ms, 5 s: position error", longest, "<=", 1e-6, "m"),
    ]


def _errors_by_step(flight: Flight, steps_ms: Sequence[float], method: str) -> list[float]:
    inputs = reference.Inputs(flight.commands, site=flight.site)
    exact = reference.fly(flight.vehicle, flight.start, inputs, tick_s=flight.tick_ns / 1e9)
    return [_position_error_m(ThisProject(step, method=method).fly(flight, record=True), exact) for step in steps_ms]


def _slope(steps: Sequence[float], errors: Sequence[float]) -> float:
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def _hour_checks(status: ShowStatus) -> list[Check]:
    status("tumble: one simulated hour")
    flight = tumble(3600.0)
    drift = spin_drift(flight, ThisProject(4.0).fly(flight, record=False)[-1])
    return [
        Check("tumble, 20 rad/s, one hour: quaternion norm error", drift["norm"], "<=", 1e-12, "1"),
        Check("tumble, 20 rad/s, one hour: energy drift", drift["energy"], "<=", 1e-9, "1"),
        Check("tumble, 20 rad/s, one hour: angular momentum drift", drift["momentum"], "<=", 1e-9, "1"),
    ]
