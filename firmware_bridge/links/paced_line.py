"""Writes frames at their deadlines: through a real-time process of its own, or, where something sits between the
bench and the wire (declared link faults), from here, as soon as a frame is ready. Keeps count of how late they left.
"""

from __future__ import annotations

import errno
import os
import time
from dataclasses import dataclass, field

from firmware_bridge.links.realtime_sender import RealtimeSender
from firmware_bridge.transports.transport import Transport
from hil.signals.errors import LinkClosed
from hil.signals.latency import LatencyHistogram
from hil.signals.time import NS_PER_MS

# A thread that was held up must not let go of a burst: PX4 would take old samples for new ones.
_STALE_NS = 20 * NS_PER_MS


@dataclass
class SendStats:
    """Counts of frames since the line was opened. `pushed` = `sent` + `dropped` + `pending`, unless it was renewed."""

    # Of the frames sent: right before the write that took the last byte, minus deadline.
    lateness: LatencyHistogram = field(default_factory=LatencyHistogram)
    pushed: int = 0
    sent: int = 0
    dropped: int = 0  # left out: stale, or the line was full until a period after the deadline
    refused: int = 0  # never taken: too many were in line
    stalled: int = 0  # had to wait for room in the line
    pending: int = 0
    longest_gap_ns: int = 0  # from one sample written to the next: what the autopilot did without
    late_2ms: int = 0
    late_20ms: int = 0
    scheduling: str = "no process of its own: declared faults sit on the line"  # what the sender was granted, in words

    def count_lateness(self, lateness_ns: int) -> None:
        self.lateness.add(lateness_ns)
        self.late_2ms += lateness_ns > 2 * NS_PER_MS
        self.late_20ms += lateness_ns > 20 * NS_PER_MS


def sending_failure(sender: RealtimeSender, port: str) -> LinkClosed | None:
    """The error to raise if the sender has ended by itself; None while it has not."""
    sender.collect()
    if sender.error is None:
        return None
    code, deadline_ns = sender.error
    if code == errno.ETIMEDOUT:
        what = "the far side takes no bytes any more; is it hung, or not reading?"
    elif code in (errno.EIO, errno.ENXIO, errno.ENODEV, errno.EPIPE, errno.ECONNRESET):
        what = f"the far side hung up, or the device was unplugged ({os.strerror(code)})"
    else:
        what = f"cannot be written to ({os.strerror(code)})"
    return LinkClosed(port, f"{what}, at the frame due at {deadline_ns * 1e-9:.6f} s of the monotonic clock")


class PacedLine:
    """The outgoing half of `transport`, which is open."""

    def __init__(self, transport: Transport, *, period_ns: int, own_process: bool = True) -> None:
        self._period_ns = period_ns
        self._own_process = own_process
        self._stats = SendStats()
        self.renew(transport)

    def renew(self, transport: Transport) -> None:
        """Write to `transport` from now on, which has been opened (again, after `stop`); counting goes on."""
        self._transport = transport
        fd = transport.fileno()
        self._sender = (
            RealtimeSender(fd, self._stats, period_ns=self._period_ns, stale_ns=_STALE_NS)
            if self._own_process and fd is not None
            else None
        )

    def push(self, deadline_ns: int, data: bytes, *, keep: bool) -> None:
        """Send `data` at `deadline_ns`; with `keep` also if it is late. LinkClosed where that is known at once."""
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
        """Why the line takes nothing any more; None while it does."""
        return None if self._sender is None else sending_failure(self._sender, port)

    def stop(self) -> None:
        """Write nothing further. May be called any number of times."""
        if self._sender is not None:
            self._sender.stop()

    def stats(self) -> SendStats:
        """The counts as they stand now; they go on counting."""
        if self._sender is not None:
            self._sender.collect()
        return self._stats
