"""Force along the axes of the world at the centre of mass. Equation: sim/native/forces/push.cpp."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from sim import _kernels
from sim.physics.forces.force import Effects, ForceParameters

_Newtons = Annotated[float, Field(ge=-1000.0, le=1000.0)]


class Push(ForceParameters):
    """Constant force, which `VehiclePhysics.set_push` changes in flight."""

    kind: Literal["push"]
    force_W_n: tuple[_Newtons, _Newtons, _Newtons] = (0.0, 0.0, 0.0)

    def make(self, effects: Effects) -> _kernels.Force:
        del effects
        return _kernels.Push(force_W_n=self.force_W_n)
