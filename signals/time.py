"""Integer time. Every instant is an `int` of nanoseconds since the start of the run; times are never sums of floats.

A rate that does not divide the tick is kept exact on average by `RateAccumulator`: an event of a 100 Hz sensor
on a 250 Hz tick falls on ticks 0, 3, 5, 8, 10, ... (period 2.5 ticks), never on a drifting timer.
"""

from __future__ import annotations

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
US_PER_S = 1_000_000


def period_ns_from_hz(rate_hz: float) -> int:
    """Return the period of a rate, rounded to whole nanoseconds. Raises ValueError for a rate that is not above 0."""
    if not rate_hz > 0:
        raise ValueError(f"rate must be above 0 Hz, not {rate_hz!r}")
    return round(NS_PER_S / rate_hz)


def is_due(tick: int, *, event_millihz: int, tick_millihz: int) -> bool:
    """Return True if a `RateAccumulator` of these rates, called on every tick from 0 on, is due on this tick."""
    return tick == 0 or tick * event_millihz // tick_millihz > (tick - 1) * event_millihz // tick_millihz


class RateAccumulator:
    """Schedule of the ticks on which an event of a given rate is due, exact on average and without drift.

    By tick k, floor(k * event_millihz / tick_millihz) + 1 events should have happened; an event is due whenever this
    count grows.

    Rates are in millihertz, so that 0.5 Hz and 29.97 Hz are integers.
    """

    __slots__ = ("_acc", "_den", "_num")

    def __init__(self, *, event_millihz: int, tick_millihz: int) -> None:
        if event_millihz <= 0 or tick_millihz <= 0:
            raise ValueError("rates must be above zero")
        if event_millihz > tick_millihz:
            raise ValueError(
                f"an event at {event_millihz / 1000:g} Hz cannot be served by a tick of {tick_millihz / 1000:g} Hz"
            )
        self._num = event_millihz
        self._den = tick_millihz
        self._acc = tick_millihz  # tick 0 is due

    def idle_ticks(self) -> int:
        """Advance from a tick on which the event is due to the next; return how many ticks between them are not due."""
        num, den = self._num, self._den
        if num == den:  # on every tick
            return 0
        acc = self._acc + num - den
        idle = max(0, -((acc - den) // num))
        self._acc = acc + idle * num
        return idle

    def due(self) -> bool:
        """Advance by one tick; return True if the event is due on it. Call exactly once per tick."""
        if self._acc >= self._den:
            self._acc += self._num - self._den
            return True
        self._acc += self._num
        return False
