"""Twenty unmapped villages with the shipped bench and SLAM: goal reached, clearance kept, no long detours."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench

BENCH = Path(__file__).resolve().parents[2] / "rigs" / "explore.yaml"
QUICK = ("autopilot.transport=loopback", "record={mcap: false, tlog: false}")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 21))
def test_the_goal_in_an_unmapped_village_is_reached(seed: int, tmp_path: Path) -> None:
    bench = load_bench(BENCH, seed=seed, settings=(f"map_seed={seed}", *QUICK))
    run = run_bench(bench, tmp_path, quiet=True).run
    assert run["status"] == "PASS", (run["error"], run["verdict"]["reasons"])
    assert run["goal"]["outcome"] == "goal"
