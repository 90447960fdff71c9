"""Record of the ground of a district that is taken, by what its extract describes and by what was placed since."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import floor
from typing import Any

from signals._kernel import det_cos, det_sin
from sim.scene.imports.shapes import shapely

_CELL_M = 10.0


class Occupancy:
    """Shapes of the ground that nothing may be placed on. `blocked`: those of the extract."""

    def __init__(self, blocked: Sequence[Any]) -> None:
        self._blocked = shapely.STRtree(list(blocked)) if blocked else None
        self._placed: dict[tuple[int, int], list[Any]] = {}

    def is_clear(self, shape: Any) -> bool:
        """Return True if a shape touches nothing of the extract."""
        return self._blocked is None or not len(self._blocked.query(shape, predicate="intersects"))

    def is_free(self, shape: Any) -> bool:
        """Return True if a shape touches nothing of the extract and nothing that was placed."""
        if not self.is_clear(shape):
            return False
        return not any(other.intersects(shape) for cell in _cells(shape) for other in self._placed.get(cell, ()))

    def take(self, shape: Any) -> None:
        for cell in _cells(shape):
            self._placed.setdefault(cell, []).append(shape)


def disc(x: float, y: float, radius_m: float) -> Any:
    return shapely.Point(x, y).buffer(radius_m, quad_segs=4)


def rectangle(x: float, y: float, heading_rad: float, half_m: tuple[float, float]) -> Any:
    """Return a rectangle about a point; `half_m`: along the heading, and across."""
    c, s = det_cos(heading_rad), det_sin(heading_rad)
    a, b = half_m
    corners = ((a, b), (-a, b), (-a, -b), (a, -b))
    return shapely.Polygon([(x + c * u - s * v, y + s * u + c * v) for u, v in corners])


def _cells(shape: Any) -> Iterator[tuple[int, int]]:
    x0, y0, x1, y1 = (floor(v / _CELL_M) for v in shape.bounds)
    for i in range(x0, x1 + 1):
        for j in range(y0, y1 + 1):
            yield i, j
