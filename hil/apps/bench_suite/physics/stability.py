"""`hil bench stability`: flies each method far beyond normal flight and shows where its error exceeds a tolerance.

A cell is one flight of one method at one setting. The sweeps step, lag, gain, wind, mass and inertia are compared with
this project's own solution at 0.25 ms, which `hil bench physics` and tests/reference check against CVODES. The others
are checked by conservation laws and bounds, and `hour` by comparing its rounds.

    step      vigorous flight, integration step                     position error <= 1 mm
    lag       vigorous flight, motor time constant                  position error <= 1 mm
    gain      attitude loop at 250 Hz, gain times nominal           attitude error <= 0.01 rad
    spin      tumble without torque for 10 s                        energy and momentum drift <= 1e-6
    wind      hover commands in wind                                position error <= 1 mm
    mass      the same forces on less mass, in 25 m/s of wind       position error <= 1 mm
    inertia   one moment much smaller than the others, spinning     attitude error <= 0.01 rad
    drop      fall onto the landing gear                            depth <= 5 mm, at rest at the end
    slide     touchdown with sideways speed                         no energy gained, at rest at the end
    wall      flight into a wall                                    not through it, no energy gained
    hour      circle in wind for an hour, a round in 20 s           later rounds within 1 mm of the fourth
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hil.apps.bench_suite.physics.attitude_loop import AttitudeLoop, Circle
from hil.apps.bench_suite.physics.flight_cases import (
    Flight,
    Float64,
    PlainMujoco,
    ThisProject,
    attitude_error_rad,
    bench_vehicle,
    hover,
    landing,
    spin_drift,
    start_state,
    torque_free,
    tumble,
    vigorous,
)
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus, save_figure
from signals.errors import ModelRangeError
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics import multirotor
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import Box

TITLE = "Stability: errors of each method far beyond normal flight"
WITHIN, OUT, DIVERGED, REFUSED = (
    "within tolerance",
    "finite, out of tolerance",
    "not finite",
    "stopped with an error",
)
_COLOURS = {WITHIN: "#4c9f70", OUT: "#f0c24b", DIVERGED: "#c8453b", REFUSED: "#6f7fb5"}
_NOT_FINITE = 1e299
Method = ThisProject | PlainMujoco
_OWN = "this project"
_REFERENCE = ThisProject(0.25)
_ROUND_TICKS = 5000
_REST_SPEED = 0.05  # m/s and rad/s at the end of a slide or a drop; soft contact creeps a little


@dataclass(frozen=True)
class Cell:
    """One setting of one sweep. `measure_error` flies it with a method; the error is infinite if it diverged."""

    sweep: str
    value: float
    unit: str
    tolerance: float
    error_unit: str
    measure_error: Callable[[Method], float]


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Fly every cell with every method."""
    result = BenchmarkResult(time_label="wall time of the flight [s]")
    cells = _cells()
    if quick:
        result.left_out.append("one hour of flight: ten minutes instead")
    cells.append(_circling_cell(600.0 if quick else 3600.0))
    for cell in cells:
        for name, method in _methods(cell):
            status(f"{cell.sweep} {cell.value:g} {cell.unit}: {name}")
            result.rows.append(_row(cell, name, method))
    own_rows = [row for row in result.rows if row.method == _OWN]
    diverged = [row for row in own_rows if row.details["verdict"] == DIVERGED]
    out = [row for row in own_rows if row.details["verdict"] == OUT]
    result.checks += [
        Check("cells in which this project is not finite", len(diverged), "<=", 0, "cells"),
        Check("cells in which this project is out of tolerance", len(out), "<=", 0, "cells"),
    ]
    accepted = _inputs_without_error()
    result.checks.append(
        Check("inputs out of range without a ModelRangeError that names them", accepted, "<=", 0, "inputs")
    )
    return result


