"""Faults of the wire to a companion, from a simulated time on, put in while the run goes.

    drop      a frame is lost on its way, with probability `rate`: the client never sees it, and answers the next one
    delay     answers hold `delay_s` of simulated time later; what follows waits too, as on a line
    unplug    the connection ends, and the client is let in again when it is over

`at_s` and the end of drop and delay are simulated time, so that lockstep shows what the flight makes of them. Simulated
time stands still while the bench waits for a client in control to come back (`companion.reconnect_s`), so an unplug is
over when `for_s` has passed on either clock. Which frames are lost is a function of the seed, the fault's number and
the frame's.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from hil.signals.documents.validate import Section
from hil.signals.noise import NoiseStream
from hil.signals.time import NS_PER_S

_BLOCK = 256  # of NoiseStream
_FOREVER_NS = 1 << 62

Event = Callable[[int, str, str], None]


class CompanionFault(Section):
    """One fault of the wire to one client."""

    kind: Literal["drop", "delay", "unplug"]
    client: Annotated[str, Field(min_length=1, max_length=64)]
    at_s: Annotated[float, Field(ge=0.0, le=86_400.0)]
    for_s: Annotated[float, Field(gt=0.0, le=86_400.0)] | None = None  # null: to the end
    rate: Annotated[float, Field(ge=0.0, le=1.0)] | None = None  # drop
    delay_s: Annotated[float, Field(gt=0.0, le=10.0)] | None = None  # delay

    @model_validator(mode="after")
    def _fits_the_kind(self) -> CompanionFault:
        for name, kind in (("rate", "drop"), ("delay_s", "delay")):
            if (getattr(self, name) is not None) != (self.kind == kind):
                raise ValueError(f"the kind {kind!r}, and no other, needs {name}")
        return self

    @property
    def begin_ns(self) -> int:
        return round(self.at_s * NS_PER_S)

    @property
    def end_ns(self) -> int:
        return self.begin_ns + self.length_ns

    @property
    def length_ns(self) -> int:
        return _FOREVER_NS if self.for_s is None else round(self.for_s * NS_PER_S)


@dataclass
class _Active:
    fault: CompanionFault
    draws: NoiseStream
    end_wall_ns: int = _FOREVER_NS
    over: bool = False
    lost: int = 0


class CompanionFaults:
    """All of a run. `unplug(client, why)` ends a connection."""

    def __init__(
        self,
        seed: int,
        on_event: Event,
        unplug: Callable[[str, str], None],
        *,
        wall_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._seed, self._on_event, self._unplug, self._wall_ns = seed, on_event, unplug, wall_ns
        self._all: list[_Active] = []
        self._going: list[_Active] = []
        self._after_ns: dict[str, int] = {}  # by client: nothing overtakes the last answer that was late

    def inject(self, fault: CompanionFault, t_ns: int) -> None:
        """It begins now."""
        active = _Active(fault, NoiseStream(self._seed, f"companion_fault.{len(self._all)}", lanes=1))
        self._all.append(active)
        self._going.append(active)
        self._on_event(t_ns, "fault", f"companion {fault.client}: {fault.kind} began")
        if fault.kind == "unplug":
            active.end_wall_ns = self._wall_ns() + fault.length_ns
            self._unplug(fault.client, "unplugged by hand")

    def step(self, t_ns: int) -> None:
        """Once a frame: what is over by now."""
        for active in [a for a in self._going if t_ns >= a.fault.end_ns or self._wall_ns() >= a.end_wall_ns]:
            self._going.remove(active)
            active.over = True
            more = f", {active.lost} frames lost" if active.fault.kind == "drop" else ""
            self._on_event(t_ns, "fault", f"companion {active.fault.client}: {active.fault.kind} is over{more}")

    def loses(self, client: str, frame: int) -> bool:
        """Whether this frame never arrives."""
        lost = False
        for active in self._of(client, "drop"):
            drawn: Any = active.draws.uniform_block(frame // _BLOCK)[frame % _BLOCK, 0]
            if drawn < (active.fault.rate or 0.0):
                active.lost += 1
                lost = True
        return lost

    def late(self, client: str, from_ns: int) -> int:
        """When an answer holds that would hold from `from_ns` on."""
        delays = [round((a.fault.delay_s or 0.0) * NS_PER_S) for a in self._of(client, "delay")]
        if not delays and client not in self._after_ns:
            return from_ns
        holds_ns = max(from_ns + sum(delays), self._after_ns.get(client, 0))
        self._after_ns[client] = holds_ns
        if not delays and holds_ns == from_ns:
            del self._after_ns[client]  # it has caught up
        return holds_ns

    def unplugged(self, client: str) -> bool:
        """Whether it cannot come back yet."""
        return any(self._wall_ns() < active.end_wall_ns for active in self._of(client, "unplug"))

    def _of(self, client: str, kind: str) -> list[_Active]:
        return [a for a in self._going if a.fault.client == client and a.fault.kind == kind] if self._going else []
