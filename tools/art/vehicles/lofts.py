"""Lofted sheets, tubes and revolved profiles for `Mesh`: grids with shared vertices, which shade smoothly."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from signals._kernel import det_cos, det_sin
from signals.rotation import cross, minus, unit
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, Vec2


def mix(a: float, b: float, t: float) -> float:
    return a + (b - a) * t


def at_knots(knots: Sequence[Vec2], x: float) -> float:
    """Return the ordinate at `x` of a polyline with ascending abscissae; beyond its ends, that of the end."""
    if x <= knots[0][0]:
        return knots[0][1]
    for (x0, y0), (x1, y1) in pairwise(knots):
        if x <= x1:
            return y0 + (y1 - y0) * (x - x0) / (x1 - x0)
    return knots[-1][1]


def add_vertex(mesh: Mesh, p: Vec3, uv: Vec2 = (0.0, 0.0)) -> int:
    mesh.vertices.append((float(p[0]), float(p[1]), float(p[2])))
    mesh.uvs.append(uv)
    return len(mesh.vertices) - 1


def add_quad(mesh: Mesh, a: int, b: int, c: int, d: int) -> None:
    """Add a quadrangle, counter-clockwise seen from outside; corners of one index make it a triangle or nothing."""
    if len({a, b, c}) == 3:
        mesh.triangles.append((a, b, c))
    if len({a, c, d}) == 3:
        mesh.triangles.append((a, c, d))


def add_indexed_grid(mesh: Mesh, rows: Sequence[Sequence[int]], *, closed: bool = False) -> None:
    """Add the quadrangles between rows of vertex indices, seen from where columns run right and rows run up."""
    for low, high in pairwise(rows):
        n = len(low)
        for i in range(n if closed else n - 1):
            k = (i + 1) % n
            add_quad(mesh, low[i], low[k], high[k], high[i])


def add_sheet(mesh: Mesh, rows: Sequence[Sequence[Vec3]], *, flipped: bool = False) -> None:
    """Add an open sheet; texture coordinates run from 0 to 1 along columns (u) and rows (v)."""
    height, width = len(rows) - 1, len(rows[0]) - 1
    indices = [[add_vertex(mesh, p, (i / width, j / height)) for i, p in enumerate(row)] for j, row in enumerate(rows)]
    if flipped:
        indices = [row[::-1] for row in indices]
    add_indexed_grid(mesh, indices)


def add_box(mesh: Mesh, low: Vec3, high: Vec3) -> None:
    """Add a box with sharp edges between two corners."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    uvs = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    for face in (
        [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
        [(x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)],
        [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
        [(x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)],
        [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
        [(x0, y1, z0), (x1, y1, z0), (x1, y0, z0), (x0, y0, z0)],
    ):
        mesh.add_polygon(face, uvs)


def add_lathe(
    mesh: Mesh, centre: Vec3, profile: Sequence[Vec2], sides: int, *, outward: float = 1.0, closed: bool = False
) -> None:
    """Add a profile (radius, y), in order from the inner face to the outer one, revolved about the y axis.

    `outward` -1 mirrors it in y. Ends of radius 0 meet on the axis; `closed` joins the last point to the first.
    """
    cx, cy, cz = centre
    rows = []
    for radius, y in profile:
        if radius == 0.0:
            rows.append([add_vertex(mesh, (cx, cy + outward * y, cz))] * sides)
            continue
        row = []
        for i in range(sides):
            angle = TURN_RAD * i / sides
            p = (cx + radius * det_cos(angle), cy + outward * y, cz + radius * det_sin(angle))
            row.append(add_vertex(mesh, p))
        rows.append(row[::-1] if outward > 0.0 else row)
    if closed:
        rows.append(rows[0])
    add_indexed_grid(mesh, rows, closed=True)


def add_torus(mesh: Mesh, centre: Vec3, radius_m: float, tube_m: float, sides: int, tube_sides: int) -> None:
    """Add a torus about the y axis."""
    profile = [
        (radius_m - tube_m * det_cos(TURN_RAD * k / tube_sides), -tube_m * det_sin(TURN_RAD * k / tube_sides))
        for k in range(tube_sides)
    ]
    add_lathe(mesh, centre, profile, sides, closed=True)


def add_tube(mesh: Mesh, points: Sequence[Vec3], radius_m: float | Sequence[float], sides: int = 6) -> None:
    """Add a round tube along a polyline, closed at both ends. `radius_m`: one for all points, or one for each."""
    radii = [radius_m] * len(points) if isinstance(radius_m, (int, float)) else list(radius_m)
    rows = []
    for k, p in enumerate(points):
        a, b = points[max(k - 1, 0)], points[min(k + 1, len(points) - 1)]
        d = unit(minus(b, a))
        helper = (0.0, 0.0, 1.0) if abs(d[2]) < 0.9 else (1.0, 0.0, 0.0)
        u = unit(cross(helper, d))
        v = cross(d, u)
        row = []
        for i in range(sides):
            c, s = radii[k] * det_cos(TURN_RAD * i / sides), radii[k] * det_sin(TURN_RAD * i / sides)
            row.append(
                add_vertex(mesh, (p[0] + c * u[0] + s * v[0], p[1] + c * u[1] + s * v[1], p[2] + c * u[2] + s * v[2]))
            )
        rows.append(row)
    first, last = add_vertex(mesh, points[0]), add_vertex(mesh, points[-1])
    add_indexed_grid(mesh, [[first] * sides, *rows, [last] * sides], closed=True)


def add_ellipsoid(mesh: Mesh, centre: Vec3, half: Vec3, *, rings: int = 6, sides: int = 10) -> None:
    rows = [[add_vertex(mesh, (centre[0], centre[1], centre[2] - half[2]))] * sides]
    for i in range(1, rings):
        up = TURN_RAD / 2 * i / rings
        r, z = det_sin(up), -det_cos(up)
        row = []
        for j in range(sides):
            angle = TURN_RAD * j / sides
            p = (
                centre[0] + half[0] * r * det_cos(angle),
                centre[1] + half[1] * r * det_sin(angle),
                centre[2] + half[2] * z,
            )
            row.append(add_vertex(mesh, p))
        rows.append(row)
    rows.append([add_vertex(mesh, (centre[0], centre[1], centre[2] + half[2]))] * sides)
    add_indexed_grid(mesh, rows, closed=True)
