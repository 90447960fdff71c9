"""Timers of simulated time.

A timer of period P fires on the first step at or after each multiple of P (integer microseconds): the rate is exact
on average and missed instants are not made up for. Between due times a step costs one comparison, `now_us >=
timers.next_due_us`.
"""

from __future__ import annotations

from collections.abc import Callable

NEVER_US = 1 << 62


class Timer:
    """One callback and when it is due next. `period_us` 0 = off."""

    __slots__ = ("action", "due_us", "period_us")

    def __init__(self, action: Callable[[int], None]) -> None:
        self.action = action
        self.period_us = 0
        self.due_us = NEVER_US


class Timers:
    """Every timer of one autopilot, served in the order in which they were made."""

    __slots__ = ("_timers", "next_due_us")

    def __init__(self) -> None:
        self._timers: list[Timer] = []
        self.next_due_us = NEVER_US

    def add(self, action: Callable[[int], None]) -> Timer:
        """A new timer, off. `action(now_us)` may start and stop timers, itself included."""
        timer = Timer(action)
        self._timers.append(timer)
        return timer

    def start(self, timer: Timer, period_us: int, now_us: int) -> None:
        """Run `timer` every `period_us` > 0, first at the next multiple of the period after `now_us`."""
        timer.period_us = period_us
        timer.due_us = now_us - now_us % period_us + period_us
        self.next_due_us = min(self.next_due_us, timer.due_us)

    def stop(self, timer: Timer) -> None:
        """Silence `timer`."""
        timer.period_us = 0
        timer.due_us = NEVER_US

    def run(self, now_us: int) -> None:
        """Fire what is due at `now_us`."""
        for timer in self._timers:
            if timer.due_us <= now_us:
                period = timer.period_us
                timer.due_us = now_us - now_us % period + period
                timer.action(now_us)
        self.next_due_us = min(timer.due_us for timer in self._timers)
