"""A client's clock against the bench's, from what its answers say about both.

With a frame sent at T1 (bench), received at T2, answered at T3 (client) and the answer here at T4 (bench), RFC 5905
(section 8):

    offset = ((T2 - T1) + (T3 - T4)) / 2        client's clock minus the bench's
    delay  = (T4 - T1) - (T3 - T2)              time on the wires, both ways

The offset is wrong by half the difference of the two ways, so by at most delay / 2. Of the last exchanges the one with
the least delay is taken (RFC 5905, section 10, the clock filter); an older one counts as worse by what clocks may have
drifted since. A frame is much longer than its answer, and over a slow wire that is such a difference; a client that
compares clocks by pings, short in both directions, tells its own reading in addition, and the surer one counts.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

_EXCHANGES = 64
_DRIFT = 100e-6  # quartz: some tens of ppm on each side


class ClockReading(NamedTuple):
    t_ns: int  # bench clock, when it was taken
    offset_ns: int  # client's clock minus the bench's
    delay_ns: int


class ClockOffset:
    """Minimum-delay filter over the last exchanges.

    All readings grow worse at one rate, so which is the surest does not depend on when that is asked: a reading
    is kept until a surer one comes or the window has passed it, and the first of those kept is the one wanted.
    """

    def __init__(self) -> None:
        self._kept: deque[tuple[int, float, ClockReading]] = deque()  # number, what it counts as at time 0, reading
        self._count = 0

    def add(self, t1_ns: int, t2_ns: int, t3_ns: int, t4_ns: int) -> None:
        """One exchange: bench sent, client received, client sent, bench received."""
        delay_ns = (t4_ns - t1_ns) - (t3_ns - t2_ns)
        if delay_ns < 0 or t3_ns < t2_ns:
            return  # a clock jumped, or the client makes times up
        self._add(ClockReading(t4_ns, ((t2_ns - t1_ns) + (t3_ns - t4_ns)) // 2, delay_ns))

    def add_reading(self, t_ns: int, offset_ns: int, delay_ns: int) -> None:
        """What the client found out itself."""
        self._add(ClockReading(t_ns, offset_ns, delay_ns))

    def _add(self, reading: ClockReading) -> None:
        kept = self._kept
        counts_as = reading.delay_ns - 2.0 * _DRIFT * reading.t_ns
        self._count += 1
        while kept and kept[-1][1] > counts_as:
            kept.pop()
        kept.append((self._count, counts_as, reading))
        while kept[0][0] <= self._count - _EXCHANGES:
            kept.popleft()

    @property
    def best(self) -> ClockReading | None:
        """The surest reading; None before the first."""
        return self._kept[0][2] if self._kept else None
