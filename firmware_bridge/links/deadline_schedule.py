"""When each tick's frame is due on the wall clock, for an autopilot that does not wait.

    deadline_k = origin + k * period        absolute, so that errors of one tick never add up to the next
    due_k      = deadline_k - lead          when the producer begins to prepare tick k

A producer that falls behind makes up for it with the ticks that follow, up to `slip_ns`. Beyond that the origin is
moved to where the producer is (a slip, recorded): a burst of stale samples would tell the autopilot, which stamps
samples on arrival, of a motion that never was. Each slip leaves simulated time that much further behind the wall clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from hil.signals.latency import LatencyHistogram
from hil.signals.time import NS_PER_MS, NS_PER_S

SLIP_NS = 20 * NS_PER_MS
_SLIPS_KEPT = 256


class Slip(NamedTuple):
    """The schedule was moved by `moved_ns` before `tick`, which was then due at `due_ns` of the wall clock."""

    tick: int
    due_ns: int
    moved_ns: int


class DeadlineSchedule:
    """Deadlines of ticks 0, 1, 2, ... in nanoseconds of `clock_ns`. The first `wait_until_due` starts the schedule.

    Per tick: `wait_until_due`, prepare the frame, hand it over with the deadline returned, `note_handed_over`.
    """

    def __init__(
        self,
        *,
        period_ns: int,
        lead_ns: int,
        slip_ns: int = SLIP_NS,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        sleep_s: Callable[[float], None] = time.sleep,
    ) -> None:
        if period_ns <= 0 or lead_ns < 0 or slip_ns <= 0:
            raise ValueError(f"period {period_ns} and slip {slip_ns} must be above 0 ns, lead {lead_ns} not below")
        self.period_ns = period_ns
        self.lead_ns = lead_ns
        self.slip_ns = slip_ns
        self.slips: list[Slip] = []  # the first ones; `slip_count` has them all
        self.slip_count = 0
        self.slipped_ns = 0
        self.longest_slip_ns = 0
        self.lead_left = LatencyHistogram()  # time left to the deadline when a frame was handed over in time
        self.overdue = LatencyHistogram()  # time since the deadline when it was not
        self._clock_ns = clock_ns
        self._sleep_s = sleep_s
        self._origin_ns: int | None = None

    def deadline_ns(self, tick: int) -> int:
        """Deadline of `tick` as the schedule stands now. ValueError before it has started."""
        if self._origin_ns is None:
            raise ValueError("the schedule has not started: call wait_until_due first")
        return self._origin_ns + tick * self.period_ns

    def wait_until_due(self, tick: int) -> int:
        """Sleep until the lead before the deadline of `tick`; its deadline. Slips first if that is long past."""
        now_ns = self._clock_ns()
        if self._origin_ns is None:
            self._origin_ns = now_ns + self.lead_ns - tick * self.period_ns
        deadline_ns = self.deadline_ns(tick)
        due_ns = deadline_ns - self.lead_ns
        behind_ns = now_ns - due_ns
        if behind_ns > self.slip_ns:
            self._slip(tick, now_ns, behind_ns)
            return deadline_ns + behind_ns
        while now_ns < due_ns:
            self._sleep_s((due_ns - now_ns) / NS_PER_S)
            now_ns = self._clock_ns()
        return deadline_ns

    def _slip(self, tick: int, now_ns: int, behind_ns: int) -> None:
        assert self._origin_ns is not None
        self._origin_ns += behind_ns
        self.slip_count += 1
        self.slipped_ns += behind_ns
        self.longest_slip_ns = max(self.longest_slip_ns, behind_ns)
        if len(self.slips) < _SLIPS_KEPT:
            self.slips.append(Slip(tick, now_ns, behind_ns))

    def note_handed_over(self, tick: int) -> None:
        """The frame of `tick` has just been handed to whoever sends it: count how much of the lead was left."""
        left_ns = self.deadline_ns(tick) - self._clock_ns()
        if left_ns >= 0:
            self.lead_left.add(left_ns)
        else:
            self.overdue.add(-left_ns)
