"""Judges whether the timing of a free-running run was good enough for the autopilot's estimator.

In lockstep every command belongs to its tick. A free-running autopilot's latest command is latched and used until the
next one comes: its age adds to the delay of the control loop, and a gap in the stream freezes the motors.

PX4 stamps HIL samples on arrival, so a late sample is an acceleration at the wrong time. Measured: with 2.6 % of the
samples more than 20 ms late PX4 reported "High Accelerometer Bias" and hovered 1.75 m too high, and long stalls ended
in its flight termination. Punctual sending is not enough: a board that is held up reads the samples late, too, which
only the pauses of its commands show. Measured on PX4's HITL code behind a pseudo-terminal, halted 26 times for 90 ms
in a flight of 114 s, with no sample sent more than 20 ms late: 45 pauses, an estimated altitude up to 2.4 m above the
true one, and a flight 4 m too low. Two pauses in the same flight did no harm (0.14 m). The other limits are chosen
well below that, so that the user is warned in time: after a warning the flight's figures are doubtful, after an error
they are not the vehicle's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from firmware_bridge.links.realtime.deadline_schedule import DeadlineSchedule
from firmware_bridge.links.realtime.sender import SendStats
from firmware_bridge.links.timesync import TimeSync
from signals.latency import LatencyHistogram
from signals.time import NS_PER_MS

LATE_SHARE_WARNING = 0.001  # share of samples more than 20 ms late, or never sent
LATE_SHARE_ERROR = 0.01  # 2.6 % did harm (see above)
P999_WARNING_NS = 5 * NS_PER_MS  # more than one period of 250 Hz: samples change their order in time
STALL_WARNING_NS = 50 * NS_PER_MS
STALL_ERROR_NS = 200 * NS_PER_MS
ACTUATOR_AGE_P99_WARNING_NS = 20 * NS_PER_MS  # about 200 Hz is normal: p99 below 10 ms
GAP_SHARE_ERROR = 0.001  # pauses of the commands per tick, one in four seconds: 26 and 45 in a flight did harm
GAPS_NEEDED = 5  # with fewer pauses their share is not judged
MIN_FRAMES = 100  # with fewer frames no share is judged
# PX4 HITL sends at about 200 Hz (p90 of the interval 6.2 ms), so four commands in a row are missing.
GAP_NS = 20 * NS_PER_MS


class ActuatorAge:
    """The age of actuator commands when they move the vehicle, by the receiver's monotonic clock [ns].

    `interval` is from one arrival to the next. A gap is an age of more than `gap_ns`, at an arrival or at a tick, so
    that a stream that stops before the run ends counts too. Time after the last tick does not count.
    """

    def __init__(self, *, gap_ns: int = GAP_NS) -> None:
        self.gap_ns = gap_ns
        self.age = LatencyHistogram()
        self.interval = LatencyHistogram()
        self.gap_count = 0
        self.longest_gap_ns = 0
        self._arrived_ns: int | None = None
        self._counted = False  # True once the gap since the last arrival has been counted

    def arrived(self, t_ns: int) -> None:
        """Count the arrival of a command, which is latched from now on."""
        if self._arrived_ns is not None:
            self.interval.add(t_ns - self._arrived_ns)
            self._note_gap(t_ns - self._arrived_ns)
        self._arrived_ns = t_ns
        self._counted = False

    def used(self, t_ns: int) -> None:
        """Count the use of the latched command, if there is one, by a tick at `t_ns`."""
        if self._arrived_ns is not None:
            self.age.add(t_ns - self._arrived_ns)
            self._note_gap(t_ns - self._arrived_ns)

    def _note_gap(self, length_ns: int) -> None:
        if length_ns > self.gap_ns:
            self.gap_count += not self._counted
            self._counted = True
            self.longest_gap_ns = max(self.longest_gap_ns, length_ns)


@dataclass(frozen=True)
class Finding:
    """One fault in a run's timing, and what to do about it."""

    level: Literal["warning", "error"]
    text: str


@dataclass(frozen=True)
class Punctuality:
    """Timing of the samples sent to a free-running autopilot, and of its motor commands, so far."""

    sent: SendStats
    age: ActuatorAge
    schedule: DeadlineSchedule
    clock: TimeSync
    reconnects: int


