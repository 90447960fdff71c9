"""Deadlines on a wall clock that only the test advances."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_bridge.links.realtime.deadline_schedule import DeadlineSchedule

PERIOD = 4_000_000
LEAD = 3_000_000


class Clock:
    """A clock whose sleeps last exactly as long as asked, plus `overshoot_ns`."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000
        self.overshoot_ns = 0
        self.slept: list[float] = []

    def __call__(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now_ns += round(seconds * 1e9) + self.overshoot_ns


def schedule(clock: Clock, **settings: Any) -> DeadlineSchedule:
    return DeadlineSchedule(**{"period_ns": PERIOD, "lead_ns": LEAD, **settings}, clock_ns=clock, sleep_s=clock.sleep)


def test_deadlines_are_absolute_whatever_the_sleeps_do() -> None:
    clock = Clock()
    clock.overshoot_ns = 70_001
    plan = schedule(clock)
    start = clock.now_ns
    for k in range(1000):
        deadline = plan.wait_until_due(k)
        assert deadline == start + LEAD + k * PERIOD == plan.deadline_ns(k)
        assert deadline - LEAD <= clock.now_ns <= deadline - LEAD + clock.overshoot_ns
        clock.now_ns += 150_000
    assert len(clock.slept) == 999
    assert plan.slip_count == 0


def test_behind_by_up_to_the_limit_it_keeps_its_deadlines() -> None:
    clock = Clock()
    plan = schedule(clock)
    first = plan.wait_until_due(0)
    clock.now_ns = first - LEAD + PERIOD + 20_000_000
    for k in range(1, 6):
        assert plan.wait_until_due(k) == first + k * PERIOD
    assert plan.slip_count == 0
    assert clock.slept == []
    # Tick 6 begins on time again.
    plan.wait_until_due(7)
    assert len(clock.slept) == 1


def test_behind_by_more_it_slips_once_and_sends_no_burst() -> None:
    clock = Clock()
    told: list[int] = []
    plan = schedule(clock, on_slip=told.append)
    first = plan.wait_until_due(0)
    clock.now_ns = first - LEAD + PERIOD + 100_000_000
    stalled_until = clock.now_ns
    assert plan.wait_until_due(1) == stalled_until + LEAD
    assert (told, plan.slip_count, plan.slipped_ns) == ([100_000_000], 1, 100_000_000)
    for k in range(2, 10):
        assert plan.wait_until_due(k) == stalled_until + LEAD + (k - 1) * PERIOD
        assert clock.now_ns == stalled_until + (k - 1) * PERIOD, "one tick per period, no burst"
    assert plan.slip_count == 1


def test_a_sleep_cut_short_is_continued() -> None:
    clock = Clock()

    def half(seconds: float) -> None:
        clock.now_ns += max(1, round(seconds * 5e8))

    plan = DeadlineSchedule(period_ns=PERIOD, lead_ns=LEAD, clock_ns=clock, sleep_s=half)
    plan.wait_until_due(0)
    assert clock.now_ns <= plan.wait_until_due(1) - LEAD + 1


def test_it_may_start_at_any_tick_and_refuses_invalid_arguments() -> None:
    clock = Clock()
    plan = schedule(clock)
    with pytest.raises(ValueError, match="not started"):
        plan.deadline_ns(0)
    assert plan.wait_until_due(500) == clock.now_ns + LEAD
    for wrong in ({"period_ns": 0}, {"lead_ns": -1}):
        with pytest.raises(ValueError, match="must be above 0"):
            schedule(clock, **wrong)
