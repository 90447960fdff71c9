"""Times to wait at the places of a plan, flown by the mock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench

PLAN = """QGC WPL 110
0\t0\t3\t22\t0\t0\t0\t0\t0\t0\t4\t1
1\t0\t3\t19\t30\t0\t0\t0\t0\t0\t4\t1
2\t0\t3\t21\t0\t0\t0\t0\t0\t0\t0\t1
"""
DELAY = PLAN.replace("3\t19", "2\t93")
LEAVES = """
plan: hover.waypoints
actions:
  - {at_s: 14, command: {id: 224, params: [2]}}
"""
VTOL = ["vehicle=quadplane", "scene=meadow", "autopilot.params={NAV_FORCE_VT: 0}"]


@pytest.mark.parametrize(("script", "early"), [("plan: hover.waypoints\n", False), (LEAVES, True)])
@pytest.mark.parametrize(("plan", "place"), [(PLAN, "waypoint 1"), (DELAY, "the top of its take-off")])
@pytest.mark.parametrize(("settings", "height_m"), [([], 4), (VTOL, 8)])
def test_a_hover_that_ends_early_fails(
    plan: str, place: str, settings: list[str], height_m: int, script: str, early: bool, tmp_path: Path
) -> None:
    """Its waypoint was reached, and it landed in its place: that was a PASS, of VTOLs and of delays for longer."""
    (tmp_path / "hover.waypoints").write_text(plan.replace("\t4\t1", f"\t{height_m}\t1"))
    run = flown(script, settings, tmp_path)
    assert run["mission"]["completed"] is not early
    assert [reason.split(" for ")[0] for reason in run["verdict"]["reasons"]] == [f"the vehicle was at {place}"] * early
    assert all(reason.endswith("waits there for 30 s, 28 s are enough") for reason in run["verdict"]["reasons"])


def test_a_plan_that_need_not_be_completed_need_not_wait(tmp_path: Path) -> None:
    (tmp_path / "hover.waypoints").write_text(PLAN)
    run = flown(LEAVES + "outcome: any\n", [], tmp_path)
    assert (run["mission"]["completed"], run["verdict"]["reasons"]) == (False, [])


def flown(script: str, settings: list[str], folder: Path) -> dict[str, Any]:
    """Return run.json of a script that is flown by the mock."""
    (folder / "flight.yaml").write_text(script)
    record = [f"record.{key}=false" for key in ("mcap", "tlog", "report")]
    settings = ["autopilot.transport=loopback", *record, *settings]
    bench = load_bench(rig="mock", mission=str(folder / "flight.yaml"), settings=settings)
    return run_bench(bench, folder / "out", quiet=True).run
