"""Paths that a plane can be told to follow: a straight line, a circle, a course. North and east from the origin, m."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.plane.npfg import PathPoint


class Line(NamedTuple):
    """The straight line through (`n`, `e`) with the unit tangent (`t_n`, `t_e`)."""

    n: float
    e: float
    t_n: float
    t_e: float

    def nearest(self, n: float, e: float) -> PathPoint:
        """Return the nearest point."""
        dn, de = n - self.n, e - self.e
        return PathPoint(self.t_n, self.t_e, self.t_n * de - self.t_e * dn, 0.0)

    def along_m(self, n: float, e: float) -> float:
        """Return how far along the tangent from (`self.n`, `self.e`) a place lies."""
        return (n - self.n) * self.t_n + (e - self.e) * self.t_e


class Circle(NamedTuple):
    """A circle about (`n`, `e`), clockwise from above or not."""

    n: float
    e: float
    radius_m: float
    clockwise: bool

    def nearest(self, n: float, e: float) -> PathPoint:
        """Return the nearest point; over the centre, that to the north."""
        dn, de = n - self.n, e - self.e
        distance = sqrt(dn * dn + de * de)
        out_n, out_e = (dn / distance, de / distance) if distance > 0.1 else (1.0, 0.0)
        outside = distance - self.radius_m
        if self.clockwise:  # the centre lies to the right
            return PathPoint(-out_e, out_n, -outside, 1.0 / self.radius_m)
        return PathPoint(out_e, -out_n, outside, -1.0 / self.radius_m)


def line_between(n0: float, e0: float, n1: float, e1: float, *, otherwise_rad: float) -> Line:
    """Return the line from one place to another; if they are less than 1 m apart, on the course `otherwise_rad`."""
    dn, de = n1 - n0, e1 - e0
    length = sqrt(dn * dn + de * de)
    if length < 1.0:
        return Line(n0, e0, el.cos(otherwise_rad), el.sin(otherwise_rad))
    return Line(n0, e0, dn / length, de / length)
