"""Base of the forces that carry a vehicle by its speed through the air and that surfaces control."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from signals.rotation import cross, norm
from signals.samples import Vec3
from sim.physics.forces.force import Command, ForceParameters
from sim.physics.forces.surface import Surface

Corners = list[Vec3]  # of a convex body, in B
Sphere = tuple[Vec3, float]  # middle in B, radius
Station = tuple[Vec3, Vec3]  # quarter-chord point, and a quarter of the chord as a vector

_HALF_THICKNESS = 0.05  # over the chord, of what is drawn


class WingParameters(ForceParameters):
    """Parameters of a wing or a whole aircraft; each of its `surfaces` takes a command of -1..1."""

    if TYPE_CHECKING:
        surfaces: tuple[Surface, ...]

    @property
    def commands(self) -> tuple[Command, ...]:
        return tuple(Command(surface.name, signed=True) for surface in self.surfaces)

    @property
    def moved_surfaces(self) -> tuple[Surface, ...]:
        return self.surfaces

    @property
    def is_wing(self) -> bool:
        return True

    def solids(self, hull: Sequence[Sphere]) -> list[Corners]:
        """Return the convex bodies as which it is seen. `hull`: the contact spheres of the vehicle's hull."""
        del hull
        return []


def tapered(root: Station, tip: Station) -> Corners:
    """Return the corners of a half of a wing: a rhombus at each end, thickest at 40 % of the chord."""
    (ax, ay, az), (bx, by, bz) = root[0], tip[0]
    along = (bx - ax, by - ay, bz - az)
    corners: Corners = []
    for quarter, ahead in (root, tip):
        chord_m = 4.0 * norm(ahead)
        across = cross(ahead, along)
        up = tuple(_HALF_THICKNESS * chord_m * c / norm(across) for c in across)
        for share, side in ((1.0, 0.0), (-0.6, 1.0), (-3.0, 0.0), (-0.6, -1.0)):
            x, y, z = (q + share * a + side * u for q, a, u in zip(quarter, ahead, up, strict=True))
            corners.append((x, y, z))
    return corners


def spindle(nose_m: Vec3, tail_m: Vec3, width_m: float, height_m: float) -> Corners:
    """Return the corners of a body that is thickest at a quarter of its length, where it is a rhombus across x."""
    x, y, z = (n + 0.25 * (t - n) for n, t in zip(nose_m, tail_m, strict=True))
    w, h = 0.5 * width_m, 0.5 * height_m
    return [nose_m, (x, y + w, z), (x, y, z + h), (x, y - w, z), (x, y, z - h), tail_m]
