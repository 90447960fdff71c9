"""`hil bench gym`: steps a second of the Gymnasium environment, beside other simulators' environments.

The task is hover with an observation of the state, on one core, without pictures; the action is motor commands
(Crazyflow: attitude and thrust, its environments have no motor commands; it is compared with this project's body rates
and thrust). Every simulator flies at its own default rate of decisions or 100 Hz, and this project at the same rate on
the x500. Steps are counted in processor time, in turns; resets between episodes are not counted. Vector environments
with one world stand for a single environment where a simulator has no other.

This project is measured with its own tolerance and with one of 0.1 mm (`tolerance_m`). A ratio is that of its fastest
choice with no larger an error.

The error is the greatest error of position in 3 s of a commanded manoeuvre with body rates of about 10 rad/s
(simulators/manoeuvre.py): each simulator is compared with a fine solution of its own equations and parameters, so it is
an error of integration and not of the model.

    this project        the CasADi model of multirotor_reference.py by CVODES at 1e-14
    RotorPy, Crazyflow  its own equations in double precision by DOP853 at 1e-12
    PyFlyt              its own model in steps 64 times finer, extrapolated

`--set rotorpy=PYTHON`, `crazyflow=PYTHON`, `pyflyt=PYTHON`: interpreters of the environments that have them. By default
they are looked for beside this project. A simulator that is not installed is listed as left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

from hil.apps.bench_suite.options import read_lists
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus, TextTable
from hil.apps.bench_suite.timing import one_core
from lab.gym.peers import (
    CRAZYFLOW_FITTED,
    CRAZYFLOW_RIGID,
    OWN_10_MS,
    OWN_25_MS,
    OWN_COARSE,
    OWN_RATES,
    PEERS,
    PYFLYT,
    ROTORPY,
    Simulator,
    SimulatorError,
    SimulatorProcess,
)

TITLE = "Gymnasium environment: integration error against time of a step"
_WORLDS = 256
_TURN_S = 0.5  # processor time of one measurement
_SINGLE = (OWN_10_MS, OWN_25_MS, OWN_RATES, OWN_COARSE, ROTORPY, PYFLYT, CRAZYFLOW_FITTED, CRAZYFLOW_RIGID)
_BATCHED = (OWN_10_MS, OWN_RATES, OWN_COARSE, ROTORPY, CRAZYFLOW_FITTED, CRAZYFLOW_RIGID)
_SLOW = (CRAZYFLOW_RIGID,)  # left out by --quick: compiling takes longer than measuring


@dataclass
class _Measured:
    """Best of the turns of one simulator."""

    simulator: Simulator
    worlds: int
    decision_s: float
    details: dict[str, Any] = field(default_factory=dict)
    step_s: float = float("inf")  # processor time of a step of one world
    error_m: float = float("nan")

    @property
    def steps_per_s(self) -> float:
        return 1.0 / self.step_s

    def over(self, all_measured: Sequence[_Measured], *, tolerance_m: float | None = None) -> float:
        """Return the steps a second of this project over these, in as many worlds with the same kind of action.

        The fastest counts whose error is no larger than that of these; with `tolerance_m`, the one of that tolerance.
        """
        key = self.worlds, self.decision_s, self.simulator.action
        own = [
            each.steps_per_s
            for each in all_measured
            if each.simulator.is_own
            and key == (each.worlds, each.decision_s, each.simulator.action)
            and (each.error_m <= self.error_m if tolerance_m is None else each.simulator.tolerance_m == tolerance_m)
        ]
        return max(own, default=float("nan")) / self.steps_per_s

    def add(self, turn: Mapping[str, float]) -> None:
        """Take the figures of a turn, if it is the fastest."""
        steps = turn["steps"] * self.worlds
        if turn["cpu_s"] / steps < self.step_s:
            self.step_s = turn["cpu_s"] / steps
            self.details |= {"wall_s": turn["wall_s"] / steps, "reset_s": turn["reset_s"]}


def missing() -> str:
    """Return why this machine cannot run the benchmark, "" if it can."""
    return "" if find_spec("gymnasium") else "needs the package gymnasium: pip install 'hil-bench[gym]'"


def measure(
    *, quick: bool, status: ShowStatus, errors_only: bool = False, options: Mapping[str, str] | None = None
) -> BenchmarkResult:
    """Measure every simulator that is installed. Raises SimulatorError if one that `options` names fails."""
    values = read_lists(options or {}, {peer.option: None for peer in PEERS})
    pythons = {name: texts[0] for name, texts in values.items() if texts}
    result = BenchmarkResult(time_label="processor time of a step [s]")
    rounds = 1 if errors_only else 2 if quick else 5
    skipped = _SLOW if quick else ()
    with one_core():
        single = _measure([s for s in _SINGLE if s not in skipped], 1, rounds, pythons, result, status)
        batched = [] if quick or errors_only else _measure(_BATCHED, _WORLDS, rounds, pythons, result, status)
    errors_m = {each.simulator: each.error_m for each in single}
    for each in batched:  # the same model and integrator as in one world
        each.error_m = errors_m.get(each.simulator, float("nan"))
    for each in single + batched:
        result.rows.append(_row(each))
    result.checks += _checks(single, batched)
    result.tables.append(_table(single + batched))
    if quick:
        result.left_out.append(f"{CRAZYFLOW_RIGID.name}; batches of {_WORLDS} worlds; three of five turns")
    return result


def _measure(
    simulators: Sequence[Simulator],
    worlds: int,
    rounds: int,
    pythons: Mapping[str, str],
    result: BenchmarkResult,
    status: ShowStatus,
) -> list[_Measured]:
    """Open the simulators, measure them in turns, and then the errors of single worlds."""
    measured: list[tuple[SimulatorProcess, _Measured]] = []
    with ExitStack() as stack:
        for simulator in simulators:
            status(f"{simulator.name}, {worlds} worlds: start")
            try:
                process = SimulatorProcess(simulator, worlds=worlds, python=pythons.get(simulator.option))
            except SimulatorError as error:
                if simulator.is_own or simulator.option in pythons:
                    raise
                line = simulator.missing(str(error).removeprefix(f"{simulator.name}: "))
                if line not in result.left_out:
                    result.left_out.append(line)
                continue
            stack.enter_context(process)
            details = {"worlds": worlds, "versions": dict(process.versions)}
            measured.append((process, _Measured(simulator, worlds, process.decision_s, details)))
        for turn in range(rounds):
            for process, each in measured:
                status(f"{each.simulator.name}, {worlds} worlds: turn {turn + 1} of {rounds}")
                each.add(process.measure(_TURN_S))
        if worlds == 1:
            for process, each in measured:
                status(f"{each.simulator.name}: error")
                flown = process.error()
                each.error_m = flown.pop("error_m")
                each.details |= flown
    return [each for _, each in measured]


def _case(each: _Measured) -> str:
    what = "one world" if each.worlds == 1 else f"{each.worlds} worlds"
    return f"{what}, {1e3 * each.decision_s:g} ms"


def _row(each: _Measured) -> Row:
    details = {"steps_per_s": each.steps_per_s, "action": each.simulator.action, **each.details}
    return Row(_case(each), each.simulator.name, each.error_m, "m", each.step_s, details)


def _checks(single: Sequence[_Measured], batched: Sequence[_Measured] = ()) -> list[Check]:
    """Return a check of speed for each peer in one world, for Crazyflow in a batch, and checks of the errors."""
    peers = [each for each in single if not each.simulator.is_own]
    own = [each for each in single if each.simulator.is_own]
    checks = [
        Check(
            f"steps a second over those of {peer.simulator.name}, one world", peer.over(single), ">=", 1.0, "x", "speed"
        )
        for peer in peers
    ]
    for peer in batched:
        if peer.simulator.option == CRAZYFLOW_FITTED.option:
            name = f"steps a second over those of {peer.simulator.name}, {_WORLDS} worlds"
            checks.append(Check(name, peer.over(batched), ">=", 2.0, "x", "speed"))
    exact = [each for each in own if each.simulator.tolerance_m <= OWN_RATES.tolerance_m]
    worst_m = max(each.error_m for each in exact)
    checks.append(Check("position error of this project", worst_m, "<=", 1e-9, "m"))
    for each in own:
        if each not in exact:
            name = f"position error of {each.simulator.name}"
            checks.append(Check(name, each.error_m, "<=", each.simulator.tolerance_m, "m"))
    if peers:
        least_m = min(each.error_m for each in peers)
        checks.append(Check("position error over the least of the others", worst_m / least_m, "<=", 1.0, "x"))
    return checks


def _table(measured: Sequence[_Measured]) -> TextTable:
    header = (
        "simulator",
        "worlds",
        "decision [ms]",
        "steps a second",
        "this project's over it",
        "untuned",
        "error [m]",
    )
    rows: list[tuple[str, ...]] = []
    for each in measured:
        ratios = ("", "")
        if not each.simulator.is_own:
            ratios = (f"{each.over(measured):.3g}", f"{each.over(measured, tolerance_m=OWN_RATES.tolerance_m):.3g}")
        figures = (f"{each.worlds}", f"{1e3 * each.decision_s:g}", f"{each.steps_per_s:.4g}", *ratios)
        rows.append((each.simulator.name, *figures, f"{each.error_m:.2g}"))
    note = (
        "steps of a world a second of processor time of one core; each simulator in a process of its own, in turns; "
        "this project's over it: with its fastest tolerance_m whose error is no larger; untuned: with the default of "
        f"{OWN_RATES.tolerance_m:g} m, as an environment is made without options"
    )
    return TextTable(header, rows, note)
