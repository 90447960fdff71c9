"""Bridges of a district: decks with railings on piers, solid and open below.

OpenStreetMap states no heights of bridges, but their layer. On level ground a deck is 5.5 m above the ground for each
layer, which is the clearance of main roads plus the deck. On a terrain it spans a valley at the height of its ends. The
ramps that lead there are ways of their own, without a height: they stay on the ground.
"""

from __future__ import annotations

import itertools
from collections import Counter
from math import ceil, sqrt
from typing import Any

from signals._kernel import det_atan2
from sim.scene.imports import osm_tags
from sim.scene.imports.osm_file import Tags
from sim.scene.imports.osm_road_details import is_railway, pieces
from sim.scene.imports.osm_shapes import Line
from sim.scene.imports.osm_streets import width_m
from sim.scene.imports.shapes import shapely
from sim.scene.maps.map_builder import MapBuilder, yaw_quat

Point = tuple[float, float]

LEAST_M = 12.0  # shorter ones, over ditches, lie on the ground
_LAYER_M = 5.5
_VALLEY_M = 4.0  # ground this far below both ends needs no more height
_DECK_M, _RAILING_M, _RAILING_HALF_M = 0.8, 1.1, 0.05
_SPAN_M = 22.0  # between piers
_PIER_HALF_M = 0.45


def is_bridge(tags: Tags) -> bool:
    return tags.get("bridge", "no") != "no"


def is_deck(line: Line) -> bool:
    """Return True for a bridge that is built as a deck in the air."""
    highway = line.tags.get("highway", "")
    carries = highway in osm_tags.ROADS or osm_tags.PATHS.get(highway, (0.0, ""))[1] or is_railway(line)
    if not carries or not is_bridge(line.tags) or line.tags.get("area") == "yes":
        return False
    layer = osm_tags.number(line.tags.get("layer"), 10.0)
    return shapely.LineString(line.points).length >= LEAST_M and (layer is None or layer >= 1.0)


class BridgeMaker:
    """Adds decks. `below`: polygons of ways under bridges, on which no pier stands."""

    def __init__(self, builder: MapBuilder, below: list[Any], box: Any, ground: Any) -> None:
        """`ground`: returns the height of the ground at a point."""
        self._builder, self._box, self._ground = builder, box, ground
        self._below = shapely.STRtree(below) if below else None

    def add(self, line: Line, kind: str, material: str, *, open_ends: tuple[bool, bool]) -> None:
        """Add one bridge. `open_ends`: True where no other bridge goes on, so that an abutment ends it."""
        inside = pieces(shapely.intersection(shapely.LineString(line.points), self._box))
        wide = width_m(line)
        layer = max(osm_tags.number(line.tags.get("layer"), 10.0) or 1.0, 1.0)
        for points in inside:
            heights = [self._ground(*p) for p in _every(points, 5.0)]
            ends = 0.5 * (heights[0] + heights[-1])
            is_valley = min(heights) < min(heights[0], heights[-1]) - _VALLEY_M
            top = ends + 0.3 if is_valley else max(heights) + _LAYER_M * layer
            deck = self._builder.named_body(self._named(kind), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
            railing = self._builder.named_body(self._named("fence"), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
            for a, b in itertools.pairwise(points):
                dx, dy = b[0] - a[0], b[1] - a[1]
                length = sqrt(dx * dx + dy * dy)
                if length < 0.05:
                    continue
                turn = yaw_quat(det_atan2(dy, dx))
                x, y = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])
                half = 0.5 * length + min(0.25 * wide, 1.0) * (len(points) > 2)  # no gap at a bend
                deck.geom(
                    "box",
                    (half, 0.5 * wide, 0.5 * _DECK_M),
                    material=material,
                    pos=(x, y, top - 0.5 * _DECK_M),
                    quat=turn,
                )
                for side in (-1.0, 1.0):
                    out = side * (0.5 * wide - _RAILING_HALF_M)
                    railing.geom(
                        "box", (0.5 * length, _RAILING_HALF_M, 0.5 * _RAILING_M), material="osm_steel",
                        pos=(x - out * dy / length, y + out * dx / length, top + 0.5 * _RAILING_M), quat=turn,
                    )  # fmt: skip
            self._supports(points, wide, top - _DECK_M, open_ends)

    def _named(self, kind: str) -> str:
        self._builder.classify(kind, f"{kind}_*")
        return self._builder.next_name(kind)

    def _supports(self, points: list[Point], wide: float, under: float, open_ends: tuple[bool, bool]) -> None:
        """Add an abutment at each open end, and piers between."""
        path = shapely.LineString(points)
        spans = max(1, ceil(path.length / _SPAN_M))
        places = [(path.interpolate(path.length * k / spans), True) for k in range(1, spans)]
        places += [
            (path.interpolate(at), False)
            for at, is_open in zip((0.5, path.length - 0.5), open_ends, strict=True)
            if is_open
        ]
        for place, is_pier in places:
            x, y = round(place.x, 3), round(place.y, 3)
            half = (_PIER_HALF_M, min(0.3 * wide, 3.0)) if is_pier else (0.4, 0.5 * wide)
            a, b = _segment_at(points, x, y)
            turn = det_atan2(b[1] - a[1], b[0] - a[0])
            ground = self._ground(x, y)
            high = under - ground + 1.0
            if high < 1.2 or self._is_way(x, y, max(half)):
                continue
            body = self._builder.named_body(self._named("wall"), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
            body.geom(
                "box", (*half, 0.5 * high), material="osm_concrete", pos=(x, y, under - 0.5 * high), quat=yaw_quat(turn)
            )

    def _is_way(self, x: float, y: float, reach_m: float) -> bool:
        around = shapely.Point(x, y).buffer(reach_m)
        return self._below is not None and len(self._below.query(around, predicate="intersects")) > 0


def _every(points: list[Point], step_m: float) -> list[Point]:
    """Return points of a line, at most `step_m` apart."""
    found = [points[0]]
    for a, b in itertools.pairwise(points):
        count = max(1, ceil(sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2) / step_m))
        found += [(a[0] + (b[0] - a[0]) * k / count, a[1] + (b[1] - a[1]) * k / count) for k in range(1, count + 1)]
    return found


def _segment_at(points: list[Point], x: float, y: float) -> tuple[Point, Point]:
    """Return the segment of a line that is nearest to a point."""
    at = shapely.Point(x, y)
    pairs = list(itertools.pairwise(points))
    return min(pairs, key=lambda pair: shapely.LineString(pair).distance(at))


def bridge_ends(lines: list[Line]) -> Counter[int]:
    """Return how many decks begin or end at each node."""
    return Counter(node for line in lines for node in (line.nodes[0], line.nodes[-1]))
