"""Polygons of an extract: put together, repaired and cut into triangles. Needs the package shapely.

Coordinates are rounded to 1 mm: the functions of GEOS may differ in the last bit between machines. Of two points that
differ in the sign of a zero, GEOS keeps either one, by the addresses of its objects, which change from run to run: what
leaves GEOS has no -0.0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import ConfigError

try:
    import shapely
    from shapely import ops
except ImportError:
    shapely = ops = None

Float64 = NDArray[np.float64]
_GRID_M = 0.001
MIN_AREA_M2 = 0.5


def need_shapely(source: str) -> None:
    """Raise ConfigError if the package is not installed."""
    if shapely is None:
        message = "is an OpenStreetMap extract, and the package shapely, which its areas need, is not installed"
        raise ConfigError.at(source, message, 'pip install "hil-bench[scenes]"')


def parts(shape: Any) -> list[Any]:
    """Return the polygons of any shape, without those of no size."""
    found = [part for part in shapely.get_parts(shapely.get_parts(shape)).tolist() if part.geom_type == "Polygon"]
    return [part for part in found if part.area >= MIN_AREA_M2]


def rounded(shape: Any) -> Any:
    try:
        return shapely.set_precision(shape, _GRID_M)
    except shapely.errors.GEOSException:  # a sliver that the grid folds over itself
        return shapely.make_valid(shapely.set_precision(shape, _GRID_M, mode="pointwise"))


def polygons_of_ring(points: Sequence[tuple[float, float]]) -> tuple[list[Any], bool]:
    """Return the polygons inside a closed line, and True if it crosses itself."""
    if len(points) < 3:
        return [], False
    polygon = shapely.Polygon(points)
    if polygon.is_valid:
        return parts(rounded(polygon)), False
    return parts(rounded(shapely.make_valid(polygon))), True


def polygons_of_lines(outer: Sequence[Any], inner: Sequence[Any]) -> list[Any]:
    """Return the polygons of a multipolygon relation; `outer` and `inner`: lines that join at their ends."""
    area = shapely.union_all(list(ops.polygonize(shapely.union_all(list(outer)))))
    if inner:
        area = area - shapely.union_all(list(ops.polygonize(shapely.union_all(list(inner)))))
    return parts(rounded(area))


def coordinates(shape: Any) -> Float64:
    """Return the points (n, 2) of any shape in their order, without -0.0."""
    return np.asarray(shapely.get_coordinates(shape) + 0.0)


def triangles(polygon: Any) -> Float64:
    """Return the triangles (n, 3, 2) of a polygon, with its holes left out, counter-clockwise."""
    found = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    if not len(found):
        return np.zeros((0, 3, 2))
    corners = coordinates(found).reshape(-1, 4, 2)[:, :3]
    return counter_clockwise(corners)


def counter_clockwise(corners: Float64) -> Float64:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turn = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    corners = np.where((turn < 0.0)[:, None, None], corners[:, ::-1], corners)
    return corners[np.abs(turn) > 1e-9]


def rings(polygon: Any) -> list[Float64]:
    """Return the outer ring, counter-clockwise, and the holes, clockwise, without their repeated last points."""
    turned = shapely.orient_polygons(polygon)
    return [coordinates(ring)[:-1] for ring in (turned.exterior, *turned.interiors)]


def union(shapes: Iterable[Any]) -> Any:
    return shapely.union_all(list(shapes))
