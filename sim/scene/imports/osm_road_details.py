"""Paint, sleepers and rails of an extract's streets and railways, as quads on the ground.

Widths are those of the German guideline RMS (lines of 0.12 m, zebra bars of 0.5 m) and of standard-gauge track.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from math import sqrt
from typing import Any

from sim.scene.imports import osm_tags
from sim.scene.imports.osm_file import Tags
from sim.scene.imports.osm_parking import BAY_M, ParkingPlace
from sim.scene.imports.osm_shapes import Line, Shapes
from sim.scene.imports.shapes import coordinates, shapely

Point = tuple[float, float]
Quad = list[Point]

RAILS = ("rail", "light_rail", "narrow_gauge", "tram", "subway")
_LINE_HALF_M = 0.06
_EDGE_LEAST_M = 6.5  # roads from this width have lines at their edges
_EDGE_M = 0.25  # of such a line from the edge
_BAR_M, _BAR_LONG_M = 0.5, 3.0  # of a zebra crossing: width and gap, length
_SLEEPER_STEP_M, _SLEEPER_HALF_M = 0.65, (1.3, 0.13)
_RAIL_HALF_M = 0.035


def pieces(path: Any) -> list[list[Point]]:
    """Return the points of each line of a shape."""
    found = shapely.get_parts(path).tolist()
    return [[(x, y) for x, y in coordinates(p).tolist()] for p in found if p.geom_type == "LineString"]


def _quad(a: Point, b: Point, half_m: float, left_m: float = 0.0) -> Quad | None:
    """Return the rectangle about a segment that is `left_m` to the left of a and b; None for one of no length."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = sqrt(dx * dx + dy * dy)
    if length < 0.05:
        return None
    nx, ny = -dy / length, dx / length
    return [
        (p[0] + w * nx, p[1] + w * ny)
        for p, w in ((a, left_m - half_m), (b, left_m - half_m), (b, left_m + half_m), (a, left_m + half_m))
    ]


def _along(points: list[Point], step_m: float) -> Iterator[tuple[Point, Point]]:
    """Yield points every `step_m` of a line, with the direction of the line there."""
    left = 0.5 * step_m
    for a, b in itertools.pairwise(points):
        dx, dy = b[0] - a[0], b[1] - a[1]
        length = sqrt(dx * dx + dy * dy)
        while left < length:
            yield (a[0] + left * dx / length, a[1] + left * dy / length), (dx / length, dy / length)
            left += step_m
        left -= length


def road_lines(path: Any, tags: Tags, wide_m: float) -> list[Quad]:
    """Return lines at the edges of a wide road, and dashes between its lanes, beside those in its middle."""
    found: list[Quad | None] = []
    for points in pieces(path):
        if wide_m >= _EDGE_LEAST_M:
            for left in (0.5 * wide_m - _EDGE_M, _EDGE_M - 0.5 * wide_m):
                found += [_quad(a, b, _LINE_HALF_M, left) for a, b in itertools.pairwise(points)]
        lanes = int(osm_tags.number(tags.get("lanes"), 12.0) or 0)
        middle = 0 if tags.get("oneway") == "yes" else lanes / 2.0
        for k in range(1, lanes):
            if k == middle or (lanes == 2 and middle):
                continue
            left = wide_m * (k / lanes - 0.5)
            for p, d in _along(points, 8.0):
                ends = ((p[0] - 1.5 * d[0], p[1] - 1.5 * d[1]), (p[0] + 1.5 * d[0], p[1] + 1.5 * d[1]))
                found.append(_quad(*ends, _LINE_HALF_M, left))
    return [quad for quad in found if quad is not None]


def bay_lines(places: list[ParkingPlace]) -> list[Quad]:
    """Return the lines on both sides of the bays of parking areas."""
    from signals._kernel import det_cos, det_sin

    quads = []
    for place in places:
        c, s = det_cos(place.heading_rad), det_sin(place.heading_rad)
        for side in (-0.5 * BAY_M[1], 0.5 * BAY_M[1]):
            x, y = place.x - side * s, place.y + side * c
            half = 0.5 * BAY_M[0] - 0.1
            quads.append(_quad((x - half * c, y - half * s), (x + half * c, y + half * s), 0.05))
    return [quad for quad in quads if quad is not None]


def crossings(shapes: Shapes) -> list[Quad]:
    """Return the bars of zebra crossings: nodes with highway=crossing on a road."""
    marked = {
        spot.node: spot.place
        for spot in shapes.spots
        if spot.tags.get("highway") == "crossing"
        and spot.tags.get("crossing", "yes") not in ("unmarked", "no", "informal")
        and spot.tags.get("crossing:markings", "yes") != "no"
    }
    found = []
    for line in shapes.lines:
        highway = line.tags.get("highway", "")
        if highway not in osm_tags.ROADS:
            continue
        wide = osm_tags.width_m(line.tags, osm_tags.ROADS[highway][0])
        for i, node in enumerate(line.nodes):
            if node not in marked:
                continue
            x, y = marked.pop(node)
            a, b = line.points[max(i - 1, 0)], line.points[min(i + 1, len(line.points) - 1)]
            dx, dy = b[0] - a[0], b[1] - a[1]
            length = sqrt(dx * dx + dy * dy)
            if length < 0.1:
                continue
            dx, dy = 0.5 * _BAR_LONG_M * dx / length, 0.5 * _BAR_LONG_M * dy / length
            bars = int((wide - 0.3) / (2.0 * _BAR_M) + 0.5)
            for k in range(bars):
                left = (k - 0.5 * (bars - 1)) * 2.0 * _BAR_M
                quad = _quad((x - dx, y - dy), (x + dx, y + dy), 0.5 * _BAR_M, left)
                found.append(quad)
    return [quad for quad in found if quad is not None]


def is_railway(line: Line) -> bool:
    return line.tags.get("railway") in RAILS


def gauge_m(tags: Tags) -> float:
    """Return the distance of the inner faces of a track's rails."""
    stated = osm_tags.number(tags.get("gauge"), 3000.0)
    return stated / 1000.0 if stated is not None and stated > 300.0 else 1.435


def rails(path: Any, tags: Tags) -> list[Quad]:
    """Return the heads of both rails of a track."""
    found = []
    for points in pieces(path):
        for left in (0.5 * gauge_m(tags) + _RAIL_HALF_M, -0.5 * gauge_m(tags) - _RAIL_HALF_M):
            found += [_quad(a, b, _RAIL_HALF_M, left) for a, b in itertools.pairwise(points)]
    return [quad for quad in found if quad is not None]


def sleepers(path: Any, tags: Tags) -> list[Quad]:
    """Return the sleepers of a track; a tram has none that are seen."""
    if tags.get("railway") == "tram":
        return []
    found = []
    long, half = _SLEEPER_HALF_M
    long *= gauge_m(tags) / 1.435
    for points in pieces(path):
        for p, d in _along(points, _SLEEPER_STEP_M):
            n = (-d[1] * long, d[0] * long)
            found.append(_quad((p[0] - n[0], p[1] - n[1]), (p[0] + n[0], p[1] + n[1]), half))
    return [quad for quad in found if quad is not None]
