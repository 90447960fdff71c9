"""States of one vehicle in the last seconds."""

from __future__ import annotations

from collections import deque

from signals.samples import TruthState

_MOST_STATES = 2501  # 10 s, the longest latency of a sensor


class Past:
    """States of a vehicle, the present one last: one for each tick, and those to which clients have put it."""

    def __init__(self, truth: TruthState) -> None:
        self._states = deque([truth], maxlen=_MOST_STATES)
        self._placed: TruthState | None = None  # the last one to which a client has put it

    def add(self, truth: TruthState) -> None:
        """Add the state of a tick."""
        self._states.append(truth)

    def place(self, truth: TruthState) -> None:
        """Add the state of a vehicle that was put elsewhere, in place of one of the same tick."""
        if self.now is self._placed and self.now.t_ns == truth.t_ns:
            self._states.pop()
        self._states.append(truth)
        self._placed = truth

    def begin(self, truth: TruthState) -> None:
        """Forget all earlier states."""
        self._states.clear()
        self._states.append(truth)
        self._placed = None

    @property
    def now(self) -> TruthState:
        """Present state."""
        return self._states[-1]

    def at(self, t_ns: int) -> TruthState:
        """Return the first state from a time on, none from before the vehicle was put elsewhere."""
        found = self.now
        for state in reversed(self._states):
            if state.t_ns < t_ns:
                break
            found = state
            if state is self._placed:
                break
        return found

    def before(self, t_ns: int) -> TruthState:
        """Return the last state up to a time, or the oldest one."""
        return next((state for state in reversed(self._states) if state.t_ns <= t_ns), self._states[0])
