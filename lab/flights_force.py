"""Specific force of flights whose log has commands and an accelerometer: the vehicle's model against a constant gain.

A row is a log, or a band of the battery's voltage over all logs that are judged: rms of the error over 0.1 s means
(hil/apps/identify/fit/acceleration.py), and its ratio to that of the better of two constant gains. These are fitted by
least squares to the logs that the vehicle was fitted to, `--set fitted=NAME,NAME`, which are then not judged; without
that option to every log, which favours the gains.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus, TextTable
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.acceleration import constant_gain, errors, forces_of
from hil.apps.identify.fit.flight_model import make_model
from hil.run.flight_logs.flight_log import FlightLog
from signals.errors import ConfigError
from sim.physics.vehicle import Vehicle

# Crazyflie 2.1, arXiv 2603.09908: what a fitted vehicle has to reach of a constant gain's error on flights held out.
LIMITS = {"nanobench": 0.6}
_BAND_V, _STEP_S, _FEWEST = 0.1, 0.01, 50


def add_specific_force(
    result: BenchmarkResult, flights: Sequence[FlightLog], vehicle: Vehicle, *, fitted: Collection[str],
    limit: float | None, status: ShowStatus,
) -> None:  # fmt: skip
    """Add rows, a table and, where the data set has a limit, its check. Raises ConfigError for an unknown log."""
    usable = [f for f in flights if f.motors_kind == "command" and f.accel is not None and f.velocity is not None]
    if not usable:
        return
    unknown = sorted(set(fitted) - {f.name for f in usable})
    if unknown:
        names = ", ".join(f.name for f in usable)
        raise ConfigError.at("--set fitted", f"{', '.join(unknown)}: no such flight", f"known: {names}")
    judged = [f.name for f in usable if f.name not in fitted]
    if not judged:
        raise ConfigError.at("--set fitted", "names every flight", "leave some out: those are judged")
    model = make_model(vehicle, at.vehicle_unknowns(vehicle), kind="command", step_s=_STEP_S)
    s = np.zeros(at.VEHICLE_COUNT + at.LOG_COUNT)
    nominal_v = vehicle.battery.nominal_voltage_v if vehicle.battery else 1.0
    forces, took_s = {}, {}
    for flight in usable:
        status(f"specific force of {flight.name}")
        began = time.process_time()
        forces[flight.name] = forces_of(model, s, flight, nominal_v)
        took_s[flight.name] = time.process_time() - began
    gains = constant_gain([forces[f.name] for f in usable if not fitted or f.name in fitted])
    cells = []
    pairs = {name: errors(forces[name], gains) for name in judged}
    for name in judged:
        volts = float(np.median(forces[name].voltage))
        cells.append(_row(result, name, pairs[name], volts, took_s[name]))
    volts_of = np.concatenate([forces[name].voltage for name in judged])
    all_off, all_plain = (np.concatenate([pairs[name][i] for name in judged]) for i in range(2))
    if any(f.voltage is not None for f in usable):
        for low in np.arange(np.floor(volts_of.min() / _BAND_V), np.ceil(volts_of.max() / _BAND_V)) * _BAND_V:
            inside = (volts_of >= low) & (volts_of < low + _BAND_V)
            if inside.sum() >= _FEWEST:
                case = f"{low:.1f} to {low + _BAND_V:.1f} V"
                cells.append(_row(result, case, (all_off[inside], all_plain[inside]), low + 0.5 * _BAND_V, 0.0))
    cells.append(_row(result, "all", (all_off, all_plain), float(np.median(volts_of)), sum(took_s.values())))
    note = "specific force over 0.1 s, rms of the error; gain: the better of thrust per command and per its square"
    result.tables.append(TextTable(("flight", "V", "model m/s2", "gain m/s2", "ratio"), cells, note))
    if limit is not None:
        plain = _rms(all_plain)
        ratio = _rms(all_off) / plain if plain > 0.0 else float("nan")
        result.checks.append(Check("error of specific force over a constant gain's", ratio, "<=", limit, "-"))


def _row(
    result: BenchmarkResult,
    case: str,
    pair: tuple[NDArray[np.float64], NDArray[np.float64]],
    volts: float,
    took_s: float,
) -> tuple[str, ...]:
    off, plain = _rms(pair[0]), _rms(pair[1])
    ratio = off / plain if plain > 0.0 else float("nan")
    details = {"voltage_v": volts, "gain_mps2": plain, "ratio": ratio, "samples": len(pair[0])}
    result.rows.append(Row(case, "specific force", off, "m/s2", took_s or float("nan"), details))
    return case, f"{volts:.2f}", f"{off:.3f}", f"{plain:.3f}", f"{ratio:.2f}"


def _rms(x: NDArray[np.float64]) -> float:
    return float(np.sqrt((x * x).mean()))
