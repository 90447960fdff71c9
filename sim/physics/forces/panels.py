"""Aircraft by its geometry: wings, tails and bodies in panels. Equations: sim/native/forces/panels.hpp.

Points are in B (FLU, origin at the centre of mass). A half of a wing is cut into n panels at the shares sin(pi k / 2 n)
of its length, closer at the tip, where the lift falls; where wings meet, at (1 - cos(pi k / n)) / 2, closer at both
ends, because the lift of one runs over to the other there. A surface acts on a panel by the share of its width that it
takes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

import pydantic
from pydantic import Field

from signals._kernel import det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.samples import Vec3
from sim import _kernels
from sim.physics.forces.airfoil import Airfoil, flap_of, plate_drag, stall_of
from sim.physics.forces.force import Effects, Point
from sim.physics.forces.surface import Surface, check_names
from sim.physics.forces.wing import Corners, Sphere, WingParameters, spindle, tapered

MOST_LIFTING, MOST_PLATES = 40, 24  # panels that the kernel holds
_MEETING = 0.05  # distance of the roots of wings that meet, over the shorter half
_Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
_Length = Annotated[float, Field(gt=1e-3, le=50.0)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]


class Wing(StrictModel):
    """A wing, tailplane or fin: trapezoid halves from the root. A fin is one half with a dihedral of 90 degrees."""

    name: _Name
    root_m: Point  # quarter-chord point of the root; of the left half, if there are two
    span_m: _Length  # along the wing, of both halves together
    root_chord_m: _Length
    tip_chord_m: _Length
    symmetric: bool = True  # two halves, to the left and its mirror image to the right; else the left one alone
    sweep_deg: Annotated[float, Field(ge=-70.0, le=70.0)] = 0.0  # of the quarter-chord line
    dihedral_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0
    incidence_deg: Annotated[float, Field(ge=-30.0, le=30.0)] = 0.0  # of the root, nose up
    twist_deg: Annotated[float, Field(ge=-20.0, le=20.0)] = 0.0  # of the tip against the root, nose up
    airfoil: Airfoil
    panels: Annotated[int, Field(ge=1, le=16)] = 4  # of each half

    @property
    def half_m(self) -> float:
        return 0.5 * self.span_m if self.symmetric else self.span_m

    @property
    def area_m2(self) -> float:
        return 0.5 * (self.root_chord_m + self.tip_chord_m) * self.span_m

    @property
    def aspect_ratio(self) -> float:
        return self.span_m * self.span_m / self.area_m2


class WingSurface(Surface):
    """Trailing-edge flap on a part of a wing, with its servo."""

    wing: _Name
    # Both halves: alike, or the right one against the left, whose trailing edge moves down; or one half alone.
    side: Literal["both", "antisymmetric", "left", "right"] = "both"
    span: tuple[_Share, _Share]  # of the half, from the root
    chord_ratio: Annotated[float, Field(gt=0.01, le=1.0)]  # 1: the wing turns as a whole
    effectiveness: Annotated[float, Field(gt=0.0, le=1.2)] = 0.8  # of thin airfoil theory; estimate for plain flaps

    @pydantic.model_validator(mode="after")
    def _has_span(self) -> WingSurface:
        if self.span[1] - self.span[0] < 0.02:
            raise ValueError(f"span {list(self.span)} must be two shares of the half, the inner one first")
        return self

    def gearing(self, half: int) -> float:
        """Return the deflection of the left (0) or right (1) half over that of the surface; 0 where it has none."""
        return {"both": (1.0, 1.0), "antisymmetric": (1.0, -1.0), "left": (1.0, 0.0), "right": (0.0, 1.0)}[self.side][
            half
        ]


class PlateBody(StrictModel):
    """A fuselage or pod: a plate of its width and one of its height, each in segments, and a drag area along it."""

    name: _Name
    nose_m: Point
    tail_m: Point
    width_m: _Length
    height_m: _Length
    drag_area_m2: Annotated[float, Field(ge=0.0, le=10.0)]
    cross_drag: Annotated[float, Field(ge=0.0, le=3.0)] = (
        1.0  # of the plates; a cylinder 1.2, rounded 0.6: Hoerner, 3.9
    )
    segments: Annotated[int, Field(ge=1, le=6)] = 2

    @pydantic.model_validator(mode="after")
    def _lies_along_x(self) -> PlateBody:
        if self.nose_m[0] - self.tail_m[0] < 1e-3:
            raise ValueError(f"nose_m {list(self.nose_m)} must be ahead of tail_m {list(self.tail_m)}")
        return self


class Panels(WingParameters):
    """Aerodynamics by panels, with control surfaces; their commands are in the order of `surfaces`."""

    kind: Literal["panels"]
    wings: Annotated[tuple[Wing, ...], Field(min_length=1, max_length=8)]
    bodies: Annotated[tuple[PlateBody, ...], Field(max_length=6)] = ()
    surfaces: Annotated[tuple[WingSurface, ...], Field(max_length=16)] = ()

    @pydantic.model_validator(mode="after")
    def _fits(self) -> Panels:
        check_names(self.surfaces)
        names = [wing.name for wing in self.wings] + [body.name for body in self.bodies]
        if len(set(names)) != len(names):
            raise ValueError(f"wings and bodies must have different names, not {names}")
        wings = {wing.name: wing for wing in self.wings}
        for surface in self.surfaces:
            if surface.wing not in wings:
                raise ValueError(f"surface {surface.name} is on {surface.wing}, and the wings are {', '.join(wings)}")
            if not wings[surface.wing].symmetric and surface.side in ("right", "antisymmetric"):
                raise ValueError(
                    f"surface {surface.name} has the side {surface.side}, and {surface.wing} has one half: both or left"
                )
        for wing in self.wings:
            for half in (0, 1):
                parts = sorted((s.span, s.name) for s in self.surfaces if s.wing == wing.name and s.gearing(half))
                for (inner, a), (outer, b) in itertools.pairwise(parts):
                    if outer[0] < inner[1]:
                        raise ValueError(f"surfaces {a} and {b} share a part of the span of {wing.name}")
        lifting = sum(panel.wing >= 0 for panel in self.layout())
        plates = sum(2 * body.segments for body in self.bodies)
        if lifting > MOST_LIFTING or plates > MOST_PLATES:
            raise ValueError(
                f"{lifting} panels of wings and {plates} of bodies: at most {MOST_LIFTING} and {MOST_PLATES} are "
                "possible. Lower `panels` or `segments`"
            )
        return self

    @property
    def mean_chord_m(self) -> float | None:
        """Mean chord of the first wing."""
        return self.wings[0].area_m2 / self.wings[0].span_m

    def layout(self) -> list[PanelPlace]:
        """Return the panels: those of the wings in their order, left half first, then the plates of the bodies."""
        places: list[PanelPlace] = []
        for index, wing in enumerate(self.wings):
            on_wing = [(i, s) for i, s in enumerate(self.surfaces) if s.wing == wing.name]
            for half in range(2 if wing.symmetric else 1):
                places += _half_wing(index, wing, half, on_wing, sheet=self._sheet(wing))
        for body in self.bodies:
            places += _plates(body)
        return places

    def solids(self, hull: Sequence[Sphere]) -> list[Corners]:
        del hull
        halves = [(wing, half) for wing in self.wings for half in range(2 if wing.symmetric else 1)]
        wings = [tapered(_station(wing, half, 0.0), _station(wing, half, 1.0)) for wing, half in halves]
        return wings + [spindle(body.nose_m, body.tail_m, body.width_m, body.height_m) for body in self.bodies]

    def _sheet(self, wing: Wing) -> int | None:
        """Return the first of the wings with roots at that of `wing`, as a fin and a tailplane; None if it is alone."""
        x, y, z = wing.root_m
        meeting = []
        for index, other in enumerate(self.wings):
            along, near_m = 0.5 * (wing.root_chord_m + other.root_chord_m), _MEETING * min(wing.half_m, other.half_m)
            ox, oy, oz = other.root_m
            if other is wing or (abs(ox - x) < along and math.hypot(oy - y, oz - z) < near_m):
                meeting.append(index)
        return meeting[0] if len(meeting) > 1 else None

    def make(self, effects: Effects) -> _kernels.Panels:
        return _kernels.Panels(
            panels=[self._panel(place) for place in self.layout()],
            surfaces=[surface.servo for surface in self.surfaces],
            ground_span_m=max(wing.span_m for wing in self.wings) if effects.ground_effect else 0.0,
        )

    def _panel(self, place: PanelPlace) -> _kernels.Panel:
        if place.body is not None:
            body = place.body
            length = body.nose_m[0] - body.tail_m[0]
            return _kernels.Panel(
                left_m=place.left_m,
                right_m=place.right_m,
                quarter_m=place.quarter_m,
                ahead_m=place.ahead_m,
                wing=-1,
                drag=body.drag_area_m2 / (length * (body.width_m + body.height_m)),
                plate=body.cross_drag,
            )
        wing = self.wings[place.wing]
        section, plate = wing.airfoil, plate_drag(wing.aspect_ratio)
        stall = stall_of(section.lift_slope_per_rad, section.cl_max, section.cl_min, plate)
        flaps = []
        for index, gearing in place.flaps:
            surface = self.surfaces[index]
            flap, share = flap_of(surface.chord_ratio), gearing * surface.effectiveness
            flaps.append((index, share * flap.angle, share * flap.moment))
        return _kernels.Panel(
            left_m=place.left_m,
            right_m=place.right_m,
            quarter_m=place.quarter_m,
            ahead_m=place.ahead_m,
            wing=place.wing,
            sheet=place.wing if place.sheet is None else place.sheet,
            lift_slope_per_rad=section.lift_slope_per_rad,
            zero_lift_rad=math.radians(section.zero_lift_deg),
            stall_middle=stall.middle,
            stall_half_width=stall.half_width,
            drag=section.cd0,
            drag_of_lift=section.cd_cl2,
            moment=section.cm0,
            plate=plate,
            flaps=flaps,
        )


class PanelPlace(NamedTuple):
    """Geometry of a panel: ends and its own point of the quarter-chord line, a quarter of the chord as a vector."""

    left_m: Vec3
    right_m: Vec3
    quarter_m: Vec3
    ahead_m: Vec3
    wing: int  # index; -1 of a body
    flaps: tuple[tuple[int, float], ...] = ()  # surface, and its deflection here over its own, for the whole width
    body: PlateBody | None = None
    sheet: int | None = None  # wing whose vortices go on in those of this one; None: its own alone


def _station(wing: Wing, half: int, share: float) -> tuple[Vec3, Vec3]:
    """Return the quarter-chord point at a share of a half's length, and a quarter of the chord there as a vector."""
    mirror = -1.0 if half else 1.0
    dihedral, sweep = math.radians(wing.dihedral_deg), math.radians(wing.sweep_deg)
    up, out, back = det_sin(dihedral), det_cos(dihedral), det_sin(sweep) / det_cos(sweep)
    (x, y, z), way = wing.root_m, share * wing.half_m
    chord = wing.root_chord_m + share * (wing.tip_chord_m - wing.root_chord_m)
    angle = math.radians(wing.incidence_deg + share * wing.twist_deg)
    rise = 0.25 * chord * det_sin(angle)
    quarter = (x - way * back, mirror * (y + way * out), z + way * up)
    return quarter, (0.25 * chord * det_cos(angle), -mirror * rise * up, rise * out)


