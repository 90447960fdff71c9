"""Intersections of a ray with each shape, one at a time and in plain formulas: the reference for the native caster.

Surfaces as in mj_ray: planes from above only, triangles from both sides, solids from within where the ray leaves.
Quadratics are solved in extended precision (np.longdouble), so that the reference's own error is negligible.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[Any]
SHAPES = ("plane", "sphere", "capsule", "ellipsoid", "cylinder", "box")
MUJOCO_NUMBER = {"plane": 0, "sphere": 2, "capsule": 3, "ellipsoid": 4, "cylinder": 5, "box": 6, "mesh": 7}


def _roots(a: Any, b: Any, c: Any) -> tuple[Any, ...]:
    """Return the roots of a t^2 + 2 b t + c = 0, ascending."""
    under = b * b - a * c
    if a == 0 or under < 0:
        return ()
    s = np.sqrt(under)
    return ((-b - s) / a, (-b + s) / a)


def _crossings(shape: str, size: Float, o: Float, d: Float) -> Iterator[Any]:
    """Return every t, of either sign, at which the line meets the surface; o and d in the shape's frame, longdouble."""
    if shape == "plane":
        if d[2] < 0 and o[2] >= 0:
            t = -o[2] / d[2]
            p = o + t * d
            if all(size[i] <= 0 or abs(p[i]) <= size[i] for i in (0, 1)):
                yield t
    elif shape == "sphere":
        yield from _roots(d @ d, o @ d, o @ o - size[0] ** 2)
    elif shape == "ellipsoid":
        yield from _crossings("sphere", np.ones(1, np.longdouble), o / size, d / size)
    elif shape == "box":
        for axis in range(3):
            for side in (-size[axis], size[axis]):
                if d[axis] != 0:
                    t = (side - o[axis]) / d[axis]
                    p = o + t * d
                    if all(abs(p[i]) <= size[i] for i in range(3) if i != axis):
                        yield t
    else:
        radius, half = size[0], size[1]
        for t in _roots(d[:2] @ d[:2], o[:2] @ d[:2], o[:2] @ o[:2] - radius**2):
            if abs(o[2] + t * d[2]) <= half:
                yield t
        for end in (-half, half):
            if shape == "capsule":
                middle = np.array([0, 0, end], np.longdouble)
                for t in _roots(d @ d, (o - middle) @ d, (o - middle) @ (o - middle) - radius**2):
                    if (o[2] + t * d[2] - end) * np.sign(end) >= 0:
                        yield t
            elif d[2] != 0:
                t = (end - o[2]) / d[2]
                p = o + t * d
                if p[0] ** 2 + p[1] ** 2 <= radius**2:
                    yield t


def _triangle_crossing(corners: Float, o: Float, d: Float) -> Iterator[Any]:
    """Moeller and Trumbore (1997)."""
    e, f = corners[1] - corners[0], corners[2] - corners[0]
    p = np.cross(d, f)
    det = e @ p
    if det == 0:
        return
    s = o - corners[0]
    u = (s @ p) / det
    q = np.cross(s, e)
    v = (d @ q) / det
    if u >= 0 and v >= 0 and u + v <= 1:
        yield (f @ q) / det


def nearest(
    geoms: Iterable[tuple[str, Float, Float, Float, Float | None]],
    origin: Float,
    direction: Float,
    *,
    t_min: float = 0.0,
    t_max: float = math.inf,
) -> tuple[float, int]:
    """Return the nearest t in [t_min, t_max] and its geom, or (inf, -1). Geom: (shape, size, p_WG, R_WG, triangles)."""
    best, which = math.inf, -1
    for index, (shape, size, p_WG, R_WG, triangles) in enumerate(geoms):
        R = np.asarray(R_WG, np.longdouble)
        o = (np.asarray(origin, np.longdouble) - np.asarray(p_WG, np.longdouble)) @ R
        d = np.asarray(direction, np.longdouble) @ R
        if shape == "mesh":
            assert triangles is not None
            found = [t for corners in triangles for t in _triangle_crossing(corners.astype(np.longdouble), o, d)]
        else:
            found = list(_crossings(shape, np.asarray(size, np.longdouble), o, d))
        inside = [float(t) for t in found if t_min <= t <= t_max]
        if inside and min(inside) < best:
            best, which = min(inside), index
    return best, which
