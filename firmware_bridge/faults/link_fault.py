"""Faults of the link to the autopilot as data, each from a simulated time on.

    - {kind: drop,      at_s: 20, for_s: 5, rate: 0.01}                       1 % of all messages vanish
    - {kind: drop,      at_s: 20, rate: 0.1, messages: [HIL_GPS]}             only those messages
    - {kind: delay,     at_s: 20, rate: 1, delay_s: 0.02}                     later messages wait too, as on a line
    - {kind: duplicate, at_s: 20, rate: 0.001, direction: from_autopilot}
    - {kind: reorder,   at_s: 20, rate: 0.01, burst: 2}                       overtaken by the next two units
    - {kind: corrupt,   at_s: 20, rate: 0.0001, unit: byte}                   that byte gets another value
    - {kind: stall,     at_s: 20, for_s: 0.5}                                 no unit passes until it ends
    - {kind: unplug,    at_s: 20, for_s: 2}                                   the port is gone until it ends

A fault holds while at_s <= t < at_s + for_s (to the end without `for_s`), t being simulated time. `rate` is the
probability of each unit to be hit. A unit is a whole MAVLink frame, or one byte (`unit: byte`); bytes outside any frame
are units of their own. `burst`: that many units in a row are hit, so the share of units hit is about rate * burst.

Two kinds of time. A fault begins at a simulated time. A unit is held back, `delay_s`, for a wall-clock time, as on a
real line. At real time both are the same. In lockstep simulated time stands still while the bench waits, so a delay
below the reply limit only makes the run slower, and one above it ends in LockstepLost. For the same reason `for_s` of a
stall or an unplug ends by the clock that reaches it first, counted from the first use of the link within it.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from firmware_bridge.codecs.messages import MSGID
from signals.documents.validate import Section, nearest
from signals.time import NS_PER_S

Kind = Literal["drop", "delay", "duplicate", "reorder", "corrupt", "stall", "unplug"]
Direction = Literal["to_autopilot", "from_autopilot"]

REORDER_WAIT_S = 0.02  # how long a unit waits, at most, for others to overtake it, unless `delay_s` says otherwise
_WHOLE_LINE = ("stall", "unplug")  # kinds that hit all units
_FOREVER_NS = 1 << 62


class LinkFault(Section):
    """One fault of the link."""

    kind: Kind
    direction: Literal["to_autopilot", "from_autopilot", "both"] = "both"
    at_s: Annotated[float, Field(ge=0.0, le=86_400.0)]
    for_s: Annotated[float, Field(gt=0.0, le=86_400.0)] | None = None  # null: to the end
    rate: Annotated[float, Field(ge=0.0, le=1.0)] | None = None  # all but stall and unplug
    unit: Literal["message", "byte"] = "message"
    messages: tuple[str, ...] = ()  # only messages of these names; empty: all, and bytes that are not a message
    burst: Annotated[int, Field(ge=1, le=10_000)] = 1  # units hit in a row; reorder: units that overtake
    delay_s: Annotated[float, Field(gt=0.0, le=3600.0)] | None = None  # wall clock; delay, reorder

    @field_validator("messages")
    @classmethod
    def _known_messages(cls, messages: tuple[str, ...]) -> tuple[str, ...]:
        for name in messages:
            if name not in MSGID:
                hint = nearest(name, MSGID, listed=False)
                raise ValueError(f"{name[:100]!r} is not a MAVLink message of this dialect{hint and '; ' + hint}")
        return messages

    @model_validator(mode="after")
    def _fits_the_kind(self) -> LinkFault:
        kind = self.kind
        if kind in _WHOLE_LINE:
            given = {
                "rate": self.rate is not None,
                "unit": self.unit != "message",
                "messages": bool(self.messages),
                "burst": self.burst != 1,
            }
            for name, is_given in given.items():
                if is_given:
                    raise ValueError(f"{name} has no meaning for the kind {kind!r}, which hits the whole line")
        elif self.rate is None:
            raise ValueError(f"the kind {kind!r} needs rate, 0 to 1")
        if kind == "unplug" and self.direction != "both":
            raise ValueError("direction has no meaning for the kind 'unplug': a plug carries both")
        if kind == "delay" and self.delay_s is None:
            raise ValueError("the kind 'delay' needs delay_s, seconds of wall clock")
        if kind not in ("delay", "reorder") and self.delay_s is not None:
            raise ValueError(f"delay_s has no meaning for the kind {kind!r}")
        if self.messages and self.unit == "byte":
            raise ValueError("messages has no meaning for unit 'byte'")
        return self

    @property
    def begin_ns(self) -> int:
        """Begin [ns of simulated time]."""
        return round(self.at_s * NS_PER_S)

    @property
    def length_ns(self) -> int:
        """Duration [ns]; without an end, longer than any run."""
        return _FOREVER_NS if self.for_s is None else round(self.for_s * NS_PER_S)

    @property
    def hold_ns(self) -> int:
        """Time that a delayed unit is held back, and a reordered one at most [ns of wall clock]."""
        return round((self.delay_s or REORDER_WAIT_S) * NS_PER_S)

    def chance_of_no_hit(self, count: int) -> float:
        """Return the probability, over all seeds, that none of `count` units is hit, which the fault acts on."""
        return (1.0 - (1.0 if self.rate is None else self.rate)) ** count

    def acts_on(self, direction: Direction) -> bool:
        """Return True if units that travel in `direction` are hit."""
        return self.direction in ("both", direction)
