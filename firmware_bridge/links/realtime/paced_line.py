"""The outgoing half of a real-time link: writes frames at their deadlines and counts how late they left.

A sender process writes them. Where declared faults wrap the transport there is no descriptor to give to a process: then
the bench writes each frame itself, as soon as it is ready.
"""

from __future__ import annotations

import time

from firmware_bridge.links.realtime.sender import RealtimeSender, SendStats
from firmware_bridge.transports.transport import Transport
from signals.errors import LinkClosed
from signals.time import NS_PER_MS

# A thread that was held up must not send a burst: PX4 would take old samples for new ones.
_STALE_NS = 20 * NS_PER_MS


class PacedLine:
    """Writes to `transport`, which is open."""

    def __init__(self, transport: Transport, *, period_ns: int, own_process: bool = True) -> None:
        self._period_ns = period_ns
        self._own_process = own_process
        self._stats = SendStats()
        self.renew(transport)

    def renew(self, transport: Transport) -> None:
        """Write to `transport`, which has been opened again after `stop`. The counts continue."""
        self._transport = transport
        fd = transport.fileno()
        self._sender = (
            RealtimeSender(fd, self._stats, period_ns=self._period_ns, stale_ns=_STALE_NS)
            if self._own_process and fd is not None
            else None
        )

    def push(self, deadline_ns: int, data: bytes, *, keep: bool) -> None:
        """Send `data` at `deadline_ns`; with `keep` also if it is late. LinkClosed if the bench's own write fails."""
        if self._sender is not None:
            self._sender.push(deadline_ns, data, keep=keep)
            return
        late_ns = max(0, time.monotonic_ns() - deadline_ns)
        self._transport.write(data)
        stats = self._stats
        stats.count_lateness(late_ns)
        stats.pushed += 1
        stats.sent += 1

    def failure(self, port: str) -> LinkClosed | None:
        """Return the error that ended the sending, or None."""
        return None if self._sender is None else self._sender.failure(port)

    def stop(self) -> None:
        """End the sending. May be called any number of times."""
        if self._sender is not None:
            self._sender.stop()

    def stats(self) -> SendStats:
        """Return the counts, brought up to date. The object goes on counting."""
        if self._sender is not None:
            self._sender.collect()
        return self._stats
