"""Shapes of an extract in W [m]: buildings, areas, lines and points with their tags."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from signals.geodesy import LocalFrame, Site
from sim.scene.imports.osm_file import OsmData, Tags, Way
from sim.scene.imports.shapes import polygons_of_lines, polygons_of_ring, shapely

Point = tuple[float, float]
_AREA_KEYS = frozenset(["building", "building:part", "landuse", "leisure", "natural", "amenity"])


@dataclass(frozen=True)
class Area:
    """A polygon; `key`: kind and id of its object, such as "w123"."""

    key: str
    tags: Tags
    polygon: Any


@dataclass(frozen=True)
class Line:
    key: str
    tags: Tags
    points: tuple[Point, ...]
    nodes: tuple[int, ...]
    closed: bool


@dataclass(frozen=True)
class Spot:
    key: str
    tags: Tags
    place: Point
    node: int


@dataclass
class Shapes:
    """Everything within reach; `notes` counts what was left out or repaired."""

    areas: list[Area] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    spots: list[Spot] = field(default_factory=list)
    notes: Counter[str] = field(default_factory=Counter)


def shapes_of(data: OsmData, site: Site, reach_m: float) -> Shapes:
    """Return the shapes of an extract that have a point within `reach_m`, east or north, of the site."""
    return _Assembler(data, site, reach_m).run()


class _Assembler:
    def __init__(self, data: OsmData, site: Site, reach_m: float) -> None:
        self._data, self._reach_m = data, reach_m
        self._frame = LocalFrame(site)
        self._altitude_m = site.altitude_m
        self._places: dict[int, Point] = {}
        self._shapes = Shapes()

    def run(self) -> Shapes:
        shapes = self._shapes
        outlines: set[int] = set()  # ways whose area a relation describes
        for number, relation in sorted(self._data.relations.items()):
            if relation.tags.get("type") == "multipolygon" and _AREA_KEYS & relation.tags.keys():
                outlines |= self._relation(number, relation.members, relation.tags)
        for number, way in sorted(self._data.ways.items()):
            if way.tags:
                self._way(number, way, is_outline=number in outlines)
        for number, tags in sorted(self._data.node_tags.items()):
            place = self._place(number)
            if place is not None and self._within(place):
                shapes.spots.append(Spot(f"n{number}", tags, place, number))
        return shapes

    def _place(self, node: int) -> Point | None:
        if node not in self._places:
            found = self._data.nodes.get(node)
            if found is None:
                return None
            x, y, _ = self._frame.enu_from_geodetic(found[0], found[1], self._altitude_m)
            self._places[node] = (round(x, 4), round(y, 4))
        return self._places[node]

    def _within(self, place: Point) -> bool:
        return abs(place[0]) <= self._reach_m and abs(place[1]) <= self._reach_m

    def _points(self, way: Way) -> tuple[list[Point], list[int]]:
        """Return the places of a way's nodes, without repeated ones; missing nodes are counted."""
        points: list[Point] = []
        nodes: list[int] = []
        missing = 0
        for node in way.nodes:
            place = self._place(node)
            if place is None:
                missing += 1
            elif not points or place != points[-1]:
                points.append(place)
                nodes.append(node)
        if missing:
            self._shapes.notes["ways name nodes that the extract does not hold; these are left out"] += 1
        return points, nodes

    def _way(self, number: int, way: Way, *, is_outline: bool) -> None:
        points, nodes = self._points(way)
        if len(points) < 2:
            return
        xs, ys = zip(*points, strict=True)
        reach = self._reach_m
        if max(xs) < -reach or min(xs) > reach or max(ys) < -reach or min(ys) > reach:
            self._shapes.notes["objects beyond map.radius_m are left out"] += 1
            return
        closed = len(way.nodes) > 2 and way.nodes[0] == way.nodes[-1] and len(points) > 3
        tags = way.tags
        is_area = closed and (_AREA_KEYS & tags.keys() or tags.get("area") == "yes" or "waterway" in tags)
        if is_area and not is_outline:
            self._ring(f"w{number}", tags, points)
        elif ("building" in tags or "building:part" in tags) and not is_outline:
            self._shapes.notes["buildings have an outline that is not closed and are left out"] += 1
        self._shapes.lines.append(Line(f"w{number}", tags, tuple(points), tuple(nodes), closed))

    def _ring(self, key: str, tags: Tags, points: list[Point]) -> None:
        polygons, crossed = polygons_of_ring(points)
        kind = "buildings" if "building" in tags or "building:part" in tags else "areas"
        if not polygons:
            self._shapes.notes[f"{kind} have no size and are left out"] += 1
            return
        if crossed:
            self._shapes.notes[f"{kind} have an outline that crosses itself and are repaired"] += 1
        self._shapes.areas += [Area(key if not i else f"{key}.{i}", tags, p) for i, p in enumerate(polygons)]

    def _relation(self, number: int, members: tuple[tuple[str, int, str], ...], tags: Tags) -> set[int]:
        outer: list[Any] = []
        inner: list[Any] = []
        used: set[int] = set()
        missing = False
        for kind, ref, role in members:
            if kind != "way":
                continue
            way = self._data.ways.get(ref)
            if way is None:
                missing = True
                continue
            points, _ = self._points(way)
            if len(points) < 2:
                continue
            (inner if role == "inner" else outer).append(shapely.LineString(points))
            if (role != "inner" and not (_AREA_KEYS & way.tags.keys())) or (
                role != "inner" and way.tags.get("building") == tags.get("building")
            ):
                used.add(ref)
        if missing:
            self._shapes.notes["relations name ways that the extract does not hold"] += 1
        if not outer:
            return used
        low, high = -self._reach_m, self._reach_m
        box = shapely.box(low, low, high, high)
        if not any(line.intersects(box) for line in outer):
            near = shapely.union_all(outer).envelope.intersects(box)
            if not near:
                return used
        polygons = polygons_of_lines(outer, inner)
        if not polygons:
            self._shapes.notes["areas made of several ways do not close and are left out"] += 1
        self._shapes.areas += [
            Area(f"r{number}" if not i else f"r{number}.{i}", tags, p) for i, p in enumerate(polygons)
        ]
        return used
