"""Ground that streets, railways, water and barriers of an extract take."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from typing import Any

from sim.scene.imports import osm_tags
from sim.scene.imports.osm_road_details import is_railway
from sim.scene.imports.osm_shapes import Line, Shapes
from sim.scene.imports.shapes import shapely

_TRACK_M = 4.0
_BESIDE_TRACK_M = 1.8  # of its middle, for things beside it


def width_m(line: Line) -> float:
    """Return the width of a road, a path or a track."""
    highway = line.tags.get("highway", "")
    if highway in osm_tags.ROADS:
        return osm_tags.width_m(line.tags, osm_tags.ROADS[highway][0])
    if highway in osm_tags.PATHS:
        return osm_tags.width_m(line.tags, osm_tags.PATHS[highway][0])
    return _TRACK_M


def carriageways(shapes: Shapes, decks: Collection[str]) -> list[tuple[str, Any]]:
    """Return key and polygon of each road and railway on the ground; `decks`: keys of those in the air."""
    found = []
    for line in shapes.lines:
        is_way = line.tags.get("highway") in osm_tags.ROADS or is_railway(line)
        if is_way and line.key not in decks and not osm_tags.is_underground(line.tags):
            half = 0.5 * width_m(line) - 0.1
            found.append((line.key, shapely.LineString(line.points).buffer(half, cap_style="flat")))
    return found


def barred(shapes: Shapes, decks: Collection[str]) -> list[Any]:
    """Return the ground of water, barriers, railways and bridges, with some room beside them."""
    found = []
    for area in shapes.areas:
        if any(area.tags.get(key) in values for key, values, kind, _ in osm_tags.AREAS if kind == "water"):
            found.append(area.polygon)
    for line in shapes.lines:
        path = shapely.LineString(line.points)
        known = osm_tags.BARRIERS.get(line.tags.get("barrier", ""))
        waterway = osm_tags.WATERWAYS_M.get(line.tags.get("waterway", ""))
        if line.key in decks:
            found.append(path.buffer(0.5 * width_m(line) + 0.3))
        elif osm_tags.is_underground(line.tags):
            continue
        elif known is not None:
            thick = min(osm_tags.length_m(line.tags.get("width")) or known[1], 3.0)
            found.append(path.buffer(0.5 * thick + 0.3))
        elif waterway is not None:
            found.append(path.buffer(0.5 * osm_tags.width_m(line.tags, waterway)))
        elif is_railway(line):
            found.append(path.buffer(_BESIDE_TRACK_M))
    return found


def junctions(shapes: Shapes) -> Any:
    """Return a tree of the points where roads meet or are crossed."""
    uses: Counter[int] = Counter()
    roads = [line for line in shapes.lines if line.tags.get("highway") in osm_tags.ROADS]
    for line in roads:
        uses.update(set(line.nodes))
    crossed = {spot.node for spot in shapes.spots if spot.tags.get("highway") == "crossing"}
    points = {
        node: shapely.Point(place)
        for line in roads
        for node, place in zip(line.nodes, line.points, strict=True)
        if uses[node] > 1 or node in crossed
    }
    return shapely.STRtree(list(points.values()))
