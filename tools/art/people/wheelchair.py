"""Meshes of a wheelchair: x forward, y left, the origin on the ground below the hips of its user."""

from __future__ import annotations

from signals._kernel import det_cos, det_sin
from signals.rotation import cross, minus, unit
from signals.samples import Vec3
from signals.units import TURN_RAD
from tools.art.people.loft import SmoothMesh, ball, block, skin

_WHEEL_M, _HALF_TRACK_M = 0.30, 0.28
_SPOKES = 10


def tyres() -> SmoothMesh:
    """Return the tyres of the four wheels."""
    mesh = SmoothMesh.empty()
    for side in (-1.0, 1.0):
        mesh.add(_ring((-0.05, side * _HALF_TRACK_M, _WHEEL_M), _WHEEL_M - 0.017, 0.017, 20, 5))
        mesh.add(_ring((0.34, side * 0.22, 0.075), 0.058, 0.017, 10, 5))
    return mesh


def frame() -> SmoothMesh:
    """Return the tubes, push rims, spokes and footrests."""
    mesh = SmoothMesh.empty()
    for side in (-1.0, 1.0):
        y = side * 0.21
        for ends, radius in (
            (((-0.18, y, 0.30), (-0.18, y, 0.90)), 0.012),
            (((-0.18, y, 0.90), (-0.30, y, 0.93)), 0.014),
            (((-0.18, y, 0.46), (0.22, y, 0.46)), 0.012),
            (((0.22, y, 0.46), (0.36, 0.8 * y, 0.14)), 0.012),
            (((-0.05, y, 0.30), (0.34, y, 0.16)), 0.011),
            (((0.34, y, 0.16), (0.34, y, 0.075)), 0.011),
            (((-0.17, 1.12 * y, 0.70), (0.14, 1.12 * y, 0.70)), 0.016),
            (((0.12, 1.10 * y, 0.70), (0.12, 1.05 * y, 0.46)), 0.010),
        ):
            mesh.add(_rod(*ends, radius, 5))
        hub = (-0.05, side * _HALF_TRACK_M, _WHEEL_M)
        mesh.add(_ring((hub[0], side * (_HALF_TRACK_M + 0.025), hub[2]), 0.25, 0.008, 16, 4))
        mesh.add(ball(hub, (0.03, 0.03, 0.03), 6, 2))
        for k in range(_SPOKES):
            angle = TURN_RAD * (k + 0.3) / _SPOKES
            c, s = det_cos(angle), det_sin(angle)
            start, end = ((hub[0] + r * c, hub[1], hub[2] + r * s) for r in (0.02, 0.275))
            mesh.add(_rod(start, end, 0.003, 3))
    mesh.add(block((0.42, 0.0, 0.105), (0.08, 0.17, 0.010)))
    return mesh


def seat() -> SmoothMesh:
    """Return the seat and the back."""
    mesh = block((0.03, 0.0, 0.475), (0.21, 0.20, 0.020))
    mesh.add(block((-0.175, 0.0, 0.71), (0.015, 0.20, 0.19)))
    return mesh


def farthest_m() -> list[Vec3]:
    """Return the vertices that are the farthest ones from hips at some height of 0 to 2 m."""
    vertices = [v for mesh in (tyres(), frame(), seat()) for v in mesh.vertices]
    found: dict[Vec3, None] = {}
    for k in range(2001):
        hip_z_m = k / 1000
        found[max(vertices, key=lambda v: v[0] * v[0] + v[1] * v[1] + (v[2] - hip_z_m) * (v[2] - hip_z_m))] = None
    return list(found)


def _ring(centre: Vec3, radius: float, tube: float, around: int, sides: int) -> SmoothMesh:
    """Return a torus about an axis along y."""
    mesh = SmoothMesh.empty()
    for i in range(around):
        c, s = det_cos(TURN_RAD * i / around), det_sin(TURN_RAD * i / around)
        for k in range(sides):
            out = radius + tube * det_cos(TURN_RAD * k / sides)
            at = centre[1] + tube * det_sin(TURN_RAD * k / sides)
            mesh.vertices.append((centre[0] + out * c, at, centre[2] + out * s))
            mesh.uvs.append((0.0, 0.0))
            mesh.groups.append(i * sides + k)
    for i in range(around):
        for k in range(sides):
            a, b = i * sides + k, i * sides + (k + 1) % sides
            p, q = (i + 1) % around * sides + k, (i + 1) % around * sides + (k + 1) % sides
            mesh.triangles += [(a, b, q), (a, q, p)]
    return mesh


def _rod(start: Vec3, end: Vec3, radius: float, sides: int) -> SmoothMesh:
    """Return a round bar between two points."""
    along = unit(minus(end, start))
    aside = unit(cross(along, (1.0, 0.0, 0.0) if abs(along[0]) < 0.8 else (0.0, 1.0, 0.0)))
    other = cross(along, aside)
    outlines = []
    for middle in (start, end):
        points: list[Vec3] = []
        for k in range(sides):
            c, s = radius * det_cos(TURN_RAD * k / sides), radius * det_sin(TURN_RAD * k / sides)
            x, y, z = (m + c * u + s * w for m, u, w in zip(middle, aside, other, strict=True))
            points.append((x, y, z))
        outlines.append(points)
    return skin(outlines, ends=(start, end), creases=(0, 1), rows=(0.0, 1.0))
