"""Commands that are refused (exit status 2) leave every folder, and runs/latest, as they were."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hil.cli.app import run_command_line
from tests.worlds.run_json_schema import problems_of

SHORT = ["--set", "duration_s=0.1", "--set", "mission=", "--set", "record.report=false"]
SHORT += ["--set", "autopilot.transport=loopback"]
REFUSING_PART = """
from hil.run.part import Part
from signals.documents.validate import Section
from signals.errors import ConfigError, Problem

class Settings(Section): ...

class Refuses(Part):
    name = "refuses"
    def open(self, run):
        (run.out / "scratch").mkdir()
        raise ConfigError([Problem("wall.yaml:7", "has no ivy"), Problem("wall.yaml:9", "leans")])

def make(bench, settings): return Refuses()
"""


def refused(*arguments: str) -> None:
    assert run_command_line(arguments) == 2


@pytest.fixture
def untouched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], bool]:
    """Work in a folder with one run, and tell whether it is as it was."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs/old").mkdir(parents=True)
    (tmp_path / "runs/latest").symlink_to("old")
    (tmp_path / "broken.plan").write_text("{}")
    (tmp_path / "broken.yaml").write_text("a: [")

    def tree() -> list[tuple[str, str, int]]:
        return [
            (str(path), os.readlink(path) if path.is_symlink() else "", path.lstat().st_size if path.is_file() else 0)
            for path in sorted(tmp_path.rglob("*"))
            if "__pycache__" not in path.parts
        ]

    before = tree()
    return lambda: tree() == before


@pytest.mark.parametrize(
    "arguments",
    [
        "run --rig mok",
        "run --rig mok --out new/folder",
        "run --scene atlantis",
        "run --mission nowhere.plan",
        "run --mission broken.plan",
        "run --set sede=1",
        "run --set sensors.gps.preset=here_pluss",
        "run nowhere.yaml",
        "run broken.yaml",
        "run --rig px4_sitl --set autopilot.binary=/no/px4",
        "run --set autopilot.signing_key_file=no.key",
        "run --set companion.clients=1 --set companion.keys=no_keys",
        "run --dash-fd 77",
        "run --dash --dash-host nohost.invalid",
        "run --print-command",
        "replay nowhere",
        "dataset --set sede=1",
        "dataset nowhere.yaml",
        "dataset --frames 5 --out runs",
        "view atlantis",
        "view city_park --size 3",
        "airsim --scene atlantis",
        "airsim --scene airfield --host nohost.invalid",
        "airsim --scene airfield --host nohost.invalid --out new",
        "dash nowhere.yaml",
        "dash --host nohost.invalid",
        "campaign broken.yaml",
        "campaign search broken.yaml",
        "campaign shrink abc --out runs",
        "campaign compare runs runs",
        "check broken.yaml",
        "radar broken.plan",
        "calibrate radar nowhere.npz",
        "identify nowhere.ulg --vehicle x500",
        "identify broken.plan --vehicle x500 --out new",
        "identify nowhere.ulg --vehicle nothing",
        "identify --excite --vehicle x500 --home nowhere",
        "detect evaluate nowhere",
        "detect data --out new --scene atlantis",
        "keys new bad/name",
        "bench nonsense",
        "companion nonsense --connect tcp://127.0.0.1:1",
    ],
)
def test_a_refused_command_leaves_no_trace(arguments: str, untouched: Callable[[], bool]) -> None:
    refused(*arguments.split())
    assert untouched()


@pytest.mark.parametrize("arguments", ["dash --port", "run --dash --dash-port", "airsim --scene airfield --port"])
def test_a_port_that_is_taken_is_refused(
    arguments: str, untouched: Callable[[], bool], capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        refused(*arguments.split(), str(port))
    assert untouched()
    told = capsys.readouterr().err
    assert f"error: 127.0.0.1:{port}: " in told
    assert f"choose another with {arguments.split()[-1]}" in told


@pytest.mark.parametrize("out", [[], ["--out", "new/folder"]])
def test_a_part_that_refuses_its_settings_when_opened_leaves_no_trace(
    out: list[str],
    untouched: Callable[[], bool],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    own = tmp_path / "own_parts"
    own.mkdir()
    (own / "refuses.py").write_text(REFUSING_PART)
    monkeypatch.syspath_prepend(str(tmp_path))
    try:
        refused("run", "-q", *SHORT, "--set", "parts={own_parts.refuses: {}}", *out)
    finally:
        for name in ("own_parts", "own_parts.refuses"):
            sys.modules.pop(name, None)
        shutil.rmtree(own)
    assert untouched()
    assert capsys.readouterr().err == "error: wall.yaml:7: has no ivy\nerror: wall.yaml:9: leans\n"


def test_an_earlier_result_does_not_pass_for_that_of_a_refused_command(untouched: Callable[[], bool]) -> None:
    Path("runs/old/run.json").write_text('{"schema": 1, "status": "PASS"}')
    refused("run", "--rig", "mok", "--out", "runs/old")
    run = json.loads(Path("runs/old/run.json").read_text())
    assert problems_of(run) == []
    assert (run["status"], run["error"]["type"]) == ("ERROR", "ConfigError")


def test_a_run_that_began_is_kept_and_is_the_latest(untouched: Callable[[], bool]) -> None:
    assert run_command_line(["run", "-q", *SHORT]) == 0
    board = ["--rig", "px4_hitl", "--set", "autopilot.port=/dev/ttyNOPE", "--set", "sensors.imu.rate_hz=250"]
    assert run_command_line(["run", "-q", *board]) == 3
    latest = Path("runs/latest")
    assert re.fullmatch(r"[0-9]{8}-[0-9]{6}-px4_hitl", os.readlink(latest))
    assert json.loads((latest / "run.json").read_text())["error"]["type"] == "PortNotFound"
    refused("run", "--rig", "mok")
    assert len(list(Path("runs").iterdir())) == 4


def test_a_folder_that_holds_a_campaign_is_refused(
    untouched: Callable[[], bool], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("runs/old/campaign.sqlite").touch()
    Path("c.yaml").write_text("axes: {seed: [1]}\n")
    for command in (["campaign", "c.yaml"], ["campaign", "search", "c.yaml"]):
        refused(*command, "--out", "runs/old")
        assert "error: runs/old: holds a campaign" in capsys.readouterr().err
    assert not untouched()
    assert {path.name for path in Path("runs/old").iterdir()} == {"campaign.sqlite"}
