"""Aircraft by one set of stability derivatives, as they are published. Equations: sim/native/forces/aero_table.cpp.

Axes, signs and units of the derivatives are those of Beard and McLain, Small Unmanned Aircraft, ch. 4: x ahead, y
right, z down; per rad, of deflections too; rates over 2 V / chord for pitch and 2 V / span for roll and yaw. A
published table is entered as it is printed: C_L_alpha is `lift: {alpha: ...}`, C_n_p is `yaw: {p: ...}`, C_m_delta_e
is `controls: {elevator: {pitch: ...}}`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from sim import _kernels
from sim.physics.forces.force import Effects, Point
from sim.physics.forces.surface import Surface, check_names
from sim.physics.forces.wing import Corners, Sphere, WingParameters, spindle, tapered

_Value = Annotated[float, Field(ge=-1000.0, le=1000.0)]
_Length = Annotated[float, Field(gt=1e-3, le=100.0)]
_Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


class Lift(StrictModel):
    """C_L."""

    zero: _Value = 0.0
    alpha: Annotated[float, Field(gt=0.0, le=20.0)]
    q: _Value = 0.0


class Drag(StrictModel):
    """C_D: a polynomial in alpha, or the induced drag of the lift with Oswald's factor, C_L^2 / (pi e b^2 / S)."""

    zero: Annotated[float, Field(ge=0.0, le=10.0)]
    alpha: _Value = 0.0
    alpha2: _Value = 0.0
    oswald_factor: Annotated[float, Field(gt=0.1, le=2.0)] | None = None
    q: _Value = 0.0
    beta: _Value = 0.0
    beta2: _Value = 0.0

    @pydantic.model_validator(mode="after")
    def _one_form(self) -> Drag:
        if self.oswald_factor is not None and (self.alpha != 0.0 or self.alpha2 != 0.0):
            raise ValueError("has two forms of the same drag: give alpha and alpha2, or oswald_factor")
        return self


class Pitch(StrictModel):
    """C_m."""

    zero: _Value = 0.0
    alpha: _Value
    q: Annotated[float, Field(ge=-1000.0, le=0.0)]


class Lateral(StrictModel):
    """C_Y, C_l or C_n."""

    zero: _Value = 0.0
    beta: _Value
    p: _Value = 0.0
    r: _Value = 0.0


class Control(StrictModel):
    """Derivatives by the deflection of one control, such as the elevator."""

    lift: _Value = 0.0
    drag: _Value = 0.0
    drag2: _Value = 0.0  # by its square
    side: _Value = 0.0
    roll: _Value = 0.0
    pitch: _Value = 0.0
    yaw: _Value = 0.0


class MovingSurface(Surface):
    """Surface that moves controls: an elevon has half of the elevator's deflection and half of the aileron's."""

    moves: dict[_Name, Annotated[float, Field(ge=-10.0, le=10.0)]]


class Stall(StrictModel):
    """Limits of attached flow: alpha_0, beta_0 and M of the equations."""

    alpha_deg: Annotated[float, Field(gt=1.0, le=60.0)]
    sideslip_deg: Annotated[float, Field(gt=1.0, le=60.0)] = 35.0  # estimate
    sharpness: Annotated[float, Field(ge=10.0, le=200.0)] = 50.0  # M, of Beard and McLain


class Separated(StrictModel):
    """Separated flow: coefficients of a flat plate, and the share that is left of the effect of the surfaces."""

    normal: Annotated[float, Field(ge=0.0, le=4.0)] = 2.0  # Beard and McLain, eq. 4.9
    pitch: Annotated[float, Field(ge=-4.0, le=4.0)] = -0.2  # estimate: about that of PyFly's Skywalker X8
    surface_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.3  # estimate


class AeroTable(WingParameters):
    """Aerodynamics of a whole aircraft, with its control surfaces."""

    kind: Literal["aero_table"]
    area_m2: Annotated[float, Field(gt=1e-4, le=1000.0)]
    chord_m: _Length
    span_m: _Length
    reference_m: Point = (0.0, 0.0, 0.0)  # for which the moments hold, from the centre of mass
    lift: Lift
    drag: Drag
    pitch: Pitch
    side: Lateral
    roll: Lateral
    yaw: Lateral
    controls: dict[_Name, Control] = Field(default_factory=dict)
    surfaces: Annotated[tuple[MovingSurface, ...], Field(max_length=16)] = ()
    stall: Stall
    separated: Separated = Separated()

    @pydantic.model_validator(mode="after")
    def _fits(self) -> AeroTable:
        check_names(self.surfaces)
        if len(self.controls) > 8:
            raise ValueError(f"controls: at most 8, not {len(self.controls)}")
        for surface in self.surfaces:
            unknown = [name for name in surface.moves if name not in self.controls]
            if unknown:
                known = ", ".join(self.controls) or "none"
                raise ValueError(f"surface {surface.name} moves {unknown[0]}, and controls has {known}")
        if self.roll.p > 0.0 or self.yaw.r > 0.0:
            raise ValueError("roll.p and yaw.r damp the rates about their own axes: they must be 0 or less")
        return self

    @property
    def mean_chord_m(self) -> float:
        return self.chord_m

    def solids(self, hull: Sequence[Sphere]) -> list[Corners]:
        """Draw a wing of the chord, to the hull's spheres at its tips, and a body along the others."""
        x, y, z = self.reference_m
        quarter, half_m = (0.25 * self.chord_m, 0.0, 0.0), 0.5 * self.span_m
        tips = [(p[0] + 0.25 * self.chord_m, p[1], p[2]) for p, _ in hull if abs(p[1] - y) > 0.8 * half_m]
        ends = tips or [(x, y + half_m, z), (x, y - half_m, z)]
        solids = [tapered(((x, y, z), quarter), (end, quarter)) for end in ends]
        middle = sorted((p, r) for p, r in hull if abs(p[1] - y) < 0.1 * half_m)
        if len(middle) > 1:
            tail, nose, width_m = middle[0][0], middle[-1][0], 2.0 * max(r for _, r in middle)
            solids.append(spindle(nose, tail, width_m, width_m))
        return solids

    def make(self, effects: Effects) -> _kernels.Force:
        del effects
        d, share = self.drag, []
        induced = 0.0
        if d.oswald_factor is not None:
            induced = self.area_m2 / (math.pi * d.oswald_factor * self.span_m**2)
        for surface in self.surfaces:
            share += [surface.moves.get(name, 0.0) for name in self.controls]
        return _kernels.AeroTable(
            area_m2=self.area_m2,
            chord_m=self.chord_m,
            span_m=self.span_m,
            lift=[self.lift.zero, self.lift.alpha, self.lift.q],
            drag=[d.zero, d.alpha, d.alpha2, induced, d.q, d.beta, d.beta2],
            pitch=[self.pitch.zero, self.pitch.alpha, self.pitch.q],
            side=_lateral(self.side),
            roll=_lateral(self.roll),
            yaw=_lateral(self.yaw),
            controls=[(c.lift, c.drag, c.drag2, c.side, c.roll, c.pitch, c.yaw) for c in self.controls.values()],
            surfaces=[surface.servo for surface in self.surfaces],
            share=share,
            attached=(math.radians(self.stall.alpha_deg), math.radians(self.stall.sideslip_deg), self.stall.sharpness),
            separated=(self.separated.normal, self.separated.pitch, self.separated.surface_share),
            reference_m=self.reference_m,
        )


def _lateral(c: Lateral) -> list[float]:
    return [c.zero, c.beta, c.p, c.r]
