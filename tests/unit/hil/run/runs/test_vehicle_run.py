"""Results of a run: the warnings that stand in it, and the problems of one that did not begin."""

from __future__ import annotations

import builtins
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.part import Part, RunContext
from hil.run.parts.judges.unflown import NOTHING_FLIES
from signals.errors import ConfigError, Problem
from tests.worlds.bench_files import elsewhere

__all__ = ["elsewhere"]
SHORT = [
    "autopilot.transport=loopback",
    "mission=null",
    "record.mcap=false",
    "record.tlog=false",
    "record.report=false",
]


class Says(Part):
    name = "says"

    def begin(self, run: RunContext) -> None:
        run.event("warning", "GPS")
        run.event("warning", "lost")
        run.event("warning", "told otherwise")

    def told(self) -> list[str]:
        return ["told otherwise", "GPS was lost"]


class Refuses(Part):
    name = "refuses"

    def build(self, run: RunContext) -> None:
        raise ConfigError([Problem("a: b.yaml:3", "x: is wrong", "do: that"), Problem("c.yaml", "y")])


def test_a_short_warning_is_not_swallowed_by_a_longer_text(tmp_path: Path) -> None:
    bench = load_bench(None, settings=[*SHORT, "duration_s=0.1"])
    run = run_bench(bench, tmp_path / "out", quiet=True, more=[Says()]).run
    assert [row["text"] for row in run["warnings"]] == ["GPS", "lost", NOTHING_FLIES]


def test_report_and_recordings_of_an_earlier_run_do_not_pass_for_this_one_s(tmp_path: Path) -> None:
    """They stayed beside the run.json of a run without them, and were opened, filmed and fitted as its own."""
    out = tmp_path / "out"
    whole = [*SHORT[:2], "duration_s=0.1"]
    run_bench(load_bench(None, settings=whole), out, quiet=True)
    written = {"run.json", "report.html", "run.mcap", "flight.tlog"}
    assert written <= {path.name for path in out.iterdir()}
    run_bench(load_bench(None, settings=[*SHORT, "duration_s=0.1"]), out, quiet=True)
    assert written & {path.name for path in out.iterdir()} == {"run.json"}


def test_the_problems_of_a_run_that_did_not_begin_are_kept_as_they_are(tmp_path: Path) -> None:
    bench = load_bench(None, settings=[*SHORT, "duration_s=0.1"])
    error = run_bench(bench, tmp_path / "out", quiet=True, more=[Refuses()]).config_error
    assert error is not None
    assert error.problems == [Problem("a: b.yaml:3", "x: is wrong", "do: that"), Problem("c.yaml", "y")]


def test_memory_that_runs_out_while_the_bench_is_imported_leaves_a_run_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imported = builtins.__import__

    def scarce(name: str, *more: object) -> object:
        if name == "hil.run.bench_run":
            raise ImportError("mujoco.so: failed to map segment from shared object")
        return imported(name, *more)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", scarce)
    done = CliRunner().invoke(app, ["run", "--out", str(tmp_path / "out")])
    assert done.exit_code == 3
    assert json.loads((tmp_path / "out/run.json").read_text())["error"]["type"] == "OutOfMemory"
