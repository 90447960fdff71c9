"""Failures of a run with several vehicles: every vehicle has a result, and everything that was opened is closed."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from hil.apps.campaign.flight import Outcome
from hil.config import Bench, load_bench
from hil.flown_run import Run, health
from hil.run.bench_run import run_bench
from hil.run.part import Part, RunContext

TEXT = """
rig: mock
mission: null
router: {sdk: "udp:127.0.0.1:14599"}
autopilot: {transport: loopback}
record: {report: false, tlog: false}
duration_s: 0.4
vehicles: {a: {}, b: {start: {p_W: [5, 0, 0]}}}
"""


def bench(tmp_path: Path, *settings: str) -> Bench:
    (tmp_path / "bench.yaml").write_text(TEXT)
    return load_bench(tmp_path / "bench.yaml", settings=settings)


class Probe(Part):
    """Part that pauses the run, and raises an error in the method `fails`, at tick 3 or later."""

    name = "probe"
    paused_s = 0.0

    def __init__(self, fails: str = "", paused_s: float = 0.0) -> None:
        self._fails, self.paused_s = fails, paused_s
        self._ticks = 0
        self.closed = False

    def _step(self, method: str) -> None:
        if method == self._fails and self._ticks >= 3:
            raise RuntimeError("boom")

    def before_tick(self) -> None:
        self._ticks += 1
        self._step("before_tick")

    def after_tick(self, tick: int) -> None:
        self._step("after_tick")

    def ended(self) -> bool:
        self._step("ended")
        return False

    def conclude(self, run: RunContext) -> None:
        self._step("conclude")

    def close(self) -> None:
        self.closed = True


def results(out: Path) -> dict[str, Any]:
    return {name: json.loads((out / name / "run.json").read_text()) for name in ("a", "b")}


@pytest.mark.parametrize("method", ["before_tick", "after_tick", "ended", "conclude"])
def test_a_defect_of_a_part_names_its_vehicle_and_ends_the_flight_of_all(method: str, tmp_path: Path) -> None:
    probe = Probe(method)
    more = {"a": [], "b": [probe]}
    result = run_bench(bench(tmp_path), tmp_path / "run", quiet=True, more=more.__getitem__)
    assert (result.status, result.run["error"]["type"]) == ("ERROR", "InternalError")
    assert result.run["error"]["message"].startswith("b: RuntimeError: boom")
    errors = {name: run["error"] for name, run in results(result.out).items()}
    assert errors["a"]["type"] == "OtherVehicleFailed"
    assert errors["a"]["message"] == "the vehicle b failed: boom"
    assert errors["b"]["message"].startswith("RuntimeError: boom")
    assert probe.closed


def test_a_vehicle_that_cannot_begin_is_named_and_the_others_are_closed(tmp_path: Path) -> None:
    probe = Probe()
    settings = ("vehicles.b.autopilot.transport=pty", "vehicles.b.autopilot.port=/dev/no_such_port")
    result = run_bench(bench(tmp_path, *settings), tmp_path / "run", quiet=True, more=[probe])
    assert result.status == "ERROR"
    assert result.run["error"]["message"].startswith("b: ")
    assert {name: run["error"]["type"] for name, run in results(result.out).items()} == {
        "a": "OtherVehicleFailed",
        "b": result.run["error"]["type"],
    }
    assert probe.closed


def test_vehicles_that_never_flew_are_named(tmp_path: Path) -> None:
    run = run_bench(bench(tmp_path), tmp_path / "out", quiet=True).run
    assert run["unflown"].startswith("a: nothing was flown or judged: ")
    assert "; b: nothing was flown or judged: " in run["unflown"]


def test_a_group_of_which_a_vehicle_flew_has_flown(tmp_path: Path) -> None:
    """One parked vehicle made the flight of all one of nothing: `search` left it out, and a test failed."""
    plan = tmp_path / "up.waypoints"
    plan.write_text("QGC WPL 110\n0\t0\t3\t22\t0\t0\t0\t0\t0\t0\t2\t1\n1\t0\t3\t21\t0\t0\t0\t0\t0\t0\t0\t1\n")
    runs = {}
    for name, mission in (("none", "null"), ("one", str(plan))):
        settings = (f"vehicles.a.mission={mission}", "duration_s=40", "record.mcap=false")
        runs[name] = run_bench(bench(tmp_path, *settings), tmp_path / name, quiet=True)
    outcomes = {name: Outcome.from_run(result.run) for name, result in runs.items()}
    assert [outcome.status for outcome in outcomes.values()] == ["PASS", "PASS"]
    assert [outcome.flown for outcome in outcomes.values()] == [False, True]
    assert outcomes["none"].unmet == (runs["none"].run["unflown"],)
    (told,) = outcomes["one"].unmet
    assert told.startswith("b: nothing was flown or judged: ")
    assert [health(Run(result.run, result.out))["unflown"] for result in runs.values()] == [1, 0]


def test_pauses_of_one_vehicle_are_time_of_none(tmp_path: Path) -> None:
    """The dashboard of the first vehicle pauses the run of all."""
    result = run_bench(bench(tmp_path), tmp_path / "run", quiet=True, more=[Probe(paused_s=1000.0)])
    walls_s = [result.run["wall_s"], *(run["wall_s"] for run in results(result.out).values())]
    assert max(walls_s) < 0.0


def test_a_link_in_the_folder_of_a_vehicle_is_not_written_through(tmp_path: Path) -> None:
    """As copies with hard links, `cp -al`, make them."""
    kept = tmp_path / "kept.json"
    kept.write_text("{}")
    (tmp_path / "run" / "a").mkdir(parents=True)
    os.link(kept, tmp_path / "run" / "a" / "run.json")
    os.link(kept, tmp_path / "run" / "a" / "vehicle.yaml")
    run_bench(bench(tmp_path), tmp_path / "run", quiet=True)
    assert kept.read_text() == "{}"
    assert (tmp_path / "run" / "a" / "vehicle.yaml").read_text() != "{}"
