"""`hil airsim` as a process: what it prints, serves and writes, and how it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.apps.airsim.command import printable
from hil.cli.app import run_command_line
from tests.worlds.airsim_process import AirSimProcess
from tests.worlds.airsim_server import Client
from tests.worlds.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[5]


@contextmanager
def command(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], int, list[str]]]:
    """Start the command; yield the process, its port and the lines that it has printed."""
    process = subprocess.Popen(
        [sys.executable, "-m", "hil.cli", "airsim", "--scene", "airfield", "--port", "0", *arguments],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    lines: list[str] = []
    try:
        assert process.stdout is not None
        for line in process.stdout:
            lines.append(line.rstrip("\n"))
            found = re.match(r"airsim: \S+:(\d+), ", line)
            if found:
                yield process, int(found.group(1)), lines
                return
        pytest.fail("\n".join(lines))
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_and_the_report_is_written(tmp_path: Path, number: int) -> None:
    with command("--clock", "calls", "--out", str(tmp_path)) as (process, port, lines):
        client = Client(port)
        client.call("enableApiControl", True, "")
        client.call("takeoff", 20.0, "")
        client.call("simPlotPoints", [{"x_val": 1.0, "y_val": 0.0, "z_val": 0.0}])
        running = client.send("moveToPosition", 1000.0, 0.0, -5.0, 1.0)
        process.send_signal(number)
        rest, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, rest
        assert running
    assert any("scene airfield, vehicles SimpleFlight, clock calls" in line for line in lines)
    report = json.loads((tmp_path / "airsim.json").read_text())
    assert report["calls"]["takeoff"] == 1
    assert report["sim_s"] > 4.0
    assert report["drawings"] == {"points": 1}
    assert report["clock"] == "calls"
    assert len(report["digest"]) == 64
    assert str(tmp_path) in rest.replace("\n", "")


def test_it_serves_on_when_nobody_reads_its_lines(tmp_path: Path) -> None:
    with command("--out", str(tmp_path)) as (process, port, _):
        assert process.stdout is not None
        process.stdout.close()
        client = Client(port)
        for _ in range(3):
            client.call("simPrintLogMessage", "a line", "", 0)
        assert client.call("ping") is True
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
    assert json.loads((tmp_path / "airsim.json").read_text())["calls"]["ping"] == 1


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="Linux alone pins a process to a core")
def test_one_processor_gives_the_same_digest(tmp_path: Path) -> None:
    digests = set()
    for core in (None, min(os.sched_getaffinity(0))):
        with AirSimProcess(tmp_path / str(core), "--scene", "airfield", "--clock", "calls", core=core) as server:
            client = Client(server.port)
            client.call("enableApiControl", True, "")
            client.call("takeoff", 20.0, "")
            client.call("moveByVelocity", 1.0, 2.0, -0.5, 1.0)
            client.call("getMultirotorState", "")
            client.close()
            digests.add(server.finish()["digest"])
    assert len(digests) == 1


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain äöü ☃", "plain äöü ☃"),
        ("\x1b[2J\n\r\t\x00", "\\x1b[2J\\n\\r\\t\\x00"),
        ("\udcff", "\\udcff"),
        ("x" * 5000, "x" * 1000 + "..."),
    ],
)
def test_texts_of_clients_cannot_move_the_cursor(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert printable(text).encode()


def test_a_host_beyond_loopback_is_warned_about(tmp_path: Path) -> None:
    with command("--host", "0.0.0.0", "--out", str(tmp_path)) as (process, _, lines):
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    assert any("everybody who reaches 0.0.0.0" in line for line in lines)


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "hil.cli", "airsim", *arguments],
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip


def vehicles(**each: object) -> str:
    return json.dumps({"SettingsVersion": 1.2, "SimMode": "Multirotor", "Vehicles": each})


@pytest.mark.parametrize(
    ("arguments", "status", "told"),
    [
        (("--scene", "atlantis"), 2, "atlantis"),
        (("--settings", "{"), 2, "--settings"),
        (("--settings", "/no/such/settings.json"), 2, "/no/such/settings.json"),
        (("--settings", vehicles(A={"VehicleType": "PX4Multirotor"})), 2, "autopilot.binary"),
    ],
)
def test_a_mistake_is_named(
    arguments: tuple[str, ...], status: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = () if "--scene" in arguments else ("--scene", "airfield")
    assert run_command_line(["airsim", "--port", "0", *scene, *arguments]) == status
    shown = capsys.readouterr()
    assert told in (shown.out + shown.err).replace("\n", "")


def test_a_port_that_is_taken_is_named(tmp_path: Path) -> None:
    with command("--out", str(tmp_path)) as (_, port, _lines):
        done = run("--scene", "airfield", "--port", str(port))
    assert done.returncode == 2
    assert f"127.0.0.1:{port}: cannot listen" in done.stderr
    assert "choose another with --port" in done.stderr.replace("\n", " ")
