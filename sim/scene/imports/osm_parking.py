"""Places of parked cars in an extract: along streets, on parking areas, and in mapped bays.

Keys as in the OpenStreetMap wiki ("Street parking", and the older "Key:parking:lane"; "Tag:amenity=parking").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from signals._kernel import det_atan2
from signals.units import QUARTER_TURN_RAD
from sim.scene.imports import osm_tags
from sim.scene.imports.osm_file import Tags
from sim.scene.imports.osm_shapes import Line
from sim.scene.imports.shapes import coordinates, shapely

BAY_M = (5.0, 2.6)  # length and width
_AISLE_M = 6.0
_NARROW_M = 2.0  # the least width for cars
_JUNCTION_M = 8.0  # free of cars round junctions and crossings
_QUIET = ("residential", "living_street", "unclassified")  # streets with parked cars though no tag says so
_QUIET_LEAST_M = 5.0
_STEP_M = {"parallel": 6.0, "diagonal": 3.4, "perpendicular": 2.6}
_POSITIONS = ("lane", "street_side", "on_kerb", "half_on_kerb", "shoulder", "yes")
_NO_GROUND = ("underground", "multi-storey", "rooftop", "carports", "sheds")
STATED_SHARE, UNSTATED_SHARE, LOT_SHARE = 0.55, 0.30, 0.60  # of the places that have a car, at density 1


@dataclass(frozen=True)
class ParkingPlace:
    """A place for one car. `share`: probability of a car at density 1; `key`: of the way that it is beside."""

    x: float
    y: float
    heading_rad: float
    share: float
    key: str


def is_on_ground(tags: Tags) -> bool:
    """Return True for a parking area in the open."""
    return tags.get("amenity") == "parking" and tags.get("parking") not in _NO_GROUND and "building" not in tags


def bays(polygon: Any, key: str) -> Iterator[ParkingPlace]:
    """Yield the bays of a parking area: rows on both sides of aisles, along the longer side of its least rectangle.

    One of less than the length of a bay has cars along it: so has a single mapped bay.
    """
    box = shapely.minimum_rotated_rectangle(polygon)
    if box.geom_type != "Polygon":
        return
    corners = np.round(coordinates(box.exterior)[:4], 3)
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    if float(u @ u) < float(v @ v):
        u, v = v, u
    length, width = sqrt(float(u @ u)), sqrt(float(v @ v))
    if width < _NARROW_M or length < BAY_M[0] - 0.6:
        return
    u, v = u / length, v / width
    shapely.prepare(polygon)
    if width < BAY_M[0]:  # a single bay, or cars one behind the other
        count = max(1, int(length / _STEP_M["parallel"]))
        for column in range(count):
            x, y = (corners[0] + (column + 0.5) / count * length * u + 0.5 * width * v).tolist()
            ends = shapely.LineString([np.array((x, y)) - 2.0 * u, np.array((x, y)) + 2.0 * u])
            if polygon.contains(ends):
                yield ParkingPlace(x, y, det_atan2(float(u[1]), float(u[0])), LOT_SHARE, key)
        return
    heading = det_atan2(float(v[1]), float(v[0]))
    deep, wide = BAY_M
    rows, at = [], 0.0
    while at + deep <= width + 1e-6:
        rows.append(at + 0.5 * deep)
        at += deep + (_AISLE_M if len(rows) % 2 else 0.0)
    for row in rows:
        for column in range(int(length / wide)):
            x, y = (corners[0] + (column + 0.5) * wide * u + row * v).tolist()
            outline = shapely.Polygon([np.array((x, y)) + a * 0.5 * wide * u + b * 0.5 * deep * v for a, b in _CORNERS])
            if polygon.contains(outline):
                yield ParkingPlace(x, y, heading, LOT_SHARE, key)


_CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def street_places(line: Line, junctions: Any) -> Iterator[ParkingPlace]:
    """Yield the places along both sides of a street; `junctions`: a tree of points that are kept free."""
    highway = line.tags.get("highway", "")
    if highway not in osm_tags.ROADS or line.tags.get("bridge", "no") != "no":
        return
    wide = osm_tags.width_m(line.tags, osm_tags.ROADS[highway][0])
    for side in ("right", "left"):
        kind, position, share = _side(line.tags, side, wide)
        if not kind:
            continue
        out = 0.5 * wide + {"on_kerb": 1.1, "street_side": 1.1, "shoulder": 1.1, "half_on_kerb": 0.0}.get(
            position, -1.1
        )
        turn = 0.0
        if kind != "parallel":
            out = 0.5 * wide + 2.7
            turn = QUARTER_TURN_RAD if kind == "perpendicular" else 0.5 * QUARTER_TURN_RAD
        sign = -1.0 if side == "right" else 1.0  # to the left of the way's direction is positive
        for (ax, ay), (bx, by) in zip(line.points[:-1], line.points[1:], strict=True):
            dx, dy = bx - ax, by - ay
            length = sqrt(dx * dx + dy * dy)
            step = _STEP_M[kind]
            for k in range(int(length / step)):
                at = (k + 0.5) * step
                x, y = ax + at * dx / length, ay + at * dy / length
                if len(junctions.query(shapely.Point(x, y), predicate="dwithin", distance=_JUNCTION_M)):
                    continue
                heading = det_atan2(-sign * dy, -sign * dx) - sign * turn  # right-hand traffic
                yield ParkingPlace(x - sign * out * dy / length, y + sign * out * dx / length, heading, share, line.key)


def _side(tags: Tags, side: str, wide_m: float) -> tuple[str, str, float]:
    """Return how cars stand on a side of a street ("": not at all), where, and the share of places with a car."""
    position = tags.get(f"parking:{side}") or tags.get("parking:both")
    if position is not None:
        kind = tags.get(f"parking:{side}:orientation") or tags.get("parking:both:orientation") or "parallel"
        return (kind if kind in _STEP_M and position in _POSITIONS else ""), position, STATED_SHARE
    old = tags.get(f"parking:lane:{side}") or tags.get("parking:lane:both")
    if old is not None:
        return (old if old in _STEP_M else ""), "lane", STATED_SHARE
    if any(key.startswith("parking:") for key in tags):
        return "", "", 0.0
    is_quiet = tags.get("highway") in _QUIET and wide_m >= _QUIET_LEAST_M and side == "right"
    return ("parallel" if is_quiet else ""), "lane", UNSTATED_SHARE
