"""Trunks and branches: tapered tubes, each closed, in one mesh."""

from __future__ import annotations

from collections.abc import Sequence

from signals._kernel import det_cos, det_sin
from signals.rotation import cross, minus, unit
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh

_TILE_M = 0.9  # height of the bark's texture


def along(p: Vec3, d: Vec3, length: float) -> Vec3:
    """Return the point at `length` from p in direction d."""
    return (p[0] + length * d[0], p[1] + length * d[1], p[2] + length * d[2])


def tube(mesh: Mesh, points: Sequence[Vec3], radii: Sequence[float], sides: int, *, flare: float = 1.0) -> None:
    """Add a tube along `points` that ends in a point beyond the last one. `flare` widens the first ring."""
    axis = unit((points[1][0] - points[0][0], points[1][1] - points[0][1], points[1][2] - points[0][2]))
    side = unit(cross(axis, (0.0, 1.0, 0.0) if axis[1] * axis[1] < 0.5 else (1.0, 0.0, 0.0)))
    first = len(mesh.vertices)
    length, row = 0.0, sides + 1
    for i, (p, r) in enumerate(zip(points, radii, strict=True)):
        if i:
            before = points[i - 1]
            axis = unit(minus(p, before))
            gap = (p[0] - before[0]) * axis[0] + (p[1] - before[1]) * axis[1] + (p[2] - before[2]) * axis[2]
            length += gap
            off = side[0] * axis[0] + side[1] * axis[1] + side[2] * axis[2]
            side = unit(along(side, axis, -off))
        across = cross(axis, side)
        wide = r * flare if i == 0 else r
        for j in range(sides + 1):
            angle = TURN_RAD * (j % sides) / sides
            c, s = wide * det_cos(angle), wide * det_sin(angle)
            mesh.vertices.append(
                (
                    p[0] + c * side[0] + s * across[0],
                    p[1] + c * side[1] + s * across[1],
                    p[2] + c * side[2] + s * across[2],
                )
            )
            mesh.uvs.append((2.0 * j / sides, length / _TILE_M))
    rings = len(points)
    for i in range(rings - 1):
        for j in range(sides):
            a = first + i * row + j
            mesh.triangles += [(a, a + 1, a + row + 1), (a, a + row + 1, a + row)]
    end = len(mesh.vertices)
    mesh.vertices += [points[0], along(points[-1], axis, radii[-1])]
    mesh.uvs += [(1.0, 0.0), (1.0, length / _TILE_M)]
    top = first + (rings - 1) * row
    for j in range(sides):
        mesh.triangles += [(end, first + j + 1, first + j), (end + 1, top + j, top + j + 1)]
