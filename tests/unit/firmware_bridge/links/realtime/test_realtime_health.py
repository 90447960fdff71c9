"""Age of actuator commands, and the findings about a run's timing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

import pytest

from firmware_bridge.links.autopilot_link import LinkCaps
from firmware_bridge.links.px4.free_running import FreeRunningLink
from firmware_bridge.links.realtime.deadline_schedule import DeadlineSchedule
from firmware_bridge.links.realtime.health import ActuatorAge, judge_actuators, judge_sending
from firmware_bridge.links.realtime.sender import SendStats
from firmware_bridge.transports.pty import PtyTransport

MS = 1_000_000
CAPS = LinkCaps("px4_hitl", lockstep=False, deterministic=False, boot_sensors=0)


def stats(lateness_ns: Iterable[int], *, scheduling: str = "SCHED_FIFO 80, memory locked", **counts: int) -> SendStats:
    found = SendStats(longest_gap_ns=counts.pop("longest_gap_ns", 4 * MS), scheduling=scheduling, **counts)
    for each in lateness_ns:
        found.count_lateness(each)
        found.sent += 1
    return found


GOOD = [60_000] * 10_000


def test_good_timing_has_no_findings() -> None:
    assert judge_sending(stats(GOOD)) == []
    assert judge_sending(stats([])) == []
    # One late sample in 10 000, as on every computer: below all limits.
    assert judge_sending(stats([*GOOD, 21 * MS])) == []


@pytest.mark.parametrize(
    ("late", "level"), [(10, None), (11, "warning"), (100, "warning"), (102, "error"), (260, "error")]
)
def test_share_of_harmfully_late_samples(late: int, level: str | None) -> None:
    findings = judge_sending(stats([60_000] * (10_000 - late) + [25 * MS] * late))
    text = [f for f in findings if "more than 20 ms late" in f.text]
    assert [f.level for f in text] == ([] if level is None else [level])
    if level:
        assert f"({late} of 10000)" in text[0].text
        assert "High Accelerometer Bias" in text[0].text


def test_samples_never_sent_count_as_late() -> None:
    (finding,) = judge_sending(stats(GOOD, dropped=150, refused=50))
    assert finding.level == "error"
    assert "200 of 10200, 200 of them never sent" in finding.text


@pytest.mark.parametrize(("ms", "level"), [(49, None), (60, "warning"), (250, "error")])
def test_one_long_stall(ms: int, level: str | None) -> None:
    assert [f.level for f in judge_sending(stats([*GOOD, ms * MS], longest_gap_ns=ms * MS))] == (
        [] if level is None else [level]
    )


def test_p999_is_judged_below_the_harmful_limit() -> None:
    (finding,) = judge_sending(stats([60_000] * 9_900 + [7 * MS] * 100))
    assert finding.level == "warning"
    assert "p99.9" in finding.text


def test_the_remedy_depends_on_the_scheduling_that_was_granted() -> None:
    late = [25 * MS] * 100
    refused = "normal scheduling (no permission for SCHED_FIFO 80: to get it, add ...), memory not locked"
    assert any(refused in f.text for f in judge_sending(stats(late, scheduling=refused)))
    assert all("end other programs" in f.text for f in judge_sending(stats(late)))


def test_a_full_line_is_named() -> None:
    (finding,) = judge_sending(stats(GOOD, stalled=20))
    assert "921600" in finding.text


def _schedule_behind_by(ns: int) -> DeadlineSchedule:
    now = [0]
    clock: Callable[[], int] = lambda: now[0]  # noqa: E731
    schedule = DeadlineSchedule(period_ns=4 * MS, lead_ns=0, clock_ns=clock, sleep_s=lambda s: None)
    schedule.wait_until_due(0)
    now[0] = 4 * MS + ns
    schedule.wait_until_due(1)
    return schedule


def test_a_slip_is_a_gap_in_the_samples_though_none_was_late() -> None:
    assert judge_sending(stats(GOOD), _schedule_behind_by(19 * MS)) == []
    (finding,) = judge_sending(stats(GOOD), _schedule_behind_by(30 * MS))
    assert "1 slips, simulated time is 30 ms behind" in finding.text
    findings = judge_sending(stats(GOOD, longest_gap_ns=304 * MS), _schedule_behind_by(300 * MS))
    assert [f.level for f in findings] == ["error", "warning"]
    assert "304 ms" in findings[0].text


def test_age_of_a_regular_stream() -> None:
    age = ActuatorAge()
    age.used(0)  # no command yet
    arrivals = [(k * 5 * MS, age.arrived) for k in range(1, 401)]  # 200 Hz
    ticks = [(k * 4 * MS + 1 * MS, age.used) for k in range(1, 500)]  # 250 Hz
    for t, happens in sorted(arrivals + ticks, key=lambda event: event[0]):
        happens(t)
    # Ticks at 4k+1 ms: ages cycle through 0, 4, 3, 2, 1 ms; every fifth tick uses the command of the tick before it.
    assert age.age.count == 499
    assert age.age.max_ns == 4 * MS
    assert age.age.total_ns == sum((4 * k + 1) % 5 for k in range(1, 500)) * MS
    assert age.interval.quantile_ns(0.5) == pytest.approx(5 * MS, rel=0.02)
    assert age.gap_count == 0
    assert judge_actuators(age) == []


def test_gaps_and_the_silence_at_the_end() -> None:
    age = ActuatorAge()
    for t in (0, 1, 2, 25, 30):
        age.arrived(t * MS)
    assert (age.gap_count, age.longest_gap_ns) == (1, 23 * MS)
    for tick_ms in range(31, 132, 4):
        age.used(tick_ms * MS)
    (finding,) = judge_actuators(age)
    assert "2 times for more than 20 ms (up to 101 ms)" in finding.text
    assert age.gap_count == 2


def test_reading_the_findings_twice_or_late_adds_no_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recording and run.json read the findings one after the other, after the wires are closed."""
    now_ns = [0]
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns[0])
    link = FreeRunningLink(PtyTransport(), CAPS, period_ns=4 * MS)
    for now_ns[0] in range(0, 400 * MS, 4 * MS):
        link.age.arrived(now_ns[0])
        link.age.used(now_ns[0])
    now_ns[0] += 500 * MS  # of closing
    assert [link.findings() for _ in range(2)] == [[], []]
    assert link.age.gap_count == 0


def test_old_commands_are_a_warning() -> None:
    age = ActuatorAge(gap_ns=10**12)
    for k in range(200):
        age.arrived(k * 30 * MS)
        age.used(k * 30 * MS + 25 * MS)
    (finding,) = judge_actuators(age)
    assert "older than 25 ms" in finding.text


def test_many_pauses_of_the_commands_spoil_a_flight_whose_samples_were_punctual() -> None:
    """PX4, halted 26 times for 90 ms in 114 s, estimated its altitude 2.4 m wrong: 45 pauses in 28,500 ticks."""
    for pauses, level in ((2, "warning"), (45, "error")):
        age = ActuatorAge()
        every = 28_500 // pauses
        for tick in range(28_500):
            if tick % every >= 15 or tick < 15:  # a pause: 15 ticks without a command
                age.arrived(tick * 4 * MS)
            age.used(tick * 4 * MS)
        assert age.gap_count in (pauses - 1, pauses)
        gaps = [finding for finding in judge_actuators(age) if "the actuator commands stopped" in finding.text]
        assert [finding.level for finding in gaps] == [level]
        assert "in one measured flight of PX4" in gaps[0].text