def _half_wing(
    index: int, wing: Wing, half: int, surfaces: Sequence[tuple[int, WingSurface]], *, sheet: int | None
) -> list[PanelPlace]:
    def share(k: float) -> float:
        if sheet is not None:
            return 0.5 * (1.0 - det_cos(math.pi * k / wing.panels))
        return det_sin(0.5 * math.pi * k / wing.panels)

    nodes = [share(k) for k in range(wing.panels + 1)]
    places = []
    for k, (inner, outer) in enumerate(itertools.pairwise(nodes)):
        middle = share(k + 0.5)  # forces/lifting_lines.hpp says why
        quarter, ahead = _station(wing, half, middle)
        flaps = []
        for i, surface in surfaces:
            covered = (min(outer, surface.span[1]) - max(inner, surface.span[0])) / (outer - inner)
            if covered > 0.0 and surface.gearing(half):
                flaps.append((i, covered * surface.gearing(half)))
        inside, outside = _station(wing, half, inner)[0], _station(wing, half, outer)[0]
        ends = (outside, inside) if half == 0 else (inside, outside)
        places.append(PanelPlace(*ends, quarter, ahead, index, tuple(flaps), None, sheet))
    return places


def _plates(body: PlateBody) -> list[PanelPlace]:
    places = []
    step = [(n - t) / body.segments for n, t in zip(body.nose_m, body.tail_m, strict=True)]
    ahead = (0.25 * step[0], 0.25 * step[1], 0.25 * step[2])
    for k in range(body.segments):
        # A quarter of the segment ahead of its middle.
        x, y, z = (n - (k + 0.25) * s for n, s in zip(body.nose_m, step, strict=True))
        w, h = 0.5 * body.width_m, 0.5 * body.height_m
        places.append(PanelPlace((x, y + w, z), (x, y - w, z), (x, y, z), ahead, -1, body=body))
        places.append(PanelPlace((x, y, z + h), (x, y, z - h), (x, y, z), ahead, -1, body=body))
    return places
