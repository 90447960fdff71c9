"""Tilts: servos that turn the axes of rotors. Equations: sim/native/forces/tilts.cpp.

At the angle 0 a rotor is as `rotors` has it, which is how it hovers. All vectors are in B (FLU).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.rotation import minus
from signals.samples import Vec3
from sim import _kernels
from sim.physics.forces.force import Point
from sim.physics.forces.rotors import Component, Rotor, RotorGroup, unit_vector
from sim.physics.forces.surface import kernel_servo

_Degrees = Annotated[float, Field(ge=-180.0, le=180.0)]


class Tilt(StrictModel):
    """One servo with the rotors that it turns about a hinge, positive by the right-hand rule about `axis`."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    rotors: Annotated[tuple[Annotated[int, Field(ge=0, le=7)], ...], Field(min_length=1, max_length=8)]
    axis: tuple[Component, Component, Component] = (0.0, 1.0, 0.0)  # of the hinge; along y, up turns ahead
    hinge_m: Point | None = None  # a point of the hinge; null: each rotor turns about its own place
    max_deg: _Degrees  # at command +1
    min_deg: _Degrees  # at command -1; linear in between
    rate_degps: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = None  # null: no limit
    time_constant_s: Annotated[float, Field(ge=1e-3, le=2.0)]

    @pydantic.field_validator("axis")
    @classmethod
    def _unit_vector(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        return unit_vector(axis, "a hinge across the body has [0, 1, 0]")

    @pydantic.model_validator(mode="after")
    def _moves(self) -> Tilt:
        if not (min(self.max_deg, self.min_deg) <= 0.0 <= max(self.max_deg, self.min_deg)):
            raise ValueError(
                f"max_deg {self.max_deg:g} and min_deg {self.min_deg:g}: the angle 0, at which the rotors are as the "
                "file has them, must be between them"
            )
        if self.max_deg == self.min_deg:
            raise ValueError(f"max_deg and min_deg are both {self.max_deg:g}: the tilt does not move")
        return self

    @property
    def servo(self) -> tuple[float, float, float, float]:
        """Its servo as the kernel takes it (`kernel_servo`)."""
        return kernel_servo(self.max_deg, self.min_deg, self.rate_degps, self.time_constant_s)

    def deflection_rad(self, command: float) -> float:
        """Return the angle at which the tilt rests under a command of -1..1."""
        most, least, *_ = self.servo
        return 0.5 * (most + least) + 0.5 * command * (most - least)

    def command_of(self, angle_rad: float) -> float:
        """Return the command under which the tilt rests at an angle."""
        most, least, *_ = self.servo
        return (2.0 * angle_rad - most - least) / (most - least)

    @property
    def hover_command(self) -> float:
        """Command of the angle 0."""
        return self.command_of(0.0)

    def turned(self, rotor: Rotor, angle_rad: float) -> Rotor:
        """Return a rotor of this tilt as it is at an angle."""
        axis = rotated(rotor.axis, self.axis, angle_rad)
        if self.hinge_m is None:
            return rotor.model_copy(update={"axis": axis})
        arm = minus(rotor.position_m, self.hinge_m)
        x, y, z = rotated(arm, self.axis, angle_rad)
        cx, cy, cz = self.hinge_m
        return rotor.model_copy(update={"axis": axis, "position_m": (cx + x, cy + y, cz + z)})

    def ahead_rad(self, rotors: Sequence[Rotor]) -> float:
        """Return the angle at which its rotors point most ahead."""
        most, least, *_ = self.servo

        def ahead(angle_rad: float) -> float:
            return sum(rotated(rotors[i].axis, self.axis, angle_rad)[0] for i in self.rotors)

        # Of a sinusoid c + A cos(t - t0): its top, if the tilt reaches it, else the better end.
        middle = ahead(0.5 * math.pi) - ahead(-0.5 * math.pi), ahead(0.0) - ahead(math.pi)
        top = math.atan2(middle[0], middle[1])
        reached = [top] if min(most, least) <= top <= max(most, least) else []
        return max((*reached, most, least, 0.0), key=lambda angle: (round(ahead(angle), 12), -abs(angle)))


def rotated(v: Vec3, axis: Vec3, angle_rad: float) -> Vec3:
    """Return a vector turned about a unit vector."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    (x, y, z), (a, b, d) = v, axis
    along = (a * x + b * y + d * z) * (1.0 - c)
    return (
        x * c + (b * z - d * y) * s + a * along,
        y * c + (d * x - a * z) * s + b * along,
        z * c + (a * y - b * x) * s + d * along,
    )


def check_tilts(tilts: Sequence[Tilt], rotors: Sequence[Rotor]) -> None:
    """Raise ValueError unless each tilt has rotors of its own that exist, and coaxial pairs tilt together."""
    carrier: dict[int, str] = {}
    for tilt in tilts:
        for i in tilt.rotors:
            if i >= len(rotors):
                raise ValueError(f"tilt {tilt.name} has rotor {i}, and the vehicle has rotors 0 to {len(rotors) - 1}")
            if i in carrier:
                raise ValueError(f"rotor {i} is on the tilts {carrier[i]} and {tilt.name}: it can be on one only")
            carrier[i] = tilt.name
    hinged = {tilt.name for tilt in tilts if tilt.hinge_m is not None}
    for i, rotor in enumerate(rotors):
        above = rotor.coaxial_below
        if above is None or (carrier.get(i) is None and carrier.get(above) is None):
            continue
        if carrier.get(i) != carrier.get(above) or carrier.get(i) not in hinged:
            raise ValueError(
                f"rotor {i} is coaxial below rotor {above}: both must be on the same tilt, and it needs a hinge_m"
            )


def tilts_force(
    tilts: Sequence[Tilt], rotors: Sequence[Rotor], groups: Sequence[RotorGroup], forces: Sequence[_kernels.Rotors]
) -> _kernels.Tilts:
    """Return the force that turns the rotors of `forces`, one of each group; it stands after them."""
    carried = [(tilt, k, i) for k, tilt in enumerate(tilts) for i in tilt.rotors]
    home = {i: (force, i - group.first) for group, force in zip(groups, forces, strict=True) for i in group.indices}
    return _kernels.Tilts(
        servos=[tilt.servo for tilt in tilts],
        rotors=[home[i][0] for _, _, i in carried],
        rotor=[home[i][1] for _, _, i in carried],
        tilt=[k for _, k, _ in carried],
        axis=[tilt.axis for tilt, _, _ in carried],
        hinge_m=[rotors[i].position_m if tilt.hinge_m is None else tilt.hinge_m for tilt, _, i in carried],
    )
