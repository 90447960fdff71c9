"""Failures of a run with several vehicles: every vehicle has a result, and everything that was opened is closed."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from hil.config import Bench, load_bench
from hil.run.bench_run import run_bench
from hil.run.part import Part

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
    """Part that pauses the run, and raises `error` before tick 3."""

    name = "probe"
    paused_s = 0.0

    def __init__(self, error: Exception | None = None, paused_s: float = 0.0) -> None:
        self._error, self.paused_s = error, paused_s
        self._ticks = 0
        self.closed = False

    def before_tick(self) -> None:
        self._ticks += 1
        if self._ticks == 3 and self._error is not None:
            raise self._error

    def close(self) -> None:
        self.closed = True


def results(out: Path) -> dict[str, Any]:
    return {name: json.loads((out / name / "run.json").read_text()) for name in ("a", "b")}


def test_a_defect_outside_a_vehicles_tick_is_an_error_of_all(tmp_path: Path) -> None:
    probe = Probe(RuntimeError("boom"))
    result = run_bench(bench(tmp_path), tmp_path / "run", quiet=True, more=[probe])
    assert (result.status, result.run["error"]["type"]) == ("ERROR", "InternalError")
    assert {run["status"] for run in results(result.out).values()} == {"ERROR"}
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
