"""Triangles of MuJoCo's primitive shapes, for all who know triangles only.

A round shape has a given number of segments, and its vertices lie on it. Without such a number, the distance between
the shape and its triangles is at most about `_SHARE` of its radius, within `_LEAST_M` and `_GREATEST_M`: vertices lie a
little outside the shape, the middles of triangles a little inside.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

_SHARE, _LEAST_M, _GREATEST_M = 2e-3, 3e-4, 8e-4
_MIN_SEGMENTS, _MAX_SEGMENTS = 16, 256
INFINITE_M = 20_000.0  # half edge of an infinite plane


class Facets(NamedTuple):
    """Triangles without shared vertices, in the frame of their geom."""

    corner: Float64  # (n, 3, 3) [m]
    normal: Float64  # (n, 3, 3) unit, outward, of the smooth surface


def primitive(
    kind: int, size: tuple[float, float, float], *, segments: int | None = None, infinite_m: float = INFINITE_M
) -> Facets:
    """Return a shape of MuJoCo's mjtGeom; no triangles for a mesh or height field.

    `segments` of a full circle, a multiple of 4, None: as many as are accurate. `infinite_m`: see `plane`.
    """
    a, b, _ = size
    shapes = mujoco.mjtGeom
    if kind == shapes.mjGEOM_PLANE:
        return plane(a, b, infinite_m)
    if kind == shapes.mjGEOM_SPHERE:
        return sphere(a, segments)
    if kind == shapes.mjGEOM_CAPSULE:
        return capsule(a, b, segments)
    if kind == shapes.mjGEOM_CYLINDER:
        return cylinder(a, b, segments)
    if kind == shapes.mjGEOM_ELLIPSOID:
        return ellipsoid(size, segments)
    if kind == shapes.mjGEOM_BOX:
        return box(size)
    return Facets(np.empty((0, 3, 3)), np.empty((0, 3, 3)))


def sphere(radius_m: float, segments: int | None = None) -> Facets:
    """Return a sphere."""
    return ellipsoid((radius_m, radius_m, radius_m), segments)


def ellipsoid(half_m: tuple[float, float, float], segments: int | None = None) -> Facets:
    """Return an ellipsoid with these half axes."""
    n, scale = _segments(max(half_m), segments)
    unit = _revolved(_half_circle(n), n)
    half = np.array(half_m)
    normal = unit / np.maximum(half, 1e-9)
    return _without_empty(unit * (half * scale), normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def capsule(radius_m: float, half_length_m: float, segments: int | None = None) -> Facets:
    """Return a capsule along z: a cylinder of this half length with two half spheres."""
    n, scale = _segments(radius_m, segments)
    angle = _half_circle(n)
    middle = len(angle) // 2
    angle = np.concatenate([angle[: middle + 1], angle[middle:]])  # the equator twice
    normal = _revolved(angle, n)
    row_shift = np.where(np.arange(len(angle)) <= middle, -half_length_m, half_length_m)
    corner = normal * (radius_m * scale)
    corner[..., 2] += _per_corner(row_shift, n)
    return _without_empty(corner, normal)


def cylinder(radius_m: float, half_length_m: float, segments: int | None = None) -> Facets:
    """Return a cylinder along z with flat ends."""
    n, scale = _segments(radius_m, segments)
    around = np.linspace(0.0, 2.0 * math.pi, n + 1)
    rim = np.stack([np.cos(around), np.sin(around), np.zeros(n + 1)], axis=-1)
    a, b = rim[:-1], rim[1:]
    up = np.array([0.0, 0.0, half_length_m])
    r = radius_m * math.sqrt(scale)
    side = np.concatenate(
        [np.stack([a * r - up, b * r - up, b * r + up], axis=1), np.stack([a * r - up, b * r + up, a * r + up], axis=1)]
    )
    side_normal = np.concatenate([np.stack([a, b, b], axis=1), np.stack([a, b, a], axis=1)])
    top = np.stack([np.broadcast_to(up, a.shape), a * r + up, b * r + up], axis=1)
    bottom = np.stack([np.broadcast_to(-up, a.shape), b * r - up, a * r - up], axis=1)
    top_normal = np.broadcast_to([0.0, 0.0, 1.0], top.shape)
    return Facets(
        np.concatenate([side, top, bottom]), np.concatenate([side_normal, top_normal, -top_normal]).astype(np.float64)
    )


def box(half_m: tuple[float, float, float]) -> Facets:
    """Return a box with these half edges."""
    corners, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            square = np.zeros((4, 3))
            square[:, axis] = sign
            square[:, u] = np.array([-1.0, 1.0, 1.0, -1.0]) * sign
            square[:, v] = [-1.0, -1.0, 1.0, 1.0]
            corners += [square[[0, 1, 2]], square[[0, 2, 3]]]
            normal = np.zeros((3, 3))
            normal[:, axis] = sign
            normals += [normal, normal]
    return Facets(np.array(corners) * np.array(half_m), np.array(normals))


def plane(half_x_m: float, half_y_m: float, infinite_m: float = INFINITE_M) -> Facets:
    """Return a rectangle that faces +z; a half edge of 0 is infinite, and `infinite_m` long here."""
    x, y = (half if half > 0.0 else infinite_m for half in (half_x_m, half_y_m))
    square = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
    corner = np.stack([square[[0, 1, 2]], square[[0, 2, 3]]])
    return Facets(corner, np.broadcast_to([0.0, 0.0, 1.0], corner.shape).astype(np.float64))


def flat_normals(corner: Float64) -> Float64:
    """Return the normals (n, 3, 3) of the triangles (n, 3, 3) themselves."""
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    return np.repeat(normal[:, None, :], 3, axis=1)


def _segments(radius_m: float, segments: int | None) -> tuple[int, float]:
    """Return the segments of a full circle, and the factor that moves the vertices outwards."""
    if segments is not None:
        return segments, 1.0
    tolerance_m = min(max(_SHARE * radius_m, _LEAST_M), _GREATEST_M)
    n = math.ceil(math.pi / math.sqrt(2.0 * tolerance_m / max(radius_m, 1e-6)))
    n = 4 * -(-min(max(n, _MIN_SEGMENTS), _MAX_SEGMENTS) // 4)
    return n, 2.0 / (1.0 + math.cos(math.pi / n) ** 2)


def _half_circle(n: int) -> Float64:
    return np.linspace(-0.5 * math.pi, 0.5 * math.pi, n // 2 + 1)


def _revolved(elevation: Float64, n: int) -> Float64:
    """Return the unit normals (m, 3, 3) of triangles between rings at these elevations, of n segments each."""
    around = np.linspace(0.0, 2.0 * math.pi, n + 1)
    ring = np.stack(
        [
            np.cos(elevation)[:, None] * np.cos(around),
            np.cos(elevation)[:, None] * np.sin(around),
            np.broadcast_to(np.sin(elevation)[:, None], (len(elevation), n + 1)),
        ],
        axis=-1,
    )
    a, b, c, d = ring[:-1, :-1], ring[:-1, 1:], ring[1:, 1:], ring[1:, :-1]
    quads = np.stack([a, b, c, a, c, d], axis=2)  # (rings, n, 6, 3)
    return quads.reshape(-1, 3, 3)


def _per_corner(of_ring: Float64, n: int) -> Float64:
    """Return a value of each ring at the corners of the triangles of `_revolved`."""
    low, high = of_ring[:-1], of_ring[1:]
    six = np.stack([low, low, high, low, high, high], axis=-1)  # corners a, b, c, a, c, d
    return np.repeat(six[:, None, :], n, axis=1).reshape(-1, 3)


def _without_empty(corner: Float64, normal: Float64) -> Facets:
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    kept = area > 1e-12
    return Facets(corner[kept], normal[kept])
