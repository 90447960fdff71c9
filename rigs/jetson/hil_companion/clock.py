"""The bench's clock as seen from here, from pings.

With client times t0 (ping sent) and t3 (pong received) and bench times t1, t2 in between, the round trip is
(t3 - t0) - (t2 - t1), and the offset bench - client is ((t1 - t0) + (t2 - t3)) / 2, wrong by at most half the round
trip. The shortest of the last few round trips is believed.
"""

from __future__ import annotations

from collections import deque

from hil_companion.protocol import Pong

KEPT = 16


class BenchClock:
    """Offset and round trip; None before the first answer."""

    def __init__(self) -> None:
        self._seen: deque[tuple[int, int]] = deque(maxlen=KEPT)  # round trip, offset

    def add(self, pong: Pong, t_received_ns: int) -> None:
        round_trip_ns = (t_received_ns - pong.t_client_ns) - (pong.t_bench_sent_ns - pong.t_bench_received_ns)
        there_ns = pong.t_bench_received_ns - pong.t_client_ns
        back_ns = pong.t_bench_sent_ns - t_received_ns
        if round_trip_ns >= 0:  # below 0: an answer that no clock can have given
            self._seen.append((round_trip_ns, (there_ns + back_ns) // 2))

    @property
    def round_trip_ns(self) -> int | None:
        return min(self._seen)[0] if self._seen else None

    @property
    def bench_minus_client_ns(self) -> int | None:
        return min(self._seen)[1] if self._seen else None
