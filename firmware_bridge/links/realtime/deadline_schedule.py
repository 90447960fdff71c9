"""The wall-clock deadline of each tick's frame, for an autopilot that does not wait.

    deadline_k = origin + k * period        absolute, so that the error of one tick is not passed to the next
    due_k      = deadline_k - lead          the producer begins to prepare tick k

A producer that falls behind by up to 20 ms catches up in the following ticks. Beyond that the origin moves to the
present (a slip): the autopilot stamps samples on arrival, so a burst of stale samples would show it a motion that never
happened. Each slip leaves simulated time that much further behind the wall clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from signals.time import NS_PER_MS, NS_PER_S

SLIP_NS = 20 * NS_PER_MS


class DeadlineSchedule:
    """Deadlines of ticks 0, 1, 2, ... in nanoseconds of `clock_ns`. The first `wait_until_due` starts the schedule.

    `on_slip` gets the nanoseconds by which the schedule was moved.
    """

    def __init__(
        self,
        *,
        period_ns: int,
        lead_ns: int,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        sleep_s: Callable[[float], None] = time.sleep,
        on_slip: Callable[[int], None] | None = None,
    ) -> None:
        if period_ns <= 0 or lead_ns < 0:
            raise ValueError(f"period {period_ns} ns must be above 0, lead {lead_ns} ns must not be below 0")
        self.period_ns = period_ns
        self.lead_ns = lead_ns
        self.slip_count = 0
        self.slipped_ns = 0
        self._on_slip = on_slip
        self._clock_ns = clock_ns
        self._sleep_s = sleep_s
        self._origin_ns: int | None = None

    def deadline_ns(self, tick: int) -> int:
        """Return the deadline of `tick` in the present schedule. ValueError before it has started."""
        if self._origin_ns is None:
            raise ValueError("the schedule has not started: call wait_until_due first")
        return self._origin_ns + tick * self.period_ns

    def wait_until_due(self, tick: int) -> int:
        """Sleep until `lead_ns` before the deadline of `tick` and return the deadline. Slip if that is long past."""
        now_ns = self._clock_ns()
        if self._origin_ns is None:
            self._origin_ns = now_ns + self.lead_ns - tick * self.period_ns
        deadline_ns = self.deadline_ns(tick)
        due_ns = deadline_ns - self.lead_ns
        behind_ns = now_ns - due_ns
        if behind_ns > SLIP_NS:
            self._slip(behind_ns)
            return deadline_ns + behind_ns
        while now_ns < due_ns:
            self._sleep_s((due_ns - now_ns) / NS_PER_S)
            now_ns = self._clock_ns()
        return deadline_ns

    def _slip(self, behind_ns: int) -> None:
        assert self._origin_ns is not None
        self._origin_ns += behind_ns
        self.slip_count += 1
        self.slipped_ns += behind_ns
        if self._on_slip is not None:
            self._on_slip(behind_ns)
