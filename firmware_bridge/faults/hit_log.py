"""Counts the hits of the declared link faults and reports them to the recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from firmware_bridge.codecs.dialect import NAME
from firmware_bridge.codecs.mavlink_frame import NO_FRAME, message_id
from firmware_bridge.faults.link_fault import Direction, LinkFault

EventSink = Callable[[int, str, str], None]  # t_ns, kind, text: `Recorder.event` fits

LISTED_PER_FAULT = 1000  # further hits are counted, and reported as a number at the end
_DONE = {"drop": "dropped", "delay": "delayed", "duplicate": "doubled", "reorder": "moved back", "corrupt": "damaged",
         "stall": "held back", "unplug": "unplugged"}  # fmt: skip
_DIRECTIONS = {"to_autopilot": "to the autopilot", "from_autopilot": "from the autopilot"}


def describe(unit: bytes) -> str:
    """Return a short description of a unit."""
    msgid = message_id(unit)
    if msgid == NO_FRAME:
        return f"byte 0x{unit.hex()}" if len(unit) == 1 else f"{len(unit)} bytes"
    return NAME.get(msgid, f"message {msgid}")


class HitLog:
    """Exact counts per fault; the first `LISTED_PER_FAULT` hits of each are events of their own."""

    def __init__(self, faults: Sequence[LinkFault], on_event: EventSink | None) -> None:
        self._faults = list(faults)
        self._on_event = on_event
        self._counts = [0] * len(self._faults)
        self._summarised = [LISTED_PER_FAULT] * len(self._faults)

    def add(self, fault: LinkFault) -> int:
        """Add a fault. Return its index."""
        self._faults.append(fault)
        self._counts.append(0)
        self._summarised.append(LISTED_PER_FAULT)
        return len(self._faults) - 1

    def counts(self) -> dict[int, int]:
        """Return the hits so far, by the fault's index."""
        return dict(enumerate(self._counts))

    def hit(self, index: int, direction: Direction, unit: bytes, t_ns: int) -> None:
        """Count a hit of fault `index` on `unit`."""
        self._counts[index] += 1
        count = self._counts[index]
        if self._on_event is None or count > LISTED_PER_FAULT:
            return
        text = f"{_DONE[self._faults[index].kind]} {describe(unit)} {_DIRECTIONS[direction]}"
        if count == LISTED_PER_FAULT:
            text += "; further hits are counted, not listed"
        self._report(index, text, t_ns)

    def plug(self, index: int, t_ns: int, *, out: bool) -> None:
        """Count fault `index` unplugging, and report it; plugging in again is reported only."""
        if out:
            self._counts[index] += 1
        self._report(index, "unplugged" if out else "plugged in again", t_ns)

    def _report(self, index: int, text: str, t_ns: int) -> None:
        """Send one event of fault `index`."""
        if self._on_event is not None:
            self._on_event(t_ns, "fault", f"link fault {index}: {text}")

    def summarise(self, t_ns: int) -> None:
        """Send one event for each fault with hits that were neither listed nor summarised."""
        for index, count in enumerate(self._counts):
            more = count - self._summarised[index]
            if more > 0:
                self._summarised[index] = count
                self._report(index, f"{_DONE[self._faults[index].kind]} {more} more units ({count} in all)", t_ns)
