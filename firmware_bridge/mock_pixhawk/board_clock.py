"""The board's own clock, for HITL, where nobody else's clock counts: microseconds since power-on.

It runs from any source of nanoseconds: the monotonic wall clock in the process, simulated time in tests. A quartz has
an error and a board was not switched on when the bench was; both can be set, so that time synchronisation has something
to find.
"""

from __future__ import annotations

import time
from collections.abc import Callable

_PPB = 1_000_000_000


class BoardClock:
    """`offset_us` is what it shows at power-on, `drift_ppm` how much too fast it runs."""

    def __init__(
        self, source_ns: Callable[[], int] = time.monotonic_ns, *, offset_us: int = 0, drift_ppm: float = 0.0
    ) -> None:
        self._source_ns = source_ns
        self.offset_us = offset_us
        self._drift_ppb = round(drift_ppm * 1000.0)
        self._zero_ns = source_ns()

    def restart(self) -> None:
        """Power-on again."""
        self._zero_ns = self._source_ns()

    def now_us(self) -> int:
        """What it shows. Integer arithmetic: the same source gives the same microseconds on every machine."""
        elapsed_ns = self._source_ns() - self._zero_ns
        return self.offset_us + (elapsed_ns + elapsed_ns * self._drift_ppb // _PPB) // 1000

    def source_ns(self, t_us: int) -> int:
        """The first nanosecond of the source at which it shows `t_us`."""
        own_ns = (t_us - self.offset_us) * 1000
        # Rounded up, so that whoever sleeps until then does not wake a microsecond early.
        elapsed_ns = -(-own_ns * _PPB // (_PPB + self._drift_ppb)) + (1 if self._drift_ppb else 0)
        return self._zero_ns + elapsed_ns

    def until_s(self, t_us: int) -> float:
        """Seconds of the source until it shows `t_us`; 0 if it does already."""
        return max(0.0, (self.source_ns(t_us) - self._source_ns()) * 1e-9)
