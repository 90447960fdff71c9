"""A fault that changes nothing is told: its test would pass whatever the fault does."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.config.checks.flight_notes import flight_notes

GUST = "{at_s: 5, velocity_W_mps: [%s, 0, 0], rise_s: 1, fall_s: 1}"


@pytest.mark.parametrize(
    ("key", "entry", "neutral", "other", "words"),
    [
        ("rotors", "{rotor: 1, kind: efficiency, factor: %s, at_s: 5}", 1, 0.9, "efficiency with factor 1"),
        ("sensors", "{sensor: baro, kind: offset, value: %s, at_s: 5}", 0, 5, "offset with value 0"),
        ("sensors", "{sensor: baro, kind: drift, rate_per_s: %s, at_s: 5}", 0, 5, "drift with rate_per_s 0"),
        ("links", "{kind: drop, rate: %s, at_s: 5}", 0, 0.1, "drop with rate 0"),
    ],
)
def test_a_fault_with_neutral_numbers_is_told(key: str, entry: str, neutral: float, other: float, words: str) -> None:
    def notes(value: float) -> list[str]:
        return flight_notes(load_bench(settings=[f"faults.{key}=[{entry % value}]"]))

    assert notes(neutral) == [f"faults.{key}[0]: {words} changes nothing"]
    assert notes(other) == []


def test_a_gust_without_speed_is_told() -> None:
    def notes(speed: str) -> list[str]:
        return flight_notes(load_bench(settings=[f"wind={{gusts: [{GUST % 3}, {GUST % speed}]}}"]))

    assert notes("0") == ["wind.gusts[1]: a gust of 0 m/s changes nothing"]
    assert notes("-1") == []


def test_a_neutral_fault_of_a_script_at_an_event_is_told_with_its_line(tmp_path: Path) -> None:
    """Only those at a time were, which become settings of the bench."""
    action = "  - {after: takeoff, fault: {rotor: 1, kind: efficiency, factor: %s}}\n"
    (tmp_path / "script.yaml").write_text("actions:\n" + action % 0.9 + action % 1)
    bench = load_bench(mission=str(tmp_path / "script.yaml"))
    (note,) = [note for note in flight_notes(bench) if "changes nothing" in note]
    assert note.endswith("script.yaml:3: efficiency with factor 1 changes nothing")
