"""Locks of a receiver: the signals that it tracks, and the time to its first fix.

A signal that falls below `tracking_dbhz` is lost at once. It is found again after it has been above `acquisition_dbhz`
for `reacquisition_s`. A receiver that starts `hot`, `warm` or `cold` has no satellite before four signals could be
found for its start's time together. One that has had no signal for `_LONG_LOSS_S` starts hot again.
"""

from __future__ import annotations

from collections.abc import Sequence

from signals.time import NS_PER_S
from sim.gnss.parameters import ReceiverParameters

_LONG_LOSS_S = 10.0
_LEAST = 4  # signals that a start needs


class Tracking:
    """Locks of all satellites of a receiver."""

    def __init__(self, receiver: ReceiverParameters, count: int, *, start: str) -> None:
        self._p = receiver
        starts = {
            "tracking": 0.0,
            "hot": receiver.hot_start_s,
            "warm": receiver.warm_start_s,
            "cold": receiver.cold_start_s,
        }
        self._start_ns = round(starts[start] * NS_PER_S)  # still to pass before satellites are used
        self._reacquisition_ns = round(receiver.reacquisition_s * NS_PER_S)
        self._locked = [False] * count
        self._heard_ns: list[int | None] = [None] * count  # since when a signal could be found
        self._last_ns: int | None = None
        self._silent_ns = 0  # for so long no signal
        self._is_first = start == "tracking"

    def update(self, t_ns: int, cn0_dbhz: Sequence[float]) -> list[bool]:
        """Return which satellites are tracked at `t_ns`; their C/N0, -inf without a signal."""
        p = self._p
        passed_ns = 0 if self._last_ns is None else t_ns - self._last_ns
        self._last_ns = t_ns
        findable = sum(level >= p.acquisition_dbhz for level in cn0_dbhz)
        if self._start_ns > 0:
            if findable >= _LEAST:
                self._start_ns -= passed_ns
            if self._start_ns > 0:
                return [False] * len(self._locked)
            self._is_first = True  # the search has found what there is
        for i, level in enumerate(cn0_dbhz):
            if self._locked[i]:
                self._locked[i] = level >= p.tracking_dbhz
                self._heard_ns[i] = None
            elif level < p.acquisition_dbhz:
                self._heard_ns[i] = None
            else:
                heard = self._heard_ns[i]
                if heard is None:
                    heard = self._heard_ns[i] = t_ns
                if self._is_first or t_ns - heard >= self._reacquisition_ns:
                    self._locked[i] = True
        self._is_first = False
        if any(self._locked):
            self._silent_ns = 0
        else:
            was_ns = self._silent_ns
            self._silent_ns += passed_ns
            long_ns = round(_LONG_LOSS_S * NS_PER_S)
            if was_ns < long_ns <= self._silent_ns:
                self._start_ns = round(p.hot_start_s * NS_PER_S)
        return list(self._locked)
