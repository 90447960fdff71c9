"""Record of occupied ground: discs, boxes, and bands along paths."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt

from sim.scene.random_generator import RandomGenerator

Point = tuple[float, float]


def segment_distance(p: Point, a: Point, b: Point) -> float:
    """Return the distance of a point from a line segment [m]."""
    ax, ay = b[0] - a[0], b[1] - a[1]
    px, py = p[0] - a[0], p[1] - a[1]
    length2 = ax * ax + ay * ay
    u = min(max((px * ax + py * ay) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    dx, dy = px - u * ax, py - u * ay
    return sqrt(dx * dx + dy * dy)


class Layout:
    """Ground occupied so far."""

    def __init__(self) -> None:
        self._discs: list[tuple[float, float, float]] = []
        self._bands: list[tuple[Point, Point, float]] = []
        self._boxes: list[tuple[float, float, float, float]] = []

    def take_disc(self, x: float, y: float, radius_m: float) -> None:
        self._discs.append((x, y, radius_m))

    def take_band(self, points: Sequence[Point], half_width_m: float, *, closed: bool = False) -> None:
        ends = [*points[1:], points[0]] if closed else points[1:]
        self._bands += [(a, b, half_width_m) for a, b in zip(points, ends, strict=False)]

    def take_box(self, x0: float, y0: float, x1: float, y1: float) -> None:
        self._boxes.append((min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)))

    def free(self, x: float, y: float, radius_m: float) -> bool:
        """Return True if a disc touches no occupied ground."""
        for cx, cy, r in self._discs:
            if (x - cx) * (x - cx) + (y - cy) * (y - cy) < (r + radius_m) * (r + radius_m):
                return False
        for x0, y0, x1, y1 in self._boxes:
            dx = max(x0 - x, 0.0, x - x1)
            dy = max(y0 - y, 0.0, y - y1)
            if dx * dx + dy * dy < radius_m * radius_m:
                return False
        for a, b, half in self._bands:
            reach = half + radius_m
            beyond = reach + 1e-6  # far bands are left out without a square root
            if max(a[0], b[0]) + beyond < x or x < min(a[0], b[0]) - beyond:
                continue
            if max(a[1], b[1]) + beyond < y or y < min(a[1], b[1]) - beyond:
                continue
            if segment_distance((x, y), a, b) < reach:
                return False
        return True

    def scatter(
        self,
        rng: RandomGenerator,
        count: int,
        radius_m: float,
        area: tuple[float, float, float, float],
        place: Callable[[float, float], None],
        *,
        tries: int = 40,
    ) -> int:
        """Call `place` for up to `count` discs at random free points of `area` (x0, y0, x1, y1); return the count."""
        placed = 0
        for _ in range(count):
            for _ in range(tries):
                x, y = rng.between(area[0], area[2]), rng.between(area[1], area[3])
                if self.free(x, y, radius_m):
                    self.take_disc(x, y, radius_m)
                    place(x, y)
                    placed += 1
                    break
        return placed
