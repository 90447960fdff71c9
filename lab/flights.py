"""`hil bench flights`: multi-step predictions of logged flights by a vehicle's model.

    hil bench flights --logs DIR --vehicle FILE [--set columns=MAP] [--set fitted=LOG,LOG]

Every log of the folder is cut into its flights. From each measured instant the state that a filter has from the past is
advanced over 0.01, 0.1 and 0.5 s with the motors' readings of that time (hil/apps/identify/fit/prediction.py), and
compared with what was measured then. A row is a log and a horizon: mean norms of the errors of position, velocity,
rotation angle and rate. Beside the model stands a prediction without one: constant velocity and constant attitude.

Tables need a map of their columns: of `--set columns=`, or a `*.columns.yaml` beside the logs or the vehicle file, or
one that comes with the bench, whichever first names columns that the table has. Logs of commands with an accelerometer
add rows of the specific force (flights_force.py). The published figures are checked on
flights of the set that they were published for.

A log that cannot be used is left out and named with the reason; one whose units or axes contradict each other cannot.
What was cut out of the others stands in a table of notes.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.options import read_lists
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus, TextTable
from hil.apps.identify.fit.prediction import HORIZONS_S, LEARNING_S, Grid, Predictor
from hil.apps.identify.plausibility import check_one_vehicle
from hil.apps.identify.preparation import checked_flights, refuse_other_vehicles, with_measured_voltage
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.flight_logs.log_format import LogFile, read_log
from lab.flights_force import LIMITS, add_specific_force
from signals.errors import ConfigError, Problem
from sim.physics.vehicle import Vehicle, load_vehicle

TITLE = "Logged flights: position error of predictions against their time"
QUANTITIES = ("position_m", "velocity_mps", "rotation_rad", "rate_radps")
_UNITS = ("m", "m/s", "rad", "rad/s")
# Busetto et al., arXiv 2512.14450, at 0.5 s: rotation and rate the best published; position and velocity those of a
# rigid body with their constants and a linear rotor drag on flights of the kinds that are fitted here.
_PUBLISHED = {"idsia": (0.104, 0.456, 0.2268, 0.598)}
_SHIPPED_MAPS = Path(__file__).resolve().parents[1] / "docs" / "examples" / "identify"
_SUFFIXES = (".parquet", ".csv", ".ulg", ".bin", ".mcap")
_QUICK_EVERY, _QUICK_LOGS = 10, 4
_SHORTEST_S = LEARNING_S + max(HORIZONS_S)  # of a flight: the least for one prediction
_TOGETHER = 16  # logs that are filtered side by side


@dataclass(frozen=True)
class _Read:
    flights: list[FlightLog]
    map_name: str
    notes: list[Problem]


def missing() -> str:
    """It needs logs, which `hil bench all` does not have."""
    return "needs --logs DIR --vehicle FILE"


def measure(*, quick: bool, status: ShowStatus, options: Mapping[str, str] | None = None) -> BenchmarkResult:
    """Predict every flight of a folder. Raises ConfigError for a folder without logs, or logs that cannot be read."""
    given = read_lists(options or {}, {"logs": None, "vehicle": None, "columns": None, "every": None, "fitted": None})
    lacking = [key for key in ("logs", "vehicle") if not given.get(key)]
    if lacking:
        raise ConfigError([Problem(f"--{key}", "is missing", "hil bench flights --logs DIR --vehicle FILE")
                           for key in lacking])  # fmt: skip
    folder, vehicle_file = Path(given["logs"][0]), given["vehicle"][0]
    vehicle = load_vehicle(vehicle_file)
    refuse_other_vehicles(vehicle)
    files = _files(folder)
    left_out = []
    if quick and len(files) > _QUICK_LOGS:
        left_out.append(f"{len(files) - _QUICK_LOGS} of {len(files)} logs, and nine of ten instants")
        files = [files[i * len(files) // _QUICK_LOGS] for i in range(_QUICK_LOGS)]
    maps = _maps(folder, Path(vehicle_file), given.get("columns"))
    every = _QUICK_EVERY if quick else _every(given.get("every", ("1",)))
    reads, problems = _reads(files, vehicle, maps)
    flights = [flight for read in reads for flight in read.flights]
    if not flights:
        raise ConfigError(list(dict.fromkeys(problems)))
    result = _predicted(flights, vehicle, every=every, status=status)
    result.left_out += left_out + [str(problem) for problem in problems]
    notes = [note for read in reads for note in read.notes] + _mixed(flights, vehicle)
    if notes:
        cells: list[tuple[str, ...]] = [
            (note.where, note.message + (f" ({note.hint})" if note.hint else "")) for note in notes
        ]
        result.tables.insert(0, TextTable(("log", "note"), cells))
    names = {read.map_name for read in reads}
    limit = next((LIMITS[name] for name in names if name in LIMITS), None) if len(names) == 1 else None
    limits = next((_PUBLISHED[name] for name in names if name in _PUBLISHED), None) if len(names) == 1 else None
    result.checks = _checks(result, limits)
    add_specific_force(result, flights, vehicle, fitted=given.get("fitted", ()), limit=limit, status=status)
    return result


def _files(folder: Path) -> list[Path]:
    if not os.path.isdir(folder):
        raise ConfigError.at(f"--logs {folder}", "is no folder", "name the folder that holds the logs")
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in _SUFFIXES)
    if not files:
        raise ConfigError.at(f"--logs {folder}", "holds no logs", f"known suffixes: {', '.join(_SUFFIXES)}")
    return files


def _maps(folder: Path, vehicle_file: Path, named: Sequence[str] | None) -> list[Path | None]:
    if named:
        return [Path(named[0])]
    places = (folder, vehicle_file.parent, _SHIPPED_MAPS)
    found = [path for place in places if place.is_dir() for path in sorted(place.glob("*.columns.yaml"))]
    return list(dict.fromkeys(found))


def _mixed(flights: Sequence[FlightLog], vehicle: Vehicle) -> list[Problem]:
    """Return what shows that flights of one kind are not of one vehicle: they are judged all the same."""
    found: list[Problem] = []
    for kind in sorted({flight.motors_kind for flight in flights}):
        try:
            check_one_vehicle([flight for flight in flights if flight.motors_kind == kind], vehicle)
        except ConfigError as error:
            found += error.problems
    return found


def _every(given: Sequence[str]) -> int:
    """Return of how many instants one is begun from. Raises ConfigError."""
    if len(given) != 1 or not given[0].isdecimal() or int(given[0]) < 1:
        raise ConfigError.at("--set every", f"must be a whole number from 1, not {', '.join(given) or 'empty'}")
    return int(given[0])


def _reads(files: Sequence[Path], vehicle: Vehicle, maps: Sequence[Path | None]) -> tuple[list[_Read], list[Problem]]:
    """Return the logs that can be judged, and why the others cannot."""
    reads: list[_Read] = []
    problems: list[Problem] = []
    for path in files:
        try:
            reads.append(_read(path, vehicle, maps))
        except ConfigError as error:
            problems += error.problems
    return reads, problems


def _read(path: Path, vehicle: Vehicle, maps: Sequence[Path | None]) -> _Read:
    tables = path.suffix.lower() in (".parquet", ".csv")
    first: ConfigError | None = None
    for columns in maps if tables and maps else [None]:
        file = LogFile(path, vehicle, columns)
        try:
            log = with_measured_voltage(read_log(file), file)
        except ConfigError as error:
            first = first or error
            continue
        if log.pose is None:
            hint = "predictions begin from both: log them"
            raise file.refuse("has no attitude with a position", hint, topic=file.topic("pose"))
        flights = checked_flights(log, file)
        long = [flight for flight in flights if flight.duration_s > _SHORTEST_S]
        if not long:
            spans = ", ".join(f"{flight.start_s:.2f} to {flight.end_s:.2f} s" for flight in flights) or "none at all"
            cut = "; ".join(f"{note.where.partition(': ')[2]} {note.message}" for note in file.notes)
            raise file.refuse(f"has no free flight of more than {_SHORTEST_S:g} s (found: {spans})", cut)
        return _Read(long, "" if columns is None else columns.name.partition(".")[0], file.notes)
    assert first is not None
    raise first


def _predicted(flights: Sequence[FlightLog], vehicle: Vehicle, *, every: int, status: ShowStatus) -> BenchmarkResult:
    result = BenchmarkResult(time_label="processor seconds per 1000 predictions of 0.5 s, filter included")
    steps = [round(h / 0.01) for h in HORIZONS_S]
    cells: list[tuple[str, ...]] = []
    for kind in sorted({flight.motors_kind for flight in flights}):
        predictor = Predictor(vehicle, kind)
        of_kind = [flight for flight in flights if flight.motors_kind == kind]
        for first in range(0, len(of_kind), _TOGETHER):
            together = of_kind[first : first + _TOGETHER]
            status(f"{together[0].name} and {len(together) - 1} more")
            began = time.process_time()
            grid = Grid.of(together, predictor.model.step_s, predictor.nominal_v)
            found = predictor.track(grid)
            errors = [predictor.errors(grid, found, log, horizons=steps, every=every) for log in range(len(together))]
            total = sum(e[steps[0]].shape[1] for e in errors)
            cost_s = (time.process_time() - began) / max(total, 1) * 1000.0
            for log, flight in enumerate(together):
                if errors[log][steps[0]].shape[1]:
                    _add_rows(result, cells, flight, errors[log], _held(grid, log, steps, every), cost_s)
    header = (
        "log",
        "horizon s",
        *(f"{n.partition('_')[0]} {u}" for n, u in zip(QUANTITIES, _UNITS, strict=True)),
        "s/1000",
    )
    note = "mean norms of errors; s/1000: processor seconds per 1000 predictions of 0.5 s, filter included"
    result.tables.append(TextTable(header, cells, note))
    return result


def _add_rows(
    result: BenchmarkResult,
    cells: list[tuple[str, ...]],
    flight: FlightLog,
    errors: Mapping[int, NDArray[np.float64]],
    held: Mapping[int, NDArray[np.float64]],
    cost_s: float,
) -> None:
    for horizon_s, h in zip(HORIZONS_S, errors, strict=True):
        means = {"model": errors[h].mean(axis=1), "held": held[h]}
        for method, mean in means.items():
            if flight.rate is None:
                mean[3] = np.nan
            details = {"log": flight.name, "horizon": horizon_s, "predictions": errors[h].shape[1]}
            details |= dict(zip(QUANTITIES, (float(x) for x in mean), strict=True))
            took_s = cost_s if method == "model" else float("nan")
            result.rows.append(Row(flight.name, f"{method} @ {horizon_s:g} s", float(mean[0]), "m", took_s, details))
        cells.append((flight.name, f"{horizon_s:g}", *(f"{x:.4f}" for x in means["model"]), f"{cost_s:.3g}"))


def _held(grid: Grid, log: int, steps: Sequence[int], every: int) -> dict[int, NDArray[np.float64]]:
    """Return the mean errors if velocity and attitude stayed as measured, and the rate were zero."""
    y = grid.measured[grid.known[:, log], :, log]
    k = np.arange(100, len(y) - max(steps), every)
    out = {}
    for h in steps:
        p = y[k, :3] + 0.01 * h * y[k, 7:10] - y[k + h, :3]
        q = np.clip(np.abs((y[k, 3:7] * y[k + h, 3:7]).sum(axis=1)), 0.0, 1.0)
        v, w = y[k, 7:10] - y[k + h, 7:10], y[k + h, 10:13]
        norms = [np.linalg.norm(x, axis=1).mean() for x in (p, v)]
        out[h] = np.array([*norms, (2 * np.arccos(q)).mean(), np.linalg.norm(w, axis=1).mean()])
    return out


def _checks(result: BenchmarkResult, published: Sequence[float] | None) -> list[Check]:
    """Return the errors at the longest horizon, over all predictions, against published ones or no model's."""
    longest = max(HORIZONS_S)
    checks = []
    for i, (name, unit) in enumerate(zip(QUANTITIES, _UNITS, strict=True)):
        means = []
        for method in ("model", "held"):
            rows = [r.details for r in result.rows if r.method.startswith(method) and r.details["horizon"] == longest]
            rows = [r for r in rows if np.isfinite(r[name])]
            total = sum(r["predictions"] for r in rows)
            means.append(sum(r[name] * r["predictions"] for r in rows) / total if total else float("nan"))
        if not np.isfinite(means[0]):
            continue
        limit = means[1] if published is None else published[i]
        against = "of constant velocity and attitude" if published is None else "published or reached before"
        label = f"{name.partition('_')[0]} error at {longest:g} s, limit {against}"
        checks.append(Check(label, means[0], "<=", limit, unit))
    return checks
