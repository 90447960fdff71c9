"""Sensors in the profile of an autopilot: the fields that it takes, and the faults of them that reach it.

`Profile.sensors` maps a kind of sensor ("gps") to one of

    Samples      the autopilot gets the bench's samples, so the faults in them
    Simulated    the firmware simulates this sensor itself and gets no sample of the bench. Parameters of its simulation
                 have the meaning of some faults

A kind that is not there reaches nothing. Kinds of sensors and faults are named as in a bench file, fields as in
`signals.samples`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

_OF_FIELDS = ("offset", "drift", "stuck_bit")
_AXES = "xyz"


class Held(NamedTuple):
    """A parameter that has `value` while a fault holds."""

    name: str
    value: float


class Added(NamedTuple):
    """A parameter to which `convert(offset, altitude_m)` is added while a fault offsets `axis` of a field.

    The offset is in the unit of the sample's field and in its frame; the altitude is the vehicle's start above mean
    sea level.
    """

    name: str
    convert: Callable[[float, float], float]
    axis: int = 0


# One parameter under the names that it has in different versions of the firmware, the newest first.
Change = tuple[Held, ...] | tuple[Added, ...]


class Delay(NamedTuple):
    """Parameters that tell the autopilot how old a sample is when it arrives [ms], and the most that is documented.

    `names`: those of all versions of the firmware, the oldest first; it ignores the ones that it does not have.
    """

    names: tuple[str, ...]
    most_ms: float


@dataclass(frozen=True)
class Samples:
    """The autopilot gets the bench's samples.

    `fields`: those fields of a sample that it gets. `whole`: faults of the whole sample that reach it as what they are.
    `parameters`: those without which its firmware would not use them. `direction`: parameter that tells it where the
    sensor looks, as a MAV_SENSOR_ROTATION; None: the samples carry their axis. `limits`: those that tell it the least
    and the greatest distance [m]. `delay`: what tells it how old a sample is when it arrives. `replaced`: by field, the
    kind of sensor that gives it in place of this one.
    """

    fields: tuple[str, ...]
    whole: tuple[str, ...] = ("dropout", "freeze")
    parameters: Mapping[str, float] = field(default_factory=dict)
    direction: str | None = None
    limits: tuple[str, str] | None = None
    delay: Delay | None = None
    replaced: Mapping[str, str] = field(default_factory=dict)

    def takes(self, fault: str, field: str | None) -> bool:
        """Return True if a fault of this kind reaches the autopilot; `field`: the one on which it acts."""
        return fault in self.whole if field is None else field in self.fields

    def faults(self) -> str:
        """Describe the faults that reach the autopilot."""
        return f"{', '.join(self.whole)}; {', '.join(_OF_FIELDS)} of {', '.join(self.fields)}"


@dataclass(frozen=True)
class Simulated:
    """The firmware simulates the sensor itself; its parameters have the meaning of these faults."""

    dropout: tuple[Change, ...] = ()
    freeze: tuple[Change, ...] = ()
    offset: Mapping[str, tuple[Change, ...]] = field(default_factory=dict)  # by field; drifts use them too

    def changes(self, fault: str, field: str | None, axis: int | None = None) -> tuple[Change, ...]:
        """Return the parameters of a fault; empty: the firmware has none. `axis` None: all."""
        if fault in ("offset", "drift"):
            changes = self.offset.get(field or "", ())
            return tuple(change for change in changes if axis is None or _axis(change) == axis)
        return {"dropout": self.dropout, "freeze": self.freeze}.get(fault, ())

    def takes(self, fault: str, field: str | None) -> bool:
        """Return True if parameters have the meaning of a fault of this kind; `field`: the one on which it acts."""
        return bool(self.changes(fault, field))

    def faults(self) -> str:
        """Describe the faults that parameters can make."""
        whole = [fault for fault in ("dropout", "freeze") if self.changes(fault, None)]
        return "; ".join([*whole, f"offset, drift of {', '.join(self.offset)}"] if self.offset else whole)


Intake = Samples | Simulated


def _axis(change: Change) -> int:
    return change[0].axis if isinstance(change[0], Added) else 0


def axis_number(axis: str | None) -> int | None:
    """Return the number of an axis x, y or z; None for all."""
    return None if axis is None else _AXES.index(axis)
