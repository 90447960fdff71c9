"""Buoyancy of a volume of lifting gas. Equation: sim/native/forces/buoyancy.cpp."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from signals.units import STANDARD_GRAVITY_MPS2
from sim import _kernels
from sim.physics.forces.force import Effects, ForceParameters, Point

_AIR_DENSITY_KGPM3 = 1.225  # ISA, sea level


class Buoyancy(ForceParameters):
    """Gas cell. The mass of the gas and of its hull is part of the vehicle's mass."""

    kind: Literal["buoyancy"]
    volume_m3: Annotated[float, Field(gt=0.0, le=1000.0)]
    centre_m: Point = (0.0, 0.0, 0.0)  # from the body origin

    def make(self, effects: Effects) -> _kernels.Force:
        del effects
        lift_n = _AIR_DENSITY_KGPM3 * STANDARD_GRAVITY_MPS2 * self.volume_m3
        return _kernels.Buoyancy(lift_n=lift_n, centre_m=self.centre_m)
