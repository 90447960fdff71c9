"""The pages docs/companion.md and docs/wire-protocol.md are complete, and their example and benches fly."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_bridge.codecs import companion as wire
from firmware_bridge.companion.keys import make_keys
from hil.config import load_bench
from hil.config.companion.clients import CLIENT_PATH
from hil.config.schema import Companion
from hil.run.bench_run import run_bench
from hil.run.companion.files import COLUMNS, read_timing
from hil.run_files import TIMING_NAME
from tests.worlds.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]
DOC = (ROOT / "docs" / "companion.md").read_text()
PROTOCOL = (ROOT / "docs" / "wire-protocol.md").read_text()
BENCHES = ROOT / "rigs" / "benches"


def test_the_example_flies(tmp_path: Path) -> None:
    port = 10_000 + os.getpid() % 40_000
    settings = [f"companion.port={port}", "autopilot.transport=loopback", "record.mcap=false", "record.tlog=false"]
    bench = load_bench(ROOT / "docs/examples/companion/bench.yaml", settings=settings)
    client = subprocess.Popen(
        [sys.executable, "look_round.py", f"ipc:///tmp/hil-companion-{port}"],
        cwd=ROOT / "docs/examples/companion",
        env=os.environ | {"PYTHONPATH": str(CLIENT_PATH)},
    )
    try:
        result = run_bench(bench, tmp_path, quiet=True)
        assert client.wait(PATIENCE_S) == 0
    finally:
        client.kill()
        client.wait()
    assert result.status == "PASS", result.run["error"]
    assert result.run["mission"]["landed"]
    assert result.run["companion"]["clients"]["look_round"]["t3_ms"]["p50"] > 0.0
    times = read_timing(tmp_path / TIMING_NAME)["look_round"]
    assert len(times.t_s) == result.run["companion"]["frames"]
    assert (tmp_path / "companion.png").is_file()


def test_the_example_stands_in_the_page() -> None:
    assert (ROOT / "docs/examples/companion/look_round.py").read_text() in DOC


@pytest.mark.parametrize("name", ["waypoints", "echo"])
def test_the_benches_fly(name: str, tmp_path: Path) -> None:
    settings = ["companion.port=0", "autopilot.transport=loopback", "duration_s=2", "record.report=false"]
    result = run_bench(load_bench(BENCHES / f"companion_{name}.yaml", settings=settings), tmp_path, quiet=True)
    assert result.run["error"] is None
    client = result.run["companion"]["clients"][name]
    assert (client["frames"], client["dropped"]) == (50, 0)


def test_the_bench_of_two_machines_is_right_once_there_are_keys(tmp_path: Path) -> None:
    make_keys(tmp_path / "keys", ["jetson"])
    file = BENCHES / "companion_two_machines.yaml"
    bench = load_bench(file, settings=[f"companion.keys={tmp_path / 'keys'}"])
    assert bench.config.companion.expected == 1


def test_the_tables_are_complete() -> None:
    for key in Companion.model_fields:
        assert f"| `{key}` |" in DOC, key
    for kind, keys in wire._KEYS.items():
        part = PROTOCOL.partition(f"\n#### {kind}\n")[2].partition("\n###")[0]
        for key in keys:
            assert f"`{key}`" in part, f"{kind}.{key}"
    for code in wire.REFUSALS:
        assert f"| `{code}` |" in PROTOCOL, code
    for column in COLUMNS:
        assert f"`{column}`" in DOC, column
    assert not [line for line in (DOC + PROTOCOL).splitlines() if len(line) > 120 and not line.startswith("|")]