def judge_sending(stats: SendStats, schedule: DeadlineSchedule | None = None) -> list[Finding]:
    """Return the findings about the samples' timing, errors first."""
    findings: list[Finding] = []
    lost = stats.dropped + stats.refused
    slips = 0 if schedule is None else schedule.slip_count  # each a gap longer than 20 ms before one sample
    offered = stats.sent + lost
    late = stats.late_20ms + lost + slips
    if offered >= MIN_FRAMES and late / offered > LATE_SHARE_WARNING:
        level: Literal["warning", "error"] = "error" if late / offered > LATE_SHARE_ERROR else "warning"
        findings.append(Finding(level, _late_text(late, offered, lost) + _remedy(stats)))
    longest_ns = stats.longest_gap_ns
    if longest_ns > STALL_WARNING_NS:
        level = "error" if longest_ns > STALL_ERROR_NS else "warning"
        text = f"the samples stopped for {longest_ns / NS_PER_MS:.0f} ms: long stalls end in the autopilot's failsafe"
        findings.append(Finding(level, text + _remedy(stats)))
    p999_ns = stats.lateness.quantile_ns(0.999)
    if stats.sent >= MIN_FRAMES and p999_ns > P999_WARNING_NS and not findings:
        text = f"one sample in a thousand was more than {p999_ns / NS_PER_MS:.1f} ms late (p99.9; good is below 5 ms)"
        findings.append(Finding("warning", text + _remedy(stats)))
    if stats.stalled and offered and stats.stalled / offered > LATE_SHARE_WARNING:
        text = (
            f"{stats.stalled} of {offered} frames met a full line: the link is slower than the stream; "
            "use USB or 921600 baud, and lower the autopilot's telemetry rates"
        )
        findings.append(Finding("warning", text))
    if schedule is not None:
        findings += _judge_schedule(schedule)
    return sorted(findings, key=lambda finding: finding.level != "error")


def judge_actuators(age: ActuatorAge) -> list[Finding]:
    """Return the findings about the commands from the autopilot."""
    findings: list[Finding] = []
    p99_ns = age.age.quantile_ns(0.99)
    if age.age.count >= MIN_FRAMES and p99_ns > ACTUATOR_AGE_P99_WARNING_NS:
        text = (
            f"one tick in a hundred used an actuator command older than {p99_ns / NS_PER_MS:.0f} ms: the control loop "
            "is slower than in flight; use a link that carries about 200 commands per second"
        )
        findings.append(Finding("warning", text))
    if age.gap_count:
        many = age.gap_count >= GAPS_NEEDED and age.gap_count / max(age.age.count, 1) > GAP_SHARE_ERROR
        level: Literal["warning", "error"] = "error" if many else "warning"
        text = (
            f"the actuator commands stopped {age.gap_count} times for more than {age.gap_ns / NS_PER_MS:.0f} ms "
            f"(up to {age.longest_gap_ns / NS_PER_MS:.0f} ms); meanwhile the motors kept their last command. "
            "The board or its line was held up, so it may have read the samples late too and dated them so, which "
            "shifts its altitude (by up to 2.4 m in one measured flight of PX4). Relieve the board (log, telemetry "
            "rates), use a faster link, and do not run a simulated board on a busy computer"
        )
        findings.append(Finding(level, text))
    return findings


def _late_text(late: int, offered: int, lost: int) -> str:
    never = f", {lost} of them never sent" if lost else ""
    return (
        f"{100 * late / offered:.2g} % of the samples were more than 20 ms late ({late} of {offered}{never}); at 2.6 % "
        "PX4 was seen to report High Accelerometer Bias and to hover at a wrong height"
    )


def _remedy(stats: SendStats) -> str:
    if stats.scheduling.startswith("SCHED_FIFO"):
        return "; end other programs on this computer, or use a faster one"
    return f"; the sender ran with {stats.scheduling}"


def _judge_schedule(schedule: DeadlineSchedule) -> list[Finding]:
    if not schedule.slip_count:
        return []
    text = (
        f"the bench could not keep up with the wall clock: {schedule.slip_count} slips, simulated time is "
        f"{schedule.slipped_ns / NS_PER_MS:.0f} ms behind; end other programs, or switch off slow sensors"
    )
    return [Finding("warning", text)]
