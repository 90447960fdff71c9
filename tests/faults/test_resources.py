"""Commands without memory, disk space, descriptors or shared memory: one message, a status, run.json, and resume.

The sweep (slow) runs every command under every shortage; the cheap tests are the cases that once ended otherwise.
"""

from __future__ import annotations

import json
import os
import random
import re
import resource
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest

from hil.cli.app import run_command_line
from tests.worlds.run_json_schema import problems_of
from tests.worlds.strained_machine import small_disk

MB = 1 << 20
SHORT = ("--set", "mission=rigs/missions/short.waypoints", "--set", "autopilot.transport=loopback")
# How a shortage may end. A run that has enough of everything may pass or fail.
ENDS = (0, 1, 3)


class Ended(NamedTuple):
    """End of a command."""

    status: int
    out: str
    said: str  # on standard error


def hil(*words: str | Path, timeout_s: float = 900.0, **limits: int) -> Ended:
    """Run a command under limits of the system, by name: AS=bytes, NOFILE=descriptors, FSIZE=bytes."""

    def limit() -> None:
        for name, value in limits.items():
            resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (value, value))

    line = [sys.executable, "-m", "hil.cli", *map(str, words)]
    environment = {key: value for key, value in os.environ.items() if key != "HIL_TRACEBACK"}
    process = subprocess.run(
        line, capture_output=True, text=True, timeout=timeout_s, check=False, preexec_fn=limit, env=environment
    )
    return Ended(process.returncode, process.stdout, process.stderr)


def check(ended: Ended, folder: Path | None = None) -> None:
    """Check status and message, and the run.json in `folder`."""
    assert ended.status in ENDS, ended
    assert not re.search(r"Traceback|a defect of the bench|nanobind: leaked", ended.out + ended.said), ended
    errors = [line for line in ended.said.splitlines() if line.startswith("error: ")]
    counted = re.search(r" [1-9]\d* ERROR,", ended.out)  # of a campaign, whose cases are errors by themselves
    assert len(errors) == (ended.status == 3 and not counted), ended
    if folder is not None:
        run = json.loads((folder / "run.json").read_text())
        assert problems_of(run) == []
        assert {"PASS": 0, "FAIL": 1, "ERROR": 3}[run["status"]] == ended.status
        if run["status"] == "ERROR":
            assert run["error"]["type"] != "Killed"
            assert run["error"]["message"] in errors[0]


@pytest.mark.parametrize("error", [MemoryError(), ImportError("cv2.so: failed to map segment from shared object")])
def test_a_bench_that_does_not_fit_into_memory_leaves_run_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception
) -> None:
    def load(_: object) -> None:
        raise error

    monkeypatch.setattr("hil.apps.fly.choice.BenchChoice.load", load)
    assert run_command_line(["run", "--out", str(tmp_path), "--quiet"]) == 3
    run = json.loads((tmp_path / "run.json").read_text())
    assert problems_of(run) == []
    assert (run["status"], run["error"]["type"]) == ("ERROR", "OutOfMemory")
    assert run["error"]["message"] in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.parametrize("limit_mb", [150, 280])
def test_out_of_memory_is_told(tmp_path: Path, limit_mb: int) -> None:
    """The smaller limit ends in OpenBLAS, which calls exit(1); the other in Python."""
    ended = hil("run", "--out", tmp_path / "out", "--quiet", AS=limit_mb * MB)
    check(ended, tmp_path / "out")
    assert "no memory is left" in ended.said


@pytest.mark.parametrize("size_kb", [20, 300])
def test_a_disk_that_fills_is_told_in_run_json(tmp_path: Path, size_kb: int) -> None:
    with small_disk(tmp_path / "disk", size_kb):
        out = tmp_path / "disk" / "out"
        ended = hil("run", *SHORT, "--out", out, "--quiet")
        check(ended, out)
        assert "No space left on device" in ended.said


CAMERA = "--set", "sensors.front={kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 5}"
CAMPAIGN = """
settings: {mission: rigs/missions/short.waypoints, autopilot: {transport: loopback}, duration_s: 3}
axes: {seed: {count: 4}}
recheck: 0.5
keep: none
"""


class Case(NamedTuple):
    """One command of the sweep. `line`: its words for a folder; `resumes`: whether --resume continues it."""

    line: Callable[[Path, Path], list[str | Path]]  # folder of inputs, folder of results
    run_json: bool = False
    resumes: bool = False


