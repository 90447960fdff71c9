"""Faults of control surfaces at a simulated time, as data.

    - {kind: stuck, surface: elevator, at_s: 12.0, angle_deg: 8}   runs to that angle and ignores commands
    - {kind: stuck, surface: elevator, at_s: 12.0}                 stays where it is
    - {kind: floating, surface: elevator, at_s: 12.0}              no servo holds it: the air carries it to 0
    - {kind: lost, surface: elevator, at_s: 12.0}                  torn off: no effect on the air

A tilt is named like a surface. A floating one swings to its angle 0, an estimate; a lost one takes its rotors along.

A fault begins at the first tick at or after `at_s` and lasts. A later fault of the same surface replaces the earlier.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.time import NS_PER_S
from sim import _kernels
from sim.physics.faults import RotorFault
from sim.physics.vehicle import Vehicle

_STATES = {
    "stuck": _kernels.SurfaceState.STUCK,
    "floating": _kernels.SurfaceState.FLOATING,
    "lost": _kernels.SurfaceState.LOST,
}


class SurfaceFault(StrictModel):
    """Fault of one control surface from one instant on."""

    kind: Literal["stuck", "floating", "lost"]
    surface: Annotated[str, Field(min_length=1, max_length=64)]  # its name in the vehicle's file
    at_s: Annotated[float, Field(ge=0.0, le=86_400.0)]
    angle_deg: Annotated[float, Field(ge=-180.0, le=180.0)] | None = None  # stuck: default where it is then

    @pydantic.model_validator(mode="after")
    def _fits_kind(self) -> SurfaceFault:
        if self.angle_deg is not None and self.kind != "stuck":
            raise ValueError(f"angle_deg has no meaning for the kind {self.kind!r}")
        return self

    def start_tick(self, tick_ns: int) -> int:
        """Return the first tick at or after `at_s`."""
        return -(-round(self.at_s * NS_PER_S) // tick_ns)

    @property
    def state(self) -> _kernels.SurfaceState:
        """State of the surface in the kernel."""
        return _STATES[self.kind]

    def stuck_rad(self, now_rad: float) -> float:
        """Return the angle at which it stays, for a surface that is at `now_rad`."""
        return now_rad if self.angle_deg is None else math.radians(self.angle_deg)

    @property
    def text(self) -> str:
        """Text of the event in the recording."""
        at = "" if self.angle_deg is None else f" at {self.angle_deg:g} degrees"
        return f"surface {self.surface}: {self.kind}{at}"


VehicleFault = RotorFault | SurfaceFault


def surface_misfits(faults: Sequence[SurfaceFault], vehicle: Vehicle) -> list[tuple[int, str, str]]:
    """Return (index, key, message) of faults of surfaces that the vehicle does not have."""
    names = [servo.name for servo in vehicle.servos]
    known = f"has {', '.join(names)}" if names else "has no control surfaces"
    return [
        (index, "surface", f"names {fault.surface!r}, but the vehicle {known}")
        for index, fault in enumerate(faults)
        if fault.surface not in names
    ]


def check_surface_faults(faults: Sequence[SurfaceFault], vehicle: Vehicle) -> None:
    """Raise ValueError, which names every fault that does not fit the vehicle."""
    problems = surface_misfits(faults, vehicle)
    if problems:
        raise ValueError("; ".join(f"faults[{index}].{key} {message}" for index, key, message in problems))
