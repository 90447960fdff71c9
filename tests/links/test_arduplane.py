"""The start of a plane's mission on ArduPlane, with a stand-in, and on the user's own build of it.

The stand-in does not steer: the launched plane comes down at once. `HIL_ARDUPLANE` names a real build.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench
from tests.worlds import fake_arducopter

PLANE = Path(__file__).parents[2] / "rigs/plane.yaml"
REAL = os.environ.get("HIL_ARDUPLANE")
SET_MODE, ARM, MISSION_START = 176, 400, 300
AUTO = 10


def fly(folder: Path, program: Path, *settings: str) -> dict[str, Any]:
    """Return run.json of the plane's bench."""
    quiet = ("record.mcap=false", "record.tlog=false", "record.report=false", f"autopilot.binary='{program}'")
    bench = load_bench(PLANE, rig="ardupilot_sitl", settings=[*quiet, *settings])
    return run_bench(bench, folder / "out", quiet=True).run


def test_arduplane_arms_in_auto_and_the_launcher_waits_for_it(tmp_path: Path) -> None:
    """The place-holders of its boot, half throttle on the motor's output, release no catapult."""
    run = fly(tmp_path, fake_arducopter.install(tmp_path, kind="1"), "duration_s=30")
    commands = json.loads((tmp_path / "out/autopilot/commands.json").read_text())
    begun = [command for command in commands if command[0] in (SET_MODE, ARM, MISSION_START)]
    assert begun == [[SET_MODE, 1.0, AUTO], [ARM, 1.0, 0.0]]
    assert (run["status"], run["error"]) == ("FAIL", None)
    assert run["sim_s"] > 7.0  # five seconds without a report of its pre-arm check, then the start
    assert any("crashed" in reason or "reached 0 of 4" in reason for reason in run["verdict"]["reasons"])
    parameters = (tmp_path / "out/autopilot/bench.parm").read_text()
    assert "SERVO1_FUNCTION 70" in parameters


def test_an_arducopter_that_answers_for_a_plane_is_told(tmp_path: Path) -> None:
    run = fly(tmp_path, fake_arducopter.install(tmp_path), "duration_s=30")
    assert (run["status"], run["error"]["type"]) == ("ERROR", "HandshakeError")
    assert "the autopilot is ArduCopter (MAV_TYPE_QUADROTOR in its heartbeat)" in run["error"]["message"]
    assert "needs ArduPlane: start that one" in run["error"]["message"]


@pytest.mark.slow
@pytest.mark.skipif(REAL is None, reason="HIL_ARDUPLANE names no build of ArduPlane")
def test_a_real_arduplane_flies_the_circuit(tmp_path: Path) -> None:
    run = fly(tmp_path, Path(str(REAL)))
    assert (run["status"], run["error"]) == ("PASS", None)
    assert run["mission"]["reached"] == run["mission"]["waypoints"]
