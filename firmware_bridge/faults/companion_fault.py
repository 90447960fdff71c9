"""Fault of the link to a companion as data, from a simulated time on. Kinds: hil/run/companion/link_faults.py."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from signals.documents.validate import Section
from signals.time import NS_PER_S

FOREVER_NS = 1 << 62


class CompanionFault(Section):
    """One fault of the link to one client."""

    kind: Literal["drop", "delay", "unplug"]
    client: Annotated[str, Field(min_length=1, max_length=64)]
    at_s: Annotated[float, Field(ge=0.0, le=86_400.0)]
    for_s: Annotated[float, Field(gt=0.0, le=86_400.0)] | None = None  # null: until the end of the run
    rate: Annotated[float, Field(ge=0.0, le=1.0)] | None = None  # drop
    delay_s: Annotated[float, Field(gt=0.0, le=10.0)] | None = None  # delay

    @model_validator(mode="after")
    def _fits_the_kind(self) -> CompanionFault:
        for name, kind in (("rate", "drop"), ("delay_s", "delay")):
            if (getattr(self, name) is not None) != (self.kind == kind):
                raise ValueError(f"{name} is required for the kind {kind!r} and not allowed for other kinds")
        return self

    @property
    def begin_ns(self) -> int:
        return round(self.at_s * NS_PER_S)

    @property
    def end_ns(self) -> int:
        return self.begin_ns + self.length_ns

    @property
    def length_ns(self) -> int:
        return FOREVER_NS if self.for_s is None else round(self.for_s * NS_PER_S)
