"""Runway of a scene, as checks and verdicts of planes need it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from signals._kernel import det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.samples import Vec3
from signals.units import RAD_PER_DEG

Coordinate = Annotated[float, Field(ge=-50_000.0, le=50_000.0)]


class Runway(StrictModel):
    """Level strip on the ground; its heading is the one in which it is named and, as a rule, flown."""

    threshold_m: tuple[Coordinate, Coordinate]  # middle of its beginning: east, north in W
    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)]  # clockwise from north
    length_m: Annotated[float, Field(gt=0.0, le=10_000.0)]
    width_m: Annotated[float, Field(gt=0.0, le=200.0)]
    elevation_m: Coordinate = 0.0  # of its surface, z in W

    @property
    def direction_W(self) -> tuple[float, float]:
        """Unit vector along the runway: east, north."""
        angle = self.heading_deg * RAD_PER_DEG
        return det_sin(angle), det_cos(angle)

    def at(self, along_m: float, right_m: float = 0.0, height_m: float = 0.0) -> Vec3:
        """Return the point so far along from the threshold, so far right of the centre line and above it, in W."""
        (x, y), (e, n) = self.threshold_m, self.direction_W
        return (x + along_m * e + right_m * n, y + along_m * n - right_m * e, self.elevation_m + height_m)

    def place_of(self, p_W: Vec3) -> Vec3:
        """Return a point as distance from the threshold, distance right of the centre line, and height over it."""
        (x, y), (e, n) = self.threshold_m, self.direction_W
        dx, dy = p_W[0] - x, p_W[1] - y
        return (dx * e + dy * n, dx * n - dy * e, p_W[2] - self.elevation_m)

    def contains(self, p_W: Vec3) -> bool:
        """Return True if a point is above or on the runway."""
        along, right, _ = self.place_of(p_W)
        return 0.0 <= along <= self.length_m and abs(right) <= 0.5 * self.width_m
