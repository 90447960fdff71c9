"""Faults of the link to a companion, injected while the run goes on.

    drop      a frame is lost with probability `rate`: the client never receives it, and answers the next one
    delay     answers apply `delay_s` of simulated time later; later answers do not overtake them
    unplug    the connection is closed, and the client may reconnect when the fault is over

`at_s` and the end of drop and delay are simulated times; by the wall clock they would have no effect in lockstep.
Simulated time stands still while the bench waits for a client in control to reconnect (`companion.reconnect_s`), so an
unplug ends after `for_s` of simulated or of wall-clock time, whichever passes first. The lost frames depend only on
the seed, the number of the fault and the number of the frame.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from firmware_bridge.faults.companion_fault import FOREVER_NS, CompanionFault
from signals.noise import NoiseStream
from signals.time import NS_PER_S

_BLOCK = 256  # samples per block of NoiseStream

Event = Callable[[int, str, str], None]


@dataclass
class _Active:
    fault: CompanionFault
    random: NoiseStream
    end_wall_ns: int = FOREVER_NS
    over: bool = False
    lost: int = 0


class CompanionFaults:
    """The injected faults of a run. `unplug(client, reason)` closes a connection."""

    def __init__(
        self,
        seed: int,
        on_event: Event,
        unplug: Callable[[str, str], None],
        *,
        wall_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._seed, self._on_event, self._unplug, self._wall_ns = seed, on_event, unplug, wall_ns
        self._injected: list[_Active] = []
        self._active: list[_Active] = []
        self._not_before_ns: dict[str, int] = {}  # client -> earliest time from which its next answer may apply

    def inject(self, fault: CompanionFault, t_ns: int) -> None:
        """Begin a fault now."""
        active = _Active(fault, NoiseStream(self._seed, f"companion_fault.{len(self._injected)}", lanes=1))
        self._injected.append(active)
        self._active.append(active)
        self._on_event(t_ns, "fault", f"companion {fault.client}: {fault.kind} began")
        if fault.kind == "unplug":
            active.end_wall_ns = self._wall_ns() + fault.length_ns
            self._unplug(fault.client, "unplugged by an injected fault")

    def step(self, t_ns: int) -> None:
        """End the faults that are over. Called once per frame."""
        for active in [a for a in self._active if t_ns >= a.fault.end_ns or self._wall_ns() >= a.end_wall_ns]:
            self._active.remove(active)
            active.over = True
            count = f", {active.lost} frames lost" if active.fault.kind == "drop" else ""
            self._on_event(t_ns, "fault", f"companion {active.fault.client}: {active.fault.kind} is over{count}")

    def lose(self, client: str, frame: int) -> bool:
        """Return True if this frame is lost, and count it."""
        lost = False
        for active in self._active_of(client, "drop"):
            value: Any = active.random.uniform_block(frame // _BLOCK)[frame % _BLOCK, 0]
            if value < (active.fault.rate or 0.0):
                active.lost += 1
                lost = True
        return lost

    def delayed(self, client: str, from_ns: int) -> int:
        """Return `from_ns`, the time from which an answer applies, plus the active delays."""
        delays = [round((a.fault.delay_s or 0.0) * NS_PER_S) for a in self._active_of(client, "delay")]
        if not delays and client not in self._not_before_ns:
            return from_ns
        delayed_ns = max(from_ns + sum(delays), self._not_before_ns.get(client, 0))
        self._not_before_ns[client] = delayed_ns
        if not delays and delayed_ns == from_ns:
            del self._not_before_ns[client]  # no delayed answer is pending any more
        return delayed_ns

    def unplugged(self, client: str) -> bool:
        """Return True if the client may not reconnect yet."""
        return any(self._wall_ns() < active.end_wall_ns for active in self._active_of(client, "unplug"))

    def _active_of(self, client: str, kind: str) -> list[_Active]:
        return [a for a in self._active if a.fault.client == client and a.fault.kind == kind] if self._active else []