def plot(result: BenchmarkResult, title: str, path: Path) -> None:
    """Draw a table per sweep: a row per method, a column per setting, the error in each cell. Raises RecordingError."""
    from matplotlib.figure import Figure  # slow to import, and only needed here
    from matplotlib.patches import Patch

    sweeps = list(dict.fromkeys(row.details["sweep"] for row in result.rows))
    columns = 2
    panel_rows = -(-len(sweeps) // columns)
    figure = Figure(figsize=(15.0, 1.75 * panel_rows + 0.8), layout="constrained")
    axes = figure.subplots(panel_rows, columns, squeeze=False)
    for ax in list(axes.flat)[len(sweeps) :]:
        ax.set_visible(False)
    for ax, sweep in zip(axes.flat, sweeps, strict=False):
        sweep_rows = [row for row in result.rows if row.details["sweep"] == sweep]
        methods = list(dict.fromkeys(row.method for row in sweep_rows))
        values = list(dict.fromkeys(row.details["value"] for row in sweep_rows))
        row_of = {(row.method, row.details["value"]): row for row in sweep_rows}
        cells = [[row_of[method, value] for value in values] for method in methods]
        table = ax.table(
            [[_cell_text(row) for row in table_row] for table_row in cells],
            [[_COLOURS[row.details["verdict"]] for row in table_row] for table_row in cells],
            rowLabels=methods,
            colLabels=[f"{value:g}" for value in values],
            loc="center",
        )
        table.scale(1.0, 1.2)
        ax.set_axis_off()
        first = sweep_rows[0]
        limit = first.details["tolerance"]
        allowed = f"{limit:g} {first.error_unit}" if limit else f"no gain in {first.error_unit}"
        heading = f"{sweep} [{first.details['unit']}], tolerance {allowed}"
        ax.set_title(heading, loc="left", fontsize=9, fontweight="bold")
    handles = [Patch(facecolor=colour, label=label) for label, colour in _COLOURS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    figure.suptitle(f"{title}\nin the cells: error", fontsize=11)
    save_figure(figure, path)


def _cell_text(row: Row) -> str:
    if row.error > _NOT_FINITE:
        return "error" if row.details["verdict"] == REFUSED else "not finite"
    return f"{row.error:.1e}" if row.error else "0"


def _methods(cell: Cell) -> list[tuple[str, Method]]:
    """Return the methods of a cell by name.

    This project takes steps of 4 ms and MuJoCo of 1 ms. In the sweep `step` all take the swept step.
    """
    own_ms, mujoco_ms = (cell.value, cell.value) if cell.sweep == "step" else (4.0, 1.0)
    methods: list[tuple[str, Method]] = [(_OWN, ThisProject(own_ms))]
    methods += [(f"MuJoCo {kind}", PlainMujoco(kind, mujoco_ms)) for kind in ("Euler", "implicitfast")]
    methods.append(("MuJoCo RK4", PlainMujoco("RK4", mujoco_ms, lag="filter")))
    if cell.sweep == "hour":
        return methods[:2]
    return methods


def _row(cell: Cell, name: str, method: Method) -> Row:
    began = time.perf_counter()
    try:
        with np.errstate(all="ignore"):
            error = cell.measure_error(method)
        verdict = WITHIN if error <= cell.tolerance else OUT if np.isfinite(error) else DIVERGED
        message = ""
    except ModelRangeError as problem:
        error, verdict, message = float("inf"), REFUSED, str(problem)
    took = time.perf_counter() - began
    details = {
        "sweep": cell.sweep,
        "value": cell.value,
        "unit": cell.unit,
        "tolerance": cell.tolerance,
        "verdict": verdict,
        "message": message,
    }
    finite_error = error if np.isfinite(error) else 1e300  # JSON has no infinity
    return Row(f"{cell.sweep} {cell.value:g} {cell.unit}", name, finite_error, cell.error_unit, took, details)


def _cells() -> list[Cell]:
    cells: list[Cell] = []
    x500 = load_vehicle("x500")
    for step in (0.5, 1.0, 2.0, 4.0, 8.0):
        cells.append(_compared_with_reference("step", step, "ms", vigorous(3.0, tick_ns=8_000_000), "position"))
    for lag in (1e-3, 5e-3, 12.5e-3, 50e-3, 0.2, 1.0):
        flight = vigorous(3.0, vehicle=bench_vehicle(time_constant_up_s=lag, time_constant_down_s=lag))
        cells.append(_compared_with_reference("lag", 1e3 * lag, "ms", flight, "position"))
    for gain in (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0):
        cells.append(Cell("gain", gain, "x", 0.01, "rad", partial(_gain_error, gain)))
    for spin in (1.0, 5.0, 10.0, 20.0, 40.0, 60.0):
        cells.append(Cell("spin", spin, "rad/s", 1e-6, "1", partial(_spin_error, spin)))
    for wind in (0.0, 5.0, 10.0, 15.0, 20.0, 25.0):
        flight = replace(hover(3.0), wind_W_mps=(0.8 * wind, -0.6 * wind, 0.0))
        cells.append(_compared_with_reference("wind", wind, "m/s", flight, "position"))
    for ratio in (1.0, 0.1, 0.01, 0.001):
        light = bench_vehicle().model_copy(update={"mass_kg": x500.mass_kg * ratio})
        commands = np.full((500, 4), 0.7 * multirotor.hover_control(x500) * ratio**0.5)
        start = start_state(light.model_copy(update={"mass_kg": x500.mass_kg}))
        start[13:] *= ratio**0.5
        flight = Flight(light, hover().scene, start, commands, wind_W_mps=(20.0, -15.0, 0.0))
        cells.append(_compared_with_reference("mass", ratio, "of x500", flight, "position"))
    for ratio in (1.0, 0.1, 0.01, 0.001):
        vehicle = torque_free(bench_vehicle()).model_copy(update={"inertia_kgm2": (0.0440, 0.0440, 0.0440 * ratio)})
        flight = replace(tumble(3.0), vehicle=vehicle)
        cells.append(_compared_with_reference("inertia", ratio, "of largest", flight, "attitude"))
    for height in (0.01, 0.1, 0.5, 1.0, 2.0, 5.0, 20.0):
        cells.append(Cell("drop", height, "m", 5e-3, "m", partial(_drop_error, height)))
    for speed in (0.5, 1.0, 2.0, 5.0, 10.0):
        cells.append(Cell("slide", speed, "m/s", 0.0, "J", partial(_slide_error, speed)))
    for speed in (1.0, 2.0, 5.0, 10.0, 20.0):
        cells.append(Cell("wall", speed, "m/s", 0.0, "J", partial(_wall_error, speed)))
    return cells


def _compared_with_reference(sweep: str, value: float, unit: str, flight: Flight, quantity: str) -> Cell:
    reference: list[Float64] = []

    def error(method: Method) -> float:
        if not reference:
            reference.append(_REFERENCE.fly(flight, record=True))
        flown = method.fly(flight, record=True)
        if not np.isfinite(flown).all():
            return float("inf")
        if quantity == "position":
            return float(np.max(np.linalg.norm(flown[:, :3] - reference[0][:, :3], axis=1)))
        return attitude_error_rad(flown, reference[0])

    tolerance, error_unit = (1e-3, "m") if quantity == "position" else (0.01, "rad")
    return Cell(sweep, value, unit, tolerance, error_unit, error)


def _spin_error(spin_radps: float, method: Method) -> float:
    flight = tumble(10.0, spin_radps)
    end = method.fly(flight, record=False)[-1]
    drift = spin_drift(flight, end)
    worst = max(drift["energy"], drift["momentum"])
    return worst if np.isfinite(end).all() and np.isfinite(worst) else float("inf")


def _gain_error(gain: float, method: Method) -> float:
    tracks = []
    for solver in (_REFERENCE, method):
        vehicle = load_vehicle("x500").model_copy(update={"rotor_constants": _single_lag_constants()})
        start = start_state(vehicle)
        start[3:7] = (0.97, 0.2, -0.1, 0.05)
        start[3:7] /= np.linalg.norm(start[3:7])
        flight = Flight(vehicle, hover().scene, start, np.zeros((0, 4)))
        tracks.append(_closed_loop(solver, flight, AttitudeLoop(vehicle, gain=gain), ticks=750))
    if not np.isfinite(tracks[1]).all():
        return float("inf")
    return attitude_error_rad(tracks[1], tracks[0])


def _single_lag_constants() -> Any:
    """Return rotor constants with the x500's spin-up lag in both directions, because MuJoCo's model has one lag."""
    return bench_vehicle(time_constant_up_s=0.0125, time_constant_down_s=0.0125).rotor_constants


def _closed_loop(method: Method, flight: Flight, loop: AttitudeLoop, *, ticks: int, every: int = 1) -> Float64:
    stepper = method.begin(flight)
    states = [flight.start[:13].copy()]
    try:
        for tick in range(1, ticks + 1):
            stepper.advance(loop.commands(stepper.state[:13].tolist()))
            if tick % every == 0:
                states.append(stepper.state[:13].copy())
    finally:
        stepper.close()
    return np.array(states)


def _drop_error(height_m: float, method: Method) -> float:
    flight = landing(height_m, seconds=(2.0 * height_m / STANDARD_GRAVITY_MPS2) ** 0.5 + 2.0)
    flight.start[7:10] = 0.0
    flown = method.fly(flight, record=True)
    if not np.isfinite(flown).all():
        return float("inf")
    still = float(np.abs(flown[-1, 7:13]).max()) < _REST_SPEED
    return max(0.0, flight.vehicle.standing_height_m - float(flown[:, 2].min())) if still else 1.0


def _slide_error(speed_mps: float, method: Method) -> float:
    flight = landing(0.02, seconds=4.0)
    flight.start[7:10] = (speed_mps, 0.0, 0.0)
    return _energy_gain(method, flight, must_rest=True)


def _wall_error(speed_mps: float, method: Method) -> float:
    flight = landing(4.0, seconds=2.0)
    wall = Box(name="wall", center_m=(3.0, 0.0, 5.0), size_m=(0.5, 40.0, 10.0))
    flight = replace(flight, scene=flight.scene.model_copy(update={"boxes": (wall,)}))
    flight.start[7:10] = (speed_mps, 0.0, 1.0)
    return _energy_gain(method, flight, wall_x_m=2.75)


def _energy_gain(method: Method, flight: Flight, *, must_rest: bool = False, wall_x_m: float | None = None) -> float:
    """Return the greatest energy above that of the start [J]; 1 kJ if the vehicle did not rest or passed the wall."""
    flown = method.fly(flight, record=True)
    if not np.isfinite(flown).all():
        return float("inf")
    vehicle = flight.vehicle
    kinetic = 0.5 * vehicle.mass_kg * np.sum(flown[:, 7:10] ** 2, axis=1)
    kinetic += 0.5 * np.sum(np.array(vehicle.inertia_kgm2) * flown[:, 10:13] ** 2, axis=1)
    energy = kinetic + vehicle.mass_kg * STANDARD_GRAVITY_MPS2 * flown[:, 2]
    if must_rest and float(np.abs(flown[-1, 7:13]).max()) > _REST_SPEED:
        return 1e3
    if wall_x_m is not None and float(flown[:, 0].max()) > wall_x_m:
        return 1e3
    return max(0.0, float(np.max(energy[1:]) - energy[0]) - 1e-9 * float(energy[0]))


def _circling_cell(seconds: float) -> Cell:
    def error(method: Method) -> float:
        vehicle = load_vehicle("x500").model_copy(update={"rotor_constants": _single_lag_constants()})
        flight = Flight(vehicle, hover().scene, start_state(vehicle), np.zeros((0, 4)), wind_W_mps=(4.0, -3.0, 0.0))
        loop = AttitudeLoop(vehicle, gain=1.0, circle=Circle((0.0, 0.0, 300.0), 5.0, _ROUND_TICKS))
        states = _closed_loop(method, flight, loop, ticks=round(seconds * 250), every=_ROUND_TICKS // 4)
        if not np.isfinite(states).all():
            return float("inf")
        # Positions at each quarter of a round, without the first three rounds, in which the loop settles.
        settled = states[12:, :3]
        return float(max(np.max(np.linalg.norm(settled[k::4] - settled[k], axis=1)) for k in range(4)))

    return Cell("hour", seconds / 60.0, "min", 1e-3, "m", error)


def _inputs_without_error() -> int:
    """Count inputs outside the model's range without a ModelRangeError that tells tick, variable and value."""
    flight = landing(1.0, seconds=0.1)
    # Index of the state and value: x, x speed, roll rate, y speed, z.
    inputs: Sequence[tuple[int, float]] = ((0, 6e4), (7, 250.0), (10, 300.0), (8, float("nan")), (2, float("inf")))
    missing = 0
    for index, value in inputs:
        start = flight.start.copy()
        start[index] = value
        try:
            ThisProject(4.0).fly(replace(flight, start=start), record=False)
            missing += 1
        except ModelRangeError as error:
            missing += not (error.tick == 1 and error.variable and f"{error.value!r}" in str(error))
    return missing
