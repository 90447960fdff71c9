"""Moment of the air that flows across the vehicle. Equation: sim/native/forces/air_moment.cpp."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from sim import _kernels
from sim.physics.forces.force import Effects, ForceParameters

_PerSpeed = Annotated[float, Field(ge=-100.0, le=100.0)]


class AirMoment(ForceParameters):
    """Moment about x per velocity along y, and about y against the velocity along x; positive turns it back."""

    kind: Literal["air_moment"]
    about_x_ns: _PerSpeed  # [N m / (m/s)]
    about_y_ns: _PerSpeed

    def make(self, effects: Effects) -> _kernels.Force:
        del effects
        return _kernels.AirMoment(about_x_ns=self.about_x_ns, about_y_ns=self.about_y_ns)
