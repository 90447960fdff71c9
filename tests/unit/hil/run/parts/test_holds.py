"""Times to wait at the waypoints of a plan, flown by the mock."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench

PLAN = """QGC WPL 110
0\t0\t3\t22\t0\t0\t0\t0\t0\t0\t4\t1
1\t0\t3\t19\t30\t0\t0\t0\t0\t0\t4\t1
2\t0\t3\t21\t0\t0\t0\t0\t0\t0\t0\t1
"""
LEAVES = """
plan: hover.waypoints
actions:
  - {at_s: 14, command: {id: 224, params: [2]}}
"""


@pytest.mark.parametrize(
    ("script", "reasons"),
    [
        ("plan: hover.waypoints\n", []),
        (LEAVES, ["the vehicle was at waypoint 1 for 9.4 s; the plan waits there for 30 s, 28 s are enough"]),
        (LEAVES + "outcome: any\n", []),
    ],
)
def test_a_hover_that_ends_early_fails(script: str, reasons: list[str], tmp_path: Path) -> None:
    """Its waypoint was reached, and it landed in its place: that was a PASS."""
    (tmp_path / "hover.waypoints").write_text(PLAN)
    (tmp_path / "flight.yaml").write_text(script)
    record = [f"record.{key}=false" for key in ("mcap", "tlog", "report")]
    bench = load_bench(
        rig="mock", mission=str(tmp_path / "flight.yaml"), settings=["autopilot.transport=loopback", *record]
    )
    run = run_bench(bench, tmp_path / "out", quiet=True).run
    assert run["verdict"]["reasons"] == reasons
    assert run["mission"]["completed"] == (script == "plan: hover.waypoints\n")
