"""A vehicle that leaves its plan for good ends its flight as FAIL, each vehicle by its own plan."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.parts.judges import fly_away
from hil.run.parts.judges.fly_away import FlyAwayPart, distance_m

SHORT = ["autopilot.transport=loopback", "record.mcap=false", "record.tlog=false", "record.report=false"]

PLAN = """QGC WPL 110
0	1	0	16	0	0	0	0	47.39774200	8.54559400	488.0	1
1	0	3	22	0	0	0	0	47.39774200	8.54559400	15.0	1
2	0	3	16	0	0	0	0	47.39828200	8.54559400	15.0	1
3	0	3	21	0	0	0	0	47.39828200	8.54559400	0.0	1
"""


def test_distance_to_the_nearest_leg() -> None:
    starts = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 10.0], [0.0, 0.0, 0.0]])
    ends = np.array([[0.0, 0.0, 10.0], [1000.0, 0.0, 10.0], [0.0, 0.0, 0.0]])
    assert distance_m((500.0, 3.0, 14.0), starts, ends) == pytest.approx(5.0)
    assert distance_m((1300.0, 0.0, 410.0), starts, ends) == pytest.approx(500.0)
    assert distance_m((-3.0, 4.0, 0.0), starts, ends) == pytest.approx(5.0)


def test_it_ends_at_the_first_place_beyond_the_limit_though_few_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    measured: list[float] = []

    def counted(*arguments: Any) -> float:
        measured.append(distance_m(*arguments))
        return measured[-1]

    monkeypatch.setattr(fly_away, "distance_m", counted)
    generator = np.random.default_rng(5)
    legs = [SimpleNamespace(start_W=(0.0, 0.0, 0.0), end_W=(40.0, 0.0, 20.0))]
    lines = (np.array([[0.0, 0.0, 0.0], legs[0].start_W]), np.array([[0.0, 0.0, 0.0], legs[0].end_W]))
    looks = 0
    for _ in range(20):
        places = np.cumsum(generator.normal(0.0, 3.0, (2000, 3)), axis=0).tolist()
        scheduler = SimpleNamespace(truth=None)
        event = lambda kind, text: None  # noqa: E731
        run: Any = SimpleNamespace(
            physics=SimpleNamespace(state=np.zeros(13)), legs=legs, scheduler=scheduler, event=event
        )
        part = FlyAwayPart(60.0, None, 4_000_000)
        part.begin(run)
        for k, place in enumerate(places):
            scheduler.truth = SimpleNamespace(p_WB=tuple(place), t_ns=k)
            part.after_tick(k)
            looks += 1
            assert part.ended() == (distance_m(tuple(place), *lines) > 60.0), k
            if part.ended():
                break
    assert 20 < len(measured) < looks / 4


def test_a_drifting_vehicle_ends_its_flight(tmp_path: Path) -> None:
    """Without GPS the mock descends level, and the wind takes it along."""
    (tmp_path / "hop.waypoints").write_text(PLAN)
    (tmp_path / "bench.yaml").write_text(
        "tick_hz: 100\nmission: hop.waypoints\nwind: {steady_W_mps: [8, 0, 0]}\n"
        "faults: {sensors: [{kind: dropout, sensor: gps, at_s: 12}]}\n"
    )

    def fly(limit: str) -> dict[str, Any]:
        bench = load_bench(tmp_path / "bench.yaml", settings=[*SHORT, f"fly_away_m={limit}"])
        return run_bench(bench, tmp_path / "out", quiet=True).run

    away = fly("8")
    reasons = [reason for reason in away["verdict"]["reasons"] if reason.startswith("flew away: ")]
    assert away["status"] == "FAIL"
    assert len(reasons) == 1
    assert "m from its start and its plan after" in reasons[0]
    assert "fly_away_m allows 8 m" in reasons[0]
    free = fly("null")
    assert free["sim_s"] > away["sim_s"] + 5.0
    assert not any(reason.startswith("flew away") for reason in free["verdict"]["reasons"])
