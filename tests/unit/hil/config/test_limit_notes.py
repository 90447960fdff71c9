"""Limits that do not judge the vehicle of their bench are told: a plane passed whatever `limits` asked of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.config.checks.limit_notes import limit_notes
from hil.run.bench_run import run_bench

ROOT = Path(__file__).resolve().parents[4]
QUAD, PLANE, VTOL = (ROOT / name for name in ("hil.yaml", "rigs/plane.yaml", "rigs/vtol.yaml"))
RUNWAY, EXPLORE = ROOT / "rigs/benches/runway.yaml", ROOT / "rigs/explore.yaml"
NO_RECORD = ("record={mcap: false, tlog: false, report: false}", "autopilot.transport=loopback")


@pytest.mark.parametrize(
    ("file", "setting", "words"),
    [
        (
            PLANE,
            "limits.max_cross_track_m=2",
            "limits.max_cross_track_m: not judged, the vehicle 'skywalker_x8' is",
        ),
        (PLANE, "limits.final_error_m=null", "limits.final_error_m: not judged"),
        (PLANE, "vtol_limits.transition_loss_m=1", "vtol_limits.transition_loss_m: not judged"),
        (
            QUAD,
            "plane_limits.max_bank_deg=20",
            "plane_limits.max_bank_deg: not judged, the vehicle 'x500' is a mult",
        ),
        (PLANE, "plane_limits.max_bank_deg=20", None),
        (PLANE, "plane_limits.landing_roll_m=10", "plane_limits.landing_roll_m: not judged, the scene 'meadow' has no"),
        (RUNWAY, "plane_limits.landing_roll_m=100", None),
        (EXPLORE, "limits.max_cross_track_m=0.3", "limits.max_cross_track_m: not judged, the bench has no mission"),
        (EXPLORE, "limits.max_cross_track_m=null", None),
        (EXPLORE, "limits.landing_speed_mps=1", None),
        (QUAD, "limits.max_cross_track_m=2", None),
        (VTOL, "limits.final_error_m=2", None),
        (VTOL, "plane_limits.max_bank_deg=20", None),
    ],
)
def test_limits_that_do_not_judge_the_vehicle_are_named(file: Path, setting: str, words: str | None) -> None:
    notes = limit_notes(load_bench(file, settings=(setting,)))
    assert notes == [] if words is None else words in notes[0]


def test_a_run_warns_of_them(tmp_path: Path) -> None:
    bench = load_bench(QUAD, settings=("plane_limits.max_bank_deg=20", "duration_s=1", *NO_RECORD))
    run = run_bench(bench, tmp_path, quiet=True).run
    (note,) = limit_notes(bench)
    assert note in [row["text"] for row in run["warnings"]]
