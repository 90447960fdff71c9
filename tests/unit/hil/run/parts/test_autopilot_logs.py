"""The report page links to the logs that the firmware has written in the run."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.parts.links.autopilot import AutopilotPart

ULOG, DATAFLASH = "autopilot/log/2026-11-24/04_09_36.ulg", "autopilot/logs/00000001.BIN"


@pytest.mark.parametrize(
    ("rig", "linked"),
    [
        ("px4_sitl", ["autopilot.log", ULOG]),
        ("ardupilot_sitl", ["autopilot.log", "autopilot/arducopter.log", DATAFLASH]),
        ("mock", ["autopilot.log"]),
    ],
)
def test_logs_of_this_run_are_linked(rig: str, linked: list[str], tmp_path: Path) -> None:
    part = AutopilotPart(load_bench(None, rig=rig, settings=["autopilot.start=false"] if rig != "mock" else []))
    assert part._logs(tmp_path) == []
    old = "autopilot/log/2026-11-23/01_01_01.ulg", "autopilot/logs/00000000.BIN"
    for name in (*linked, *old):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    for name in old:  # of an earlier run in this folder
        os.utime(tmp_path / name, (1.0, 1.0))
    (tmp_path / "autopilot/empty.log").touch()
    part._began_s = 1000.0
    ((heading, html),) = part._logs(tmp_path)
    assert heading == "Logs of the firmware"
    assert [item.split("'")[1] for item in html.split("<li>")[1:]] == linked
