"""`hil bench gym`: the manoeuvre and its reference, the processes of the simulators, and the checks."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from lab.gym import gym as bench
from lab.gym.peers import (
    CRAZYFLOW_FITTED,
    OWN_10_MS,
    OWN_COARSE,
    OWN_RATES,
    PYFLYT,
    ROTORPY,
    Simulator,
    SimulatorError,
    SimulatorProcess,
)
from lab.gym.simulators.hil_simulator import Simulator as OwnSimulator
from lab.gym.simulators.manoeuvre import SECONDS, decisions, greatest_error_m, solve, thrusts_n, wanted
from signals.errors import ConfigError
from sim.physics import multirotor
from sim.physics.vehicle import load_vehicle


def measured(simulator: Simulator, step_s: float, error_m: float, decision_s: float = 0.01) -> bench._Measured:
    return bench._Measured(simulator, 1, decision_s, step_s=step_s, error_m=error_m)


def test_thrusts_give_the_wanted_accelerations() -> None:
    vehicle = load_vehicle("x500")
    effectiveness, inertia = multirotor.effectiveness(vehicle)[2:], np.array(vehicle.inertia_kgm2)
    weight_n = 9.81 * vehicle.mass_kg
    for t in decisions(0.1):
        thrusts = thrusts_n(t, weight_n=weight_n, inertia_kgm2=inertia, effectiveness=effectiveness)
        factor, acceleration = wanted(t)
        assert thrusts.min() > 0.0
        np.testing.assert_allclose(effectiveness @ thrusts, [factor * weight_n, *(inertia * acceleration)], atol=1e-9)


def test_the_reference_solves_an_oscillator() -> None:
    """x'' = command - x, with a command that changes sign every decision of 0.1 s, from rest: closed form by steps."""
    commands = [1.0 if k % 2 else -1.0 for k in range(30)]

    def rate(s: np.ndarray, command: float) -> np.ndarray:
        return np.array([s[1], command - s[0], 0.0])

    flown = solve(rate, np.zeros(3), commands, 0.1)
    x, v = 0.0, 0.0
    for position, command in zip(flown, commands, strict=True):
        x, v = command + (x - command) * np.cos(0.1) + v * np.sin(0.1), v * np.cos(0.1) - (x - command) * np.sin(0.1)
        assert position[0] == pytest.approx(x, abs=1e-10)
    assert len(flown) * 0.1 == pytest.approx(SECONDS)


def test_an_interpreter_that_is_no_python_is_named(tmp_path: Path) -> None:
    program = tmp_path / "greeter"
    program.write_text("#!/bin/sh\nread request\necho hello\n")
    program.chmod(0o755)
    with pytest.raises(SimulatorError, match=r"RotorPy: '.*greeter' answers 'hello'; give the Python that has it"):
        SimulatorProcess(ROTORPY, worlds=1, python=str(program))


def test_a_flight_that_is_not_finite_has_an_infinite_error() -> None:
    exact = np.zeros((3, 3))
    assert greatest_error_m(np.tile([0.0, 3.0, 4.0], (3, 1)), exact) == 5.0
    assert greatest_error_m(np.full((3, 3), np.nan), exact) == float("inf")


def test_this_project_flies_the_manoeuvre_within_a_nanometre() -> None:
    flown = OwnSimulator(1, "25 motors").error()
    assert flown["error_m"] < 1e-9
    assert flown["rate_radps"] > 8.0


def test_a_process_steps_and_counts() -> None:
    with SimulatorProcess(OWN_10_MS, worlds=3, python=None) as process:
        turn = process.measure(0.05)
    assert process.decision_s == 0.01
    assert turn["steps"] >= 50
    assert turn["cpu_s"] >= 0.05


def test_a_simulator_that_is_missing_names_its_package() -> None:
    absent = Simulator("Absent", "absent", option="absent", install="absent==1")
    with pytest.raises(SimulatorError, match="Absent: ModuleNotFoundError") as caught:
        SimulatorProcess(absent, worlds=1, python=sys.executable)
    line = absent.missing(str(caught.value))
    assert "pip install absent==1" in line
    assert "--set absent=" in line


def test_an_interpreter_that_is_missing_is_named() -> None:
    with pytest.raises(SimulatorError, match="/nonexistent/python: cannot be started"):
        SimulatorProcess(ROTORPY, worlds=1, python="/nonexistent/python")
    with pytest.raises(SimulatorError, match="/nonexistent/python: cannot be started"):
        bench._measure([ROTORPY], 1, 1, {"rotorpy": "/nonexistent/python"}, bench.BenchmarkResult(), lambda _text: None)


def test_an_unknown_simulator_is_an_error() -> None:
    with pytest.raises(ConfigError, match="airsim is unknown"):
        bench.measure(quick=True, status=lambda _text: None, options={"airsim": "python"})


def test_checks_compare_at_the_same_time_of_a_decision_and_kind_of_action() -> None:
    own = [measured(OWN_10_MS, 2e-5, 3e-11), measured(OWN_10_MS, 4e-5, 4e-11, 0.025), measured(OWN_RATES, 1e-4, 3e-11)]
    peers = [measured(ROTORPY, 4e-3, 5e-6), measured(PYFLYT, 1e-5, 0.1, 0.025), measured(CRAZYFLOW_FITTED, 2e-3, 0.1)]
    checks = {check.name: check for check in bench._checks(own + peers)}
    rotorpy, pyflyt, crazyflow = (checks[f"steps a second over those of {p.simulator.name}, one world"] for p in peers)
    assert rotorpy.value == pytest.approx(200.0)
    assert rotorpy.ok
    assert pyflyt.value == pytest.approx(0.25)
    assert not pyflyt.ok
    assert crazyflow.value == pytest.approx(20.0)
    assert checks["position error over the least of the others"].value == pytest.approx(8e-6)


def test_the_table_also_gives_the_ratio_of_the_default_tolerance() -> None:
    own = [measured(OWN_RATES, 5.6e-6, 3e-11), measured(OWN_COARSE, 1.25e-6, 5e-6)]
    table = bench._table([*own, measured(CRAZYFLOW_FITTED, 3.8e-6, 0.07)])
    row = dict(zip(table.header, table.rows[-1], strict=True))
    assert (row["this project's over it"], row["untuned"]) == ("3.04", "0.679")
    assert "default of 1e-09 m" in table.note


def test_checks_without_other_simulators_judge_the_error_alone() -> None:
    assert [check.ok for check in bench._checks([measured(OWN_10_MS, 2e-5, 3e-11)])] == [True]
    assert [check.ok for check in bench._checks([measured(OWN_10_MS, 2e-5, 3e-8)])] == [False]
