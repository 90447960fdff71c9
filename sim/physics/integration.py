"""Numerical integration of a flight: the method, its steps, and the skipping of contact queries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from signals.time import NS_PER_MS, NS_PER_S

# Upper bounds of a free-flight step. `hil bench physics` shows the error that remains.
FREE_STEP_NS = {"order8": 4 * NS_PER_MS, "classical": 1 * NS_PER_MS}
CONTACT_STEP_NS = 1 * NS_PER_MS  # upper bound
HARD_CONTACT_STEP_NS = NS_PER_MS // 5  # upper bound, after a hard touch-down


@dataclass(frozen=True)
class TickSteps:
    """Division of one tick into steps."""

    tick_s: float
    free: int  # free-flight steps
    contact: tuple[int, int] = (1, 1)  # contact steps: ordinary, after a hard touch-down
    classical: bool = False  # Runge-Kutta of order 4 instead of 8


@dataclass(frozen=True)
class Integration:
    """Method and steps of the integration.

    `method`: Runge-Kutta of order 8, or the classical one of order 4. `step_ns`: upper bound of a free-flight step,
    which must divide the tick; default `longest_ns` (by default 4 ms, classical: 1 ms) or the next shorter step that
    divides it.
    """

    method: Literal["order8", "classical"] = "order8"
    step_ns: int | None = None
    longest_ns: int | None = None
    contact_skipping: bool = True  # skip contact queries whose result is known; changes no bit

    def steps(self, tick_ns: int) -> TickSteps:
        """Return the steps of a tick. Raises ValueError if the tick is not above 0 or `step_ns` does not divide it."""
        if tick_ns <= 0:
            raise ValueError(f"tick_ns must be above 0, not {tick_ns}")
        step_ns = self.step_ns
        if step_ns is not None and (step_ns <= 0 or tick_ns % step_ns):
            raise ValueError(f"step_ns {step_ns} does not divide the tick of {tick_ns} ns")
        longest_ns = FREE_STEP_NS[self.method] if self.longest_ns is None else self.longest_ns
        return TickSteps(
            tick_s=tick_ns / NS_PER_S,
            free=tick_ns // step_ns if step_ns is not None else -(-tick_ns // longest_ns),
            contact=(-(-tick_ns // CONTACT_STEP_NS), -(-tick_ns // HARD_CONTACT_STEP_NS)),
            classical=self.method == "classical",
        )
