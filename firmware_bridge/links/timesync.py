"""Relates the autopilot's time since boot to the bench's monotonic clock by MAVLink TIMESYNC.

    request    tc1 = 0, ts1 = t1        bench's clock
    answer     tc1 = t, ts1 = t1        t is the autopilot's clock; received at t2 of the bench's

    rtt    = t2 - t1
    offset = t - (t1 + t2) / 2          autopilot's clock minus the bench's, wrong by at most rtt / 2

Queues only lengthen a round trip, so the answer with the shortest one is the best (the clock filter of RFC 5905). The
best answer of each block of time is kept, and a line through the blocks gives the drift. An answer that contradicts the
best one by more than both uncertainties means that the autopilot's clock jumped. A jump of more than a second is a
reboot: the filter then starts anew. A smaller one is a slip: a simulated autopilot's clock stands still while it gets
no processor, and the time lost is not made up. The earlier readings are then moved by the jump, so that slips do
not count as drift. Times are passed in; no clock is read here.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from signals.latency import LatencyHistogram
from signals.time import NS_PER_MS, NS_PER_S, period_ns_from_hz

TIMESYNC = MSGID["TIMESYNC"]
_Timesync = message_class("TIMESYNC")

_BLOCK_NS = 2 * NS_PER_S
_BLOCKS = 60  # two minutes, over which the drift is taken
_DRIFT_SPAN_NS = 10 * NS_PER_S  # below this the line through the blocks is mostly jitter
_OUTSTANDING = 64
# Crystals are within 100 ppm; this bound only has to distinguish a drift from a jump.
_MAX_DRIFT = 500e-6
_MIN_JUMP_NS = NS_PER_MS
_REBOOT_NS = NS_PER_S


class ClockReading(NamedTuple):
    """One answer: at `t_ns` of the bench's clock the autopilot's was `offset_ns` ahead, within half of `rtt_ns`."""

    t_ns: int
    offset_ns: int
    rtt_ns: int


class TimeSync:
    """Sends requests at `rate_hz` and keeps the relation of the clocks. `rtt` and `resets` are for the report."""

    def __init__(self, *, rate_hz: float = 10.0) -> None:
        self.rtt = LatencyHistogram()
        self.resets = 0  # reboots, by the autopilot's clock
        self.slips = 0  # smaller jumps of it
        self.slipped_ns = 0  # their sum; below 0: it has lost time
        self._period_ns = period_ns_from_hz(rate_hz)
        self._next_ns: int | None = None
        self._requested: deque[int] = deque(maxlen=_OUTSTANDING)
        self._blocks: deque[ClockReading] = deque(maxlen=_BLOCKS)  # best of each block, the last one still open
        self._block_start_ns = 0

    def request(self, now_ns: int) -> bytes | None:
        """Return the payload of the request to send at `now_ns`, or None while none is due."""
        if self._next_ns is not None and now_ns < self._next_ns:
            return None
        # Counted from now, not from the due time: after a pause one request is enough.
        self._next_ns = now_ns + self._period_ns
        self._requested.append(now_ns)
        return pack(_Timesync(0, now_ns))

    def take(self, frame: Frame, now_ns: int) -> ClockReading | None:
        """Take a TIMESYNC received at `now_ns`. Return the reading if it answers a request of the bench, else None."""
        message = unpack(frame)
        if message.tc1 == 0:
            return None  # the autopilot's own request
        if message.ts1 not in self._requested or now_ns < message.ts1:
            return None
        self._requested.remove(message.ts1)
        rtt_ns = now_ns - message.ts1
        reading = ClockReading(now_ns, message.tc1 - (message.ts1 + now_ns) // 2, rtt_ns)
        self.rtt.add(rtt_ns)
        jump_ns = self._jump_ns(reading)
        if abs(jump_ns) > _REBOOT_NS:
            self.resets += 1
            self._blocks.clear()
        elif jump_ns:
            self.slips += 1
            self.slipped_ns += jump_ns
            moved = [block._replace(offset_ns=block.offset_ns + jump_ns) for block in self._blocks]
            self._blocks = deque(moved, maxlen=_BLOCKS)
        self._keep(reading)
        return reading

    def _jump_ns(self, reading: ClockReading) -> int:
        """Return the jump of the autopilot's clock since the last block; 0 if its uncertainty explains the reading."""
        if not self._blocks:
            return 0
        last = self._blocks[-1]
        drifted_ns = _MAX_DRIFT * (reading.t_ns - last.t_ns)
        allowed_ns = (reading.rtt_ns + last.rtt_ns) / 2 + drifted_ns + _MIN_JUMP_NS
        jump_ns = reading.offset_ns - last.offset_ns
        return jump_ns if abs(jump_ns) > allowed_ns else 0

    def _keep(self, reading: ClockReading) -> None:
        if not self._blocks or reading.t_ns - self._block_start_ns >= _BLOCK_NS:
            self._block_start_ns = reading.t_ns
            self._blocks.append(reading)
        elif reading.rtt_ns < self._blocks[-1].rtt_ns:
            self._blocks[-1] = reading

    @property
    def drift_ppm(self) -> float | None:
        """Rate of the autopilot's clock against the bench's [ppm]; None before 10 s of answers."""
        drift = self._line()
        return None if drift is None else drift * 1e6

    def _line(self) -> float | None:
        """Return the slope of offset over time: least squares, weights inverse to the uncertainty."""
        blocks = self._blocks
        if len(blocks) < 3 or blocks[-1].t_ns - blocks[0].t_ns < _DRIFT_SPAN_NS:
            return None
        t0_ns, offset0_ns = blocks[0].t_ns, blocks[0].offset_ns  # differences are small enough for exact floats
        t, y, rtt = np.array([(b.t_ns - t0_ns, b.offset_ns - offset0_ns, b.rtt_ns) for b in blocks], dtype=float).T
        return float(np.polyfit(t / NS_PER_S, y / NS_PER_S, 1, w=1.0 / (rtt + 1.0))[0])

    def best(self) -> ClockReading | None:
        """Return the reading with the least uncertainty, drift since then included; None before the first answer."""
        if not self._blocks:
            return None
        now_ns = self._blocks[-1].t_ns
        return min(self._blocks, key=lambda b: b.rtt_ns / 2 + _MAX_DRIFT * (now_ns - b.t_ns))
