"""When a flight that nobody scripted (no mission) is over."""

from __future__ import annotations

from hil.signals.time import NS_PER_S

# So long after the motors stopped [ns of simulated time].
_AFTER_DISARM_NS = 3 * NS_PER_S


class FlightOver:
    """Says when a flight that somebody else commands has ended: armed once, and disarmed for a while."""

    def __init__(self, tick_ns: int) -> None:
        self._after_ticks = _AFTER_DISARM_NS // tick_ns
        self._flown = False
        self._disarmed_tick = 0

    def after(self, tick: int, armed: bool) -> bool:
        if armed:
            self._flown = True
            self._disarmed_tick = tick
            return False
        return self._flown and tick - self._disarmed_tick >= self._after_ticks