COMMANDS = {
    "run": Case(lambda _, out: ["run", *SHORT, "--set", "duration_s=8", "--quiet", "--out", out], run_json=True),
    "camera": Case(
        lambda _, out: ["run", *SHORT, *CAMERA, "--scene", "city_park", "--set", "duration_s=4", "-q", "--out", out],
        run_json=True,
    ),
    "dataset": Case(
        lambda _, out: ["dataset", "--frames", "20", "--workers", "2", "--quiet", "--out", out], resumes=True
    ),
    "campaign": Case(
        lambda inputs, out: ["campaign", inputs / "c.yaml", "--workers", "2", "--quiet", "--out", out], resumes=True
    ),
    "replay": Case(lambda inputs, out: ["replay", inputs / "flown", "--out", out]),
    "view": Case(lambda _, out: ["view", "blocks", "--size", "160x120", "--out", out]),
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "c.yaml").write_text(CAMPAIGN)
    line = ["run", *SHORT, "--set", "duration_s=3", "--quiet", "--out", folder / "flown"]
    assert hil(*line).status in (0, 1)
    return folder


def continued(case: Case, inputs: Path, out: Path) -> None:
    """Run the command again with enough of everything: in place of what is left, or from it."""
    resume = ["--resume"] if case.resumes and out.is_dir() and any(out.iterdir()) else []
    ended = hil(*case.line(inputs, out), *resume)
    assert ended.status in (0, 1), ended


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("what", ["memory", "descriptors", "disk", "file size", "no shared memory"])
def test_every_command_without_every_resource(tmp_path: Path, inputs: Path, what: str, name: str, seed: int) -> None:
    case, numbers, out = COMMANDS[name], random.Random(f"{what} {name} {seed}"), tmp_path / "out"
    limits: dict[str, int] = {}
    with ExitStack() as stack:
        if what == "memory":
            limits["AS"] = numbers.randrange(300, 1300) * MB
        elif what == "descriptors":
            limits["NOFILE"] = numbers.choice((8, 10, 12, 16, 20, 24, 32, 48, 64))
        elif what == "file size":
            limits["FSIZE"] = int(10 ** numbers.uniform(3.5, 6.5))
        elif what == "disk":
            grow = stack.enter_context(small_disk(tmp_path / "disk", int(10 ** numbers.uniform(1.0, 3.6))))
            out = tmp_path / "disk" / "out"
        line = case.line(inputs, out)
        ended = without_shared_memory(*line) if what == "no shared memory" else hil(*line, **limits)
        check(ended, out if case.run_json and (out / "run.json").exists() else None)
        if what == "disk":
            grow()
        continued(case, inputs, out)


def without_shared_memory(*words: str | Path) -> Ended:
    """Run a command with a read-only /dev/shm of its own."""
    mount = ["unshare", "-m", "sh", "-c", 'mount -t tmpfs -o ro tmpfs /dev/shm && exec "$@"', "sh"]
    if os.getuid() != 0 or subprocess.run([*mount, "true"], check=False, capture_output=True).returncode != 0:
        pytest.skip("only root mounts file systems")
    line = [*mount, sys.executable, "-m", "hil.cli", *map(str, words)]
    process = subprocess.run(line, capture_output=True, text=True, timeout=900, check=False)
    return Ended(process.returncode, process.stdout, process.stderr)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("limit_mb", [150, 250, 350, 450, 550, 600, 700, 800, 1000])
@pytest.mark.parametrize("name", ["run", "airsim"])
def test_memory_that_runs_out_at_any_stage(tmp_path: Path, name: str, limit_mb: int) -> None:
    words = {"run": ["run", *CAMERA, "--scene", "city_park", "-q"], "airsim": ["airsim", "--port", "0"]}[name]
    try:
        ended = hil(*words, "--out", tmp_path / "out", AS=limit_mb * MB, timeout_s=60)
    except subprocess.TimeoutExpired:
        return  # it serves, so it has enough
    check(ended, tmp_path / "out" if name == "run" else None)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_port_in_use_is_told(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        ended = hil("airsim", "--port", str(taken.getsockname()[1]), "--out", tmp_path / "out", timeout_s=120)
    assert ended.status in (2, 3)
    assert "error: " in ended.said
    assert "Traceback" not in ended.said


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", ["run", "campaign", "view"])
def test_closed_streams_change_no_result(tmp_path: Path, inputs: Path, name: str) -> None:
    line = [sys.executable, "-m", "hil.cli", *map(str, COMMANDS[name].line(inputs, tmp_path / "out"))]
    shell = ["sh", "-c", '"$@" <&- >&- 2>&-', "sh", *line]
    open_status = hil(*COMMANDS[name].line(inputs, tmp_path / "open")).status
    assert subprocess.run(shell, check=False, timeout=900).returncode == open_status
