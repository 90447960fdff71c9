"""What a real-time sender did, as plain numbers: for the report, for judging it, and for the error when it ended."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass
from typing import NamedTuple

from firmware_bridge._native import RealtimeSender
from hil.signals.errors import LinkClosed
from hil.signals.latency import LatencyHistogram


class LateSend(NamedTuple):
    """Frame `number` (0: the first one pushed) was written `lateness_ns` after its deadline, wall clock."""

    number: int
    deadline_ns: int
    lateness_ns: int


class CountedHistogram(LatencyHistogram):
    """A histogram from counts that were kept elsewhere, in the same bins."""

    __slots__ = ()

    def __init__(self, bins: list[int], *, total_ns: int, max_ns: int) -> None:
        super().__init__()
        if len(bins) != len(self._bins):
            raise ValueError(f"{len(bins)} bins, a LatencyHistogram has {len(self._bins)}")
        self._bins = list(bins)
        self.count = sum(bins)
        self.total_ns = total_ns
        self.max_ns = max_ns


@dataclass(frozen=True)
class SendStats:
    """Counts of frames since the sender began. `pushed` = `sent` + `dropped` + `pending`."""

    lateness: LatencyHistogram  # of the frames sent: right before the write that took the last byte, minus deadline
    pushed: int
    sent: int
    dropped: int  # left out: stale, or the line was full until a period after the deadline
    stale: int  # of these, held up in the sender itself
    refused: int  # never taken: no slot was free
    stalled: int  # had to wait for room in the line
    pending: int
    longest_gap_ns: int  # from one sample written to the next: what the autopilot did without
    late_2ms: int
    late_20ms: int
    worst: tuple[LateSend, ...]  # the up to 256 worst of those over 2 ms, in the order of sending
    scheduling: str  # what the sending thread was granted, in words


def send_stats(sender: RealtimeSender) -> SendStats:
    """The counts as they stand now. Exact once the sender has stopped, else each is of its own instant."""
    histogram = CountedHistogram(
        sender.lateness_bins(), total_ns=sender.total_lateness_ns, max_ns=sender.max_lateness_ns
    )
    return SendStats(
        lateness=histogram,
        pushed=sender.pushed,
        sent=sender.sent,
        dropped=sender.dropped,
        stale=sender.stale,
        refused=sender.refused,
        stalled=sender.stalled,
        pending=sender.pending,
        longest_gap_ns=sender.longest_gap_ns,
        late_2ms=sender.late_2ms,
        late_20ms=sender.late_20ms,
        worst=tuple(LateSend(*send) for send in sender.worst()),
        scheduling=sender.scheduling,
    )


def sending_failure(sender: RealtimeSender, port: str) -> LinkClosed | None:
    """The error to raise if the sender has ended by itself; None while it has not."""
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
