"""Writes frames at their deadlines: through the native real-time thread, or, where something sits between the bench
and the wire (declared link faults), from here, as soon as a frame is ready.
"""

from __future__ import annotations

import time
from dataclasses import replace

from firmware_bridge._native import RealtimeSender
from firmware_bridge.links.send_stats import SendStats, send_stats, sending_failure
from firmware_bridge.transports.transport import Transport
from hil.signals.errors import LinkClosed
from hil.signals.latency import LatencyHistogram
from hil.signals.time import NS_PER_MS

# A thread that was held up must not let go of a burst: PX4 would take old samples for new ones.
_SLOTS = 16
_STALE_NS = 20 * NS_PER_MS


class PacedLine:
    """The outgoing half of `transport`, which is open. `before`: counts of the same line before it was replugged."""

    def __init__(
        self, transport: Transport, *, period_ns: int, native: bool = True, before: SendStats | None = None
    ) -> None:
        self._transport = transport
        self._period_ns = period_ns
        self._native = native
        self._before = before
        fd = transport.fileno()
        self._sender = (
            RealtimeSender(fd, period_ns=period_ns, slots=_SLOTS, stale_ns=_STALE_NS)
            if native and fd is not None
            else None
        )
        self._own = LatencyHistogram()
        self._late_2ms = self._late_20ms = 0
        self._stats: SendStats | None = None

    def push(self, deadline_ns: int, data: bytes, *, keep: bool) -> None:
        """Send `data` at `deadline_ns`; with `keep` also if it is late. LinkClosed where that is known at once."""
        if self._sender is not None:
            self._sender.push(deadline_ns, data, keep)
            return
        late_ns = max(0, time.monotonic_ns() - deadline_ns)
        self._transport.write(data)
        self._own.add(late_ns)
        self._late_2ms += late_ns > 2 * NS_PER_MS
        self._late_20ms += late_ns > 20 * NS_PER_MS

    def failure(self, port: str) -> LinkClosed | None:
        """Why the line takes nothing any more; None while it does."""
        return None if self._sender is None else sending_failure(self._sender, port)

    def stop(self) -> None:
        """Write nothing further. May be called any number of times."""
        if self._sender is not None:
            self._sender.stop()

    def renewed(self, transport: Transport) -> PacedLine:
        """The same line after its transport has been opened again; counting goes on."""
        return PacedLine(transport, period_ns=self._period_ns, native=self._native, before=self.stats())

    def stats(self) -> SendStats:
        now = send_stats(self._sender) if self._sender is not None else self._own_stats()
        return now if self._before is None else _sum(self._before, now)

    def _own_stats(self) -> SendStats:
        sent = self._own.count
        return SendStats(
            lateness=self._own, pushed=sent, sent=sent, dropped=0, stale=0, refused=0, stalled=0, pending=0,
            longest_gap_ns=0, late_2ms=self._late_2ms, late_20ms=self._late_20ms, worst=(),
            scheduling="no thread of its own: declared faults sit on the line",
        )  # fmt: skip


def _sum(a: SendStats, b: SendStats) -> SendStats:
    lateness = LatencyHistogram()
    lateness.merge(a.lateness)
    lateness.merge(b.lateness)
    counts = ("pushed", "sent", "dropped", "stale", "refused", "stalled", "late_2ms", "late_20ms")
    return replace(
        b,
        lateness=lateness,
        longest_gap_ns=max(a.longest_gap_ns, b.longest_gap_ns),
        worst=(*a.worst, *b.worst)[:256],
        **{name: getattr(a, name) + getattr(b, name) for name in counts},
    )
