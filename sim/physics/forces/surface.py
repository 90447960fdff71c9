"""Control surfaces of a force, and the servos that move them. Equations: sim/native/forces/servos.hpp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Protocol

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel

_Degrees = Annotated[float, Field(ge=-90.0, le=90.0)]


def kernel_servo(
    max_deg: float, min_deg: float, rate_degps: float | None, time_constant_s: float
) -> tuple[float, float, float, float]:
    """Return angle at command 1 and -1 [rad], rate [rad/s] or 0, time constant [s], as the kernels take a servo."""
    rate = 0.0 if rate_degps is None else math.radians(rate_degps)
    return math.radians(max_deg), math.radians(min_deg), rate, time_constant_s


class Surface(StrictModel):
    """One surface with its servo. A positive deflection moves the trailing edge down, of a rudder to the left."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    max_deg: _Degrees  # at command +1
    min_deg: _Degrees  # at command -1
    rate_degps: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = None  # null: no limit
    time_constant_s: Annotated[float, Field(ge=1e-3, le=2.0)]

    @pydantic.model_validator(mode="after")
    def _moves(self) -> Surface:
        if self.max_deg * self.min_deg > 0.0 or self.max_deg == self.min_deg:
            raise ValueError(
                f"max_deg {self.max_deg:g} and min_deg {self.min_deg:g}: the neutral angle 0 must be between them"
            )
        return self

    @property
    def servo(self) -> tuple[float, float, float, float]:
        """Its servo as the kernel takes it (`kernel_servo`)."""
        return kernel_servo(self.max_deg, self.min_deg, self.rate_degps, self.time_constant_s)

    def deflection_rad(self, command: float) -> float:
        """Return the deflection at which the surface rests under a command of -1..1."""
        most, least, *_ = self.servo
        return command * most if command >= 0.0 else -command * least


class Named(Protocol):
    """Anything with a name."""

    @property
    def name(self) -> str: ...


def check_names(named: Sequence[Named]) -> None:
    """Raise ValueError if two of what servos move have the same name."""
    names = [of.name for of in named]
    twins = sorted({name for name in names if names.count(name) > 1})
    if twins:
        raise ValueError(f"surfaces and tilts must have different names: {', '.join(twins)} is there twice")
