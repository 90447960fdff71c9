"""Settings of a bench with several vehicles that belong to all of them together."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from hil.config.limit_values import DistanceLimit
from signals.documents.validate import Section

Offset = Annotated[float, Field(ge=-10_000, le=10_000)]


class Formation(Section):
    """Places of the vehicles relative to the first one, the leader [m]; they do not turn in flight.

    A vehicle without a start of its own stands at its place, and one without a mission of its own flies the bench's
    mission shifted to its place.
    """

    shape: Literal["wedge", "line", "column", "grid"] = "wedge"
    spacing_m: Annotated[float, Field(gt=0, le=1000)] = 5.0  # between neighbours, along each axis of the formation
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0  # counter-clockwise from east
    offsets_m: dict[str, tuple[Offset, Offset, Offset]] = Field(default_factory=dict)  # in W; replaces the shape's
    max_error_m: DistanceLimit | None = 2.0  # greatest distance of a vehicle from its place


class Group(Section):
    """Limits and effects between the vehicles; null: measured but not judged. Definitions: hil/run/verdict/group.py."""

    min_distance_m: Annotated[float, Field(gt=0)] | None = None  # between the centres of any two, one in the air
    contact: Literal["fail", "allow"] = "fail"
    downwash: bool = False  # the rotor wake of one vehicle acts on the vehicles below it (docs/physics.md)
