"""Faults injected into the link to a companion."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from firmware_bridge.faults.companion_fault import CompanionFault
from hil.run.companion.link_faults import CompanionFaults
from tests.worlds.simulated_time import SimulatedTime

S = 1_000_000_000


def made(wall: SimulatedTime | None = None) -> tuple[CompanionFaults, list[Any]]:
    events: list[Any] = []
    faults = CompanionFaults(
        3, lambda *event: events.append(event), lambda *client: events.append(client), wall_ns=wall or SimulatedTime()
    )
    return faults, events


def test_the_same_seed_loses_the_same_frames_at_the_rate_asked_for() -> None:
    lost = []
    for _ in range(2):
        faults, _ = made()
        faults.inject(CompanionFault(kind="drop", client="explore", at_s=1.0, rate=0.25, for_s=10.0), S)
        lost.append([k for k in range(4000) if faults.lose("explore", k)])
        assert not any(faults.lose("other", k) for k in range(300))
    assert lost[0] == lost[1]
    assert len(lost[0]) == pytest.approx(1000, abs=4 * (4000 * 0.25 * 0.75) ** 0.5)


def test_a_drop_ends_in_simulated_time_and_counts_the_lost_frames() -> None:
    faults, events = made()
    faults.inject(CompanionFault(kind="drop", client="a", at_s=1.0, rate=1.0, for_s=2.0), S)
    assert [faults.lose("a", k) for k in range(3)] == [True] * 3
    faults.step(3 * S - 1)
    assert faults.lose("a", 3)
    faults.step(3 * S)
    assert not faults.lose("a", 4)
    assert events[-1] == (3 * S, "fault", "companion a: drop is over, 4 frames lost")


def test_a_late_answer_is_not_overtaken() -> None:
    faults, _ = made()
    assert faults.delayed("a", 5 * S) == 5 * S
    faults.inject(CompanionFault(kind="delay", client="a", at_s=5.0, delay_s=0.5, for_s=1.0), 5 * S)
    assert faults.delayed("a", 5 * S) == 5 * S + S // 2
    assert faults.delayed("b", 5 * S) == 5 * S
    faults.step(6 * S)
    assert faults.delayed("a", 5 * S + S // 10) == 5 * S + S // 2  # does not overtake the one before
    assert faults.delayed("a", 6 * S) == 6 * S
    assert faults.delayed("a", 6 * S + 1) == 6 * S + 1


@pytest.mark.parametrize("by_wall", [True, False])
def test_an_unplug_ends_by_either_clock(by_wall: bool) -> None:
    wall = SimulatedTime()
    faults, events = made(wall)
    faults.inject(CompanionFault(kind="unplug", client="a", at_s=1.0, for_s=2.0), S)
    assert ("a", "unplugged by an injected fault") in events
    assert faults.unplugged("a")
    assert not faults.unplugged("b")
    wall.now_ns = 2 * S if by_wall else 1
    faults.step(S if by_wall else 3 * S)
    assert not faults.unplugged("a")


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "drop"},
        {"kind": "delay", "rate": 0.5, "delay_s": 0.1},
        {"kind": "unplug", "delay_s": 0.1},
        {"kind": "melt"},
        {"kind": "drop", "rate": 1.5},
        {"kind": "drop", "rate": 0.5, "for_s": 0.0},
        {"kind": "drop", "rate": True},
    ],
)
def test_invalid_faults_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        CompanionFault.model_validate({"client": "a", "at_s": 1.0, **wrong})
