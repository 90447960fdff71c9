"""The mock in HITL flown in real time over a wire with declared faults: it flies well, or ends with a named error.

The flights run in real time, so all of them run at once, each in a process of its own, and the tests examine their
results. In each flight 1 % of the units are hit on the way up, and 10 % of them on the way.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.patience import PATIENCE_S

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 2 * PATIENCE_S
KINDS = ("drop", "delay", "duplicate", "reorder", "corrupt")

# Up, four metres north, down: 27 s.
HOP = """QGC WPL 110
0	1	0	16	0	0	0	0	47.39774200	8.54559400	488.0	1
1	0	3	22	0	0	0	0	47.39774200	8.54559400	3.0	1
2	0	3	16	0	0	0	0	47.39774200	8.54559400	3.0	1
3	0	3	16	0	0	0	0	47.39777800	8.54559400	3.0	1
4	0	3	21	0	0	0	0	47.39777800	8.54559400	0.0	1
"""


def rated(kind: str, **more: Any) -> list[dict[str, Any]]:
    """Return the fault at both rates: 1 % from boot to take-off, 10 % in the air."""
    held = {"delay_s": 0.01} if kind == "delay" else {}
    fault = {"kind": kind, **held, **more}
    return [fault | {"at_s": 0, "for_s": 8, "rate": 0.01}, fault | {"at_s": 8, "for_s": 8, "rate": 0.1}]


STALLS = [{"kind": "stall", "at_s": 10, "for_s": 0.1, "direction": way} for way in ("to_autopilot", "from_autopilot")]
IN_THE_AIR_S = 14.0
LOSSES = rated("drop") + rated("corrupt")
FLIGHTS: dict[str, list[dict[str, Any]]] = {
    "lossy": LOSSES,
    "stall for good": [{"kind": "stall", "at_s": 5, "direction": "from_autopilot"}],
    "unplug": [{"kind": "unplug", "at_s": 5, "for_s": 1}],
}
MORE_FLIGHTS = {"lossy": LOSSES, "disorderly": rated("delay") + rated("duplicate") + rated("reorder"), "stall": STALLS}


def fly(flights: dict[str, list[dict[str, Any]]], folder: Path, duration_s: float = 120.0) -> dict[str, dict[str, Any]]:
    """Fly all at once and return the run.json of each."""
    (folder / "hop.waypoints").write_text(HOP)
    (folder / "bench.yaml").write_text("")
    started = {}
    for number, (name, faults) in enumerate(flights.items()):
        code = (
            "import sys, pathlib\n"
            "from hil.run.bench_run import run_bench\n"
            "from hil.config import load_bench\n"
            "bench, mission, out, *settings = sys.argv[1:]\n"
            "loaded = load_bench(bench, rig='mock_hitl', mission=mission, settings=settings)\n"
            "run_bench(loaded, pathlib.Path(out), quiet=True)\n"
        )
        out = folder / str(number)
        settings = ("record.mcap=false", "record.tlog=false", "record.report=false", f"duration_s={duration_s}")
        argv = [sys.executable, "-c", code, "bench.yaml", "hop.waypoints", str(out), *settings]
        env = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
        started[name] = (
            out,
            subprocess.Popen(
                [*argv, f"faults.links={json.dumps(faults)}"], cwd=folder, env=env, stderr=subprocess.PIPE, text=True
            ),
        )
    runs = {}
    try:
        for name, (out, child) in started.items():
            _, said = child.communicate(timeout=LIMIT_S)
            assert child.returncode == 0, said
            runs[name] = json.loads((out / "run.json").read_text())
    finally:
        for _, child in started.values():
            if child.poll() is None:
                child.kill()
                child.communicate()
    return runs


def kept_pace(run: dict[str, Any]) -> bool:
    """Return True if bench and mock kept real time on this machine, so that the flight's figures are meaningful."""
    timing, answered_us = run["autopilot"]["realtime"], run["autopilot"]["rtt_us"]["p99"]
    sent = timing["slips"] == 0 and timing["late_20ms"] == 0 and timing["longest_gap_ms"] < 50.0
    return sent and answered_us is not None and answered_us < 50_000


def judge(run: dict[str, Any], *, hit_at_least: int) -> None:
    """Check that it flew within its limits or ended with a named error."""
    assert run["status"] in ("PASS", "FAIL", "ERROR")
    hits = [fault["hits"] for fault in run["faults"]["links"]]
    # A run that ended early may not have reached the later fault.
    assert all(hit >= hit_at_least for hit in (hits[::2] if run["error"] else hits)), hits
    if run["status"] == "ERROR":
        assert run["error"]["type"] in ("LinkError", "LinkClosed", "HandshakeError", "ModelRangeError"), run["error"]
    elif run["status"] == "FAIL":
        assert not kept_pace(run), run["verdict"]


def check_losses(run: dict[str, Any]) -> None:
    judge(run, hit_at_least=20)
    if kept_pace(run):
        assert run["status"] == "PASS", (run["error"], run["verdict"])
        assert run["mission"]["reached"] == run["mission"]["waypoints"]


def test_losses_are_survived_and_a_stall_for_good_and_a_pulled_plug_are_named(tmp_path: Path) -> None:
    """One test, because the flights are at the same time."""
    runs = fly(FLIGHTS, tmp_path, IN_THE_AIR_S)
    lossy, stalled, unplugged = (runs[name] for name in FLIGHTS)
    hits = [fault["hits"] for fault in lossy["faults"]["links"]]
    assert min(hits[::2] if lossy["error"] else hits) >= 20, hits
    if kept_pace(lossy):
        assert lossy["error"] is None
        assert lossy["mission"]["reached"] >= 1  # the take-off
    link = lossy["autopilot"]["link"]
    assert link["lost_frames"] > 0
    assert link["bad_crc"] > 0
    assert (stalled["error"]["type"], stalled["error"]["cause"]) == ("LinkError", "silent")
    assert unplugged["error"]["type"] == "LinkClosed"
    assert "unplugged by the declared link fault 0 at 5 s" in unplugged["error"]["message"]
    assert unplugged["sim_s"] == pytest.approx(5.0, abs=0.01)


@pytest.mark.slow
def test_losses_disorder_and_a_short_stall_are_flown_through(tmp_path: Path) -> None:
    runs = fly(MORE_FLIGHTS, tmp_path)
    check_losses(runs["lossy"])
    check_losses(runs["disorderly"])
    judge(runs["stall"], hit_at_least=1)
