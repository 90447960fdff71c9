"""A mission that its bench ends before, or calls a flight away, is told of before it is flown."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.config.checks.far_notes import far_notes

ROOT = Path(__file__).resolve().parents[4]
TAKE_OFF = "0 1 3 22 0 0 0 0 47.397742 8.545594 10 1"
FAR = "1 0 3 16 0 0 0 0 48.1 8.55 50 1"
WAITS = "1 0 3 16 1e4 0 0 0 47.3981 8.5456 10 1"
LOITER = "1 0 3 18 1 0 -1600 0 47.3981 8.56 50 1"


def notes(path: Path, bench: str, *items: str, **settings: str) -> list[str]:
    path.write_text("\n".join(["QGC WPL 110", *items]))
    return far_notes(load_bench(ROOT / bench, mission=str(path), settings=[f"{k}={v}" for k, v in settings.items()]))


@pytest.mark.parametrize(
    ("item", "words"),
    [
        (FAR, "mission: 78.1 km takes at least 781 s (100 m/s), but the flight ends at duration_s (600 s)"),
        (WAITS, "with 10000 s of waiting takes at least 10001 s (100 m/s), but the flight ends at duration_s (600 s)"),
    ],
)
def test_a_mission_that_takes_longer_than_the_flight_is_told(item: str, words: str, tmp_path: Path) -> None:
    (note,) = notes(tmp_path / "m.waypoints", "hil.yaml", TAKE_OFF, item)
    assert note.endswith(words)
    assert notes(tmp_path / "m.waypoints", "hil.yaml", TAKE_OFF, item, duration_s="20000") == []


def test_a_circle_wider_than_the_flight_may_go_is_told(tmp_path: Path) -> None:
    path = tmp_path / "m.waypoints"
    (note,) = notes(path, "rigs/plane.yaml", TAKE_OFF, LOITER)
    assert ":3: item 1 has the loiter radius 1600 m: farther from the plan than fly_away_m (1500 m) allows" in note
    assert notes(path, "rigs/plane.yaml", TAKE_OFF, LOITER, fly_away_m="2000") == []
    assert notes(path, "rigs/plane.yaml", TAKE_OFF, LOITER, fly_away_m="null") == []


@pytest.mark.parametrize("bench", ["hil.yaml", "rigs/plane.yaml", "rigs/vtol.yaml"])
def test_a_shipped_bench_has_no_such_note(bench: str) -> None:
    assert far_notes(load_bench(ROOT / bench)) == []
