"""The bench's clock as the client estimates it from pings."""

from __future__ import annotations

from collections import deque

from hil_companion.link.checks import Fields
from hil_companion.link.protocol import Header

PONGS_KEPT = 16


class BenchClock:
    """Offset between the bench's clock and this machine's, and round trip [ns]; None before the first answer.

    With client times t0 (ping sent) and t3 (pong received) and bench times t1, t2 in between, the round trip is
    (t3 - t0) - (t2 - t1), and the offset bench - client is ((t1 - t0) + (t2 - t3)) / 2, wrong by at most half the round
    trip. Of the last 16 pings the one with the shortest round trip counts.
    """

    def __init__(self) -> None:
        self._measured: deque[tuple[int, int]] = deque(maxlen=PONGS_KEPT)  # round trip, offset

    def add(self, pong: Header, t_received_ns: int) -> None:
        """Add the answer to a ping. Raises BadMessage."""
        fields = Fields(pong, "pong")
        t0, t1, t2 = (fields.integer(f"t_{name}_ns") for name in ("client", "bench_received", "bench_sent"))
        round_trip_ns, there_ns, back_ns = (t_received_ns - t0) - (t2 - t1), t1 - t0, t2 - t_received_ns
        if round_trip_ns >= 0:  # a negative round trip is impossible: the answer is wrong
            self._measured.append((round_trip_ns, (there_ns + back_ns) // 2))

    @property
    def round_trip_ns(self) -> int | None:
        return min(self._measured)[0] if self._measured else None

    @property
    def bench_minus_client_ns(self) -> int | None:
        return min(self._measured)[1] if self._measured else None
