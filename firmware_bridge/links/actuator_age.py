"""How old the actuator command is when it moves the vehicle, with an autopilot that sends at its own pace.

In lockstep every command belongs to its tick. A free-running autopilot's latest command is latched and used again until
the next one comes: its age adds to the delay of the control loop, and a hole in the stream freezes the motors.
"""

from __future__ import annotations

from typing import NamedTuple

from hil.signals.latency import LatencyHistogram
from hil.signals.time import NS_PER_MS

# PX4 HITL sends at about 200 Hz (p90 of the interval 6.2 ms): four in a row are missing.
GAP_NS = 20 * NS_PER_MS
_GAPS_KEPT = 256


class Gap(NamedTuple):
    """No command came for `length_ns` up to `end_ns` of the wall clock."""

    end_ns: int
    length_ns: int


class ActuatorAge:
    """Statistics of one run. All times are the wall clock of whoever receives, monotonic, ns.

    `before_first` ticks had no command at all; of the others `held` used one that an earlier tick had used already.
    `superseded` commands were replaced before any tick used them. `interval` is from one arrival to the next.
    """

    def __init__(self, *, gap_ns: int = GAP_NS) -> None:
        self.gap_ns = gap_ns
        self.age = LatencyHistogram()
        self.interval = LatencyHistogram()
        self.before_first = 0
        self.held = 0
        self.superseded = 0
        self.gap_count = 0
        self.gaps: list[Gap] = []  # the first ones; `gap_count` has them all
        self._arrived_ns: int | None = None
        self._used = True

    def arrived(self, t_ns: int) -> None:
        """A command came and is latched from now on."""
        if self._arrived_ns is not None:
            interval_ns = t_ns - self._arrived_ns
            self.interval.add(interval_ns)
            if interval_ns > self.gap_ns:
                self._note_gap(Gap(t_ns, interval_ns))
        if not self._used:
            self.superseded += 1
        self._arrived_ns = t_ns
        self._used = False

    def used(self, t_ns: int) -> int | None:
        """A tick at `t_ns` uses the latched command: its age, or None before the first one."""
        if self._arrived_ns is None:
            self.before_first += 1
            return None
        if self._used:
            self.held += 1
        self._used = True
        age_ns = max(0, t_ns - self._arrived_ns)
        self.age.add(age_ns)
        return age_ns

    def finish(self, t_ns: int) -> None:
        """The run ends: a stream that had fallen silent is a gap too, though nothing ended it."""
        if self._arrived_ns is not None and t_ns - self._arrived_ns > self.gap_ns:
            self._note_gap(Gap(t_ns, t_ns - self._arrived_ns))

    def _note_gap(self, gap: Gap) -> None:
        self.gap_count += 1
        if len(self.gaps) < _GAPS_KEPT:
            self.gaps.append(gap)
