"""The wait that a plan asks for at one of its places."""

from __future__ import annotations

from signals.time import NS_PER_S

SETTLE_S = 8.0  # after an arrival at 2 m below, say
_AWAY_NS = NS_PER_S // 10  # without a measurement there: it was elsewhere
LESS_HOLD_S = 2.0  # autopilots take whole seconds, and begin to count when their estimate has arrived


class Hold:
    """Time within reach of a place at which the plan waits."""

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self._inside_ns = 0
        self._first_ns: int | None = None  # it was there for the first time
        self._since_ns = self._before_ns = 0  # it is there since; it was there last
        self.off_m: float | None = None  # greatest distance from the height of the place
        self.onward = False  # True once the vehicle has reached a later waypoint, out of this one's reach

    def add(self, elapsed_ns: int) -> None:
        """Add a time spent there."""
        self._inside_ns += elapsed_ns

    def add_height(self, t_ns: int, off_m: float) -> None:
        """Add a distance from the height of the place, which counts while the vehicle neither arrives nor may leave."""
        if self._first_ns is None:
            self._first_ns = t_ns
        if t_ns - self._before_ns > _AWAY_NS:
            self._since_ns = t_ns
        self._before_ns = t_ns
        settled = t_ns - self._since_ns >= SETTLE_S * NS_PER_S
        if settled and t_ns - self._first_ns <= (self._hold_s - LESS_HOLD_S) * NS_PER_S:
            self.off_m = off_m if self.off_m is None else max(self.off_m, off_m)

    @property
    def missed(self) -> bool:
        """True if the vehicle was not there long enough."""
        return self._inside_ns < (self._hold_s - LESS_HOLD_S) * NS_PER_S

    def text(self, number: int) -> str:
        """Both times in words; that spent there is rounded down, so that it stays below what is enough.

        `number`: of the waypoint, or 0 for the take-off.
        """
        where = f"waypoint {number}" if number else "the top of its take-off"
        inside_s = self._inside_ns // (NS_PER_S // 10) / 10
        enough_s = self._hold_s - LESS_HOLD_S
        waits = f"the plan waits there for {self._hold_s:g} s, {enough_s:g} s are enough"
        return f"the vehicle was at {where} for {inside_s:.1f} s; {waits}"
