"""Every fault ends a run with one named error, the right status, run.json and a readable recording."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.cli.app import run_command_line
from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.recorder.reading import read_messages
from tests.worlds.patience import PATIENCE_S, until
from tests.worlds.run_json_schema import problems_of

ROOT = Path(__file__).resolve().parents[2]


def fly(out: Path, *settings: str) -> RunResult:
    common = ["record.report=false", "duration_s=30", f"autopilot.reply_timeout_s={PATIENCE_S}"]
    return run_bench(load_bench(settings=[*common, *settings]), out, quiet=True)


def recorded_until_s(out: Path) -> float:
    return max(m.log_time_ns for m in read_messages(out / "run.mcap") if m.topic == "/truth/pose") * 1e-9


FAULTS = [
    ("die", "LinkClosed", "died|status 70"),
    ("stall", "LockstepLost", "time_usec"),
    ("wrong_time", "LockstepLost", "its answer"),
    ("garbage", "LockstepLost", "damaged"),
]


@pytest.mark.parametrize(
    ("fault", "error", "words", "transport"),
    [
        *((*fault, "loopback") for fault in FAULTS),
        (*FAULTS[0], "pty"),
        *(pytest.param(*fault, "pty", marks=pytest.mark.slow) for fault in FAULTS[1:]),
    ],
)
def test_a_mock_that_fails_in_flight_is_named(
    transport: str, fault: str, error: str, words: str, tmp_path: Path
) -> None:
    settings = [f"autopilot.faults.{fault}_at_s=4.5", f"autopilot.transport={transport}"]
    if transport == "pty" and fault in ("stall", "garbage"):  # in memory the end of all bytes is known
        settings.append("autopilot.reply_timeout_s=5")
    outcome = fly(tmp_path, *settings)
    assert outcome.status == "ERROR"
    assert outcome.exit_status == 3
    run = json.loads((tmp_path / "run.json").read_text())
    assert problems_of(run) == []
    assert run["error"]["type"] == error
    assert re.search(words, run["error"]["message"])
    assert not (tmp_path / "traceback.txt").exists()
    # Recorded up to the tick without an answer.
    assert recorded_until_s(tmp_path) == pytest.approx(4.5, abs=0.0041)


def test_noise_between_frames_does_not_end_a_run(tmp_path: Path) -> None:
    outcome = fly(tmp_path, "autopilot.faults.noise_at_s=4.5", "duration_s=9")
    assert outcome.run["error"] is None
    assert outcome.run["sim_s"] == 9.0
    assert outcome.run["autopilot"]["link"]["garbage_bytes"] > 1000


@contextmanager
def flying(out: Path, *, pace: int, recorded_bytes: int) -> Iterator[subprocess.Popen[str]]:
    """Yield `hil run` in a process of its own that has recorded part of its flight; kill it at the end."""
    settings = [f"pace={pace}", "record.report=false"]
    command = [sys.executable, "-m", "hil.cli", "run", "--out", str(out)]
    command += [word for setting in settings for word in ("--set", setting)]
    bench = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        mcap = out / "run.mcap"
        until(lambda: mcap.exists() and mcap.stat().st_size > recorded_bytes, "the recording")
        yield bench
    finally:
        bench.kill()
        bench.communicate()


def mock_children(parent: int) -> list[int]:
    """Return the process ids of the mock flight controllers that `parent` started."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            ppid = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if ppid == parent and b"mock_pixhawk" in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
        except (OSError, ValueError):
            continue  # it has ended meanwhile
    return found


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds the mock through /proc")
def test_a_mock_killed_from_outside_is_named(tmp_path: Path) -> None:
    with flying(tmp_path, pace=5, recorded_bytes=600_000) as bench:
        os.kill(mock_children(bench.pid)[0], signal.SIGKILL)
        _, errors = bench.communicate(timeout=PATIENCE_S)
    assert bench.returncode == 3
    assert "LinkClosed" in errors
    assert "Traceback" not in errors
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "ERROR"
    assert recorded_until_s(tmp_path) > 0.5


def test_a_bench_that_is_killed_leaves_a_readable_prefix(tmp_path: Path) -> None:
    with flying(tmp_path, pace=10, recorded_bytes=600_000) as bench:
        bench.kill()
        bench.wait()
    assert recorded_until_s(tmp_path) > 1.0


def test_interrupted_from_the_keyboard(tmp_path: Path) -> None:
    with flying(tmp_path, pace=5, recorded_bytes=100_000) as bench:
        bench.send_signal(signal.SIGINT)
        _, errors = bench.communicate(timeout=PATIENCE_S)
    assert bench.returncode == 3
    assert "Traceback" not in errors
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["error"]["type"] == "Interrupted"
    assert recorded_until_s(tmp_path) == pytest.approx(run["sim_s"], abs=0.05)


@pytest.fixture
def cli(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, dict]]:
    """Run `hil run` in this process and return its status, its messages and its run.json."""
    monkeypatch.chdir(ROOT)

    def run(*arguments: str) -> tuple[int, str, dict]:
        status = run_command_line(["run", "--out", str(tmp_path), *arguments])
        return status, capsys.readouterr().err, json.loads((tmp_path / "run.json").read_text())

    return run


@pytest.mark.parametrize(
    ("arguments", "status", "error", "words"),
    [
        (["--set", "sensors.gps.rate_hz=-5"], 2, "ConfigError", "--set sensors.gps.rate_hz: must be above 0 Hz"),
        (["--set", "seed=one"], 2, "ConfigError", "seed"),
        (["--rig", "mok"], 2, "ConfigError", "did you mean 'mock'"),
        (["--mission", "nowhere.plan"], 2, "ConfigError", "does not exist"),
        (["nowhere.yaml"], 2, "ConfigError", "nowhere.yaml"),
        (["--set", "autopilot.port=/dev/ttyNOPE", "--set", "autopilot.start=false"], 3, "PortNotFound", "/dev/ttyNOPE"),
        (["--set", "autopilot.params={EKF2_NONSENSE: 1}"], 2, "ConfigError", "EKF2_NONSENSE"),
    ],
)
def test_bad_input_ends_with_one_clear_message(
    cli: Callable[..., tuple[int, str, dict]], arguments: list[str], status: int, error: str, words: str
) -> None:
    returned, errors, run = cli(*arguments)
    assert returned == status, errors
    assert "Traceback" not in errors
    assert run["status"] == "ERROR"
    assert run["error"]["type"] == error
    assert words in errors
    assert len(errors.strip().splitlines()) <= 3


def test_a_busy_port_is_named(cli: Callable[..., tuple[int, str, dict]]) -> None:
    import serial

    near, far = pty.openpty()
    try:
        with serial.Serial(os.ttyname(far), exclusive=True):
            returned, errors, run = cli("--set", f"autopilot.port={os.ttyname(far)}", "--set", "autopilot.start=false")
    finally:
        os.close(near)
        os.close(far)
    assert returned == 3
    assert run["error"]["type"] == "PortBusy", errors
