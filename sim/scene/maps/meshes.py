"""Closed triangle meshes as OBJ text: roofs, paths, crowns, cars, corner reflectors.

Faces are counter-clockwise seen from outside. Vertices shared by faces are shaded smoothly; sharp edges have a vertex
per face.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD

Vec2 = tuple[float, float]


@dataclass
class Mesh:
    """Mesh: vertices [m] with texture coordinates (v upwards), and triangles of vertex indices."""

    vertices: list[Vec3]
    uvs: list[Vec2]
    triangles: list[tuple[int, int, int]]
    suffix: ClassVar[str] = ".obj"

    @staticmethod
    def empty() -> Mesh:
        return Mesh([], [], [])

    def data(self) -> bytes:
        """Return the mesh as OBJ text."""
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in self.vertices]
        lines += [f"vt {u!r} {v!r}" for u, v in self.uvs]
        lines += [f"f {a + 1}/{a + 1} {b + 1}/{b + 1} {c + 1}/{c + 1}" for a, b, c in self.triangles]
        return ("\n".join(lines) + "\n").encode()

    def add_polygon(self, points: Sequence[Vec3], uvs: Sequence[Vec2]) -> None:
        """Add a convex flat polygon with vertices of its own."""
        first = len(self.vertices)
        self.vertices += [(float(x), float(y), float(z)) for x, y, z in points]
        self.uvs += [(float(u), float(v)) for u, v in uvs]
        self.triangles += [(first, first + i, first + i + 1) for i in range(1, len(points) - 1)]


def extrude_xz(profile: Sequence[Vec2], half_width_m: float, *, tile_m: float = 1.0) -> Mesh:
    """Return a convex profile (x, z), counter-clockwise seen from -y, extruded along y by `half_width_m` both ways."""
    mesh = Mesh.empty()
    w = half_width_m
    mesh.add_polygon([(x, -w, z) for x, z in profile], [(x / tile_m, z / tile_m) for x, z in profile])
    mesh.add_polygon(
        [(x, w, z) for x, z in reversed(profile)], [(x / tile_m, z / tile_m) for x, z in reversed(profile)]
    )
    for (x0, z0), (x1, z1) in zip(profile, [*profile[1:], profile[0]], strict=True):
        edge = sqrt((x1 - x0) * (x1 - x0) + (z1 - z0) * (z1 - z0))
        u, v = 2 * w / tile_m, edge / tile_m
        mesh.add_polygon([(x0, -w, z0), (x0, w, z0), (x1, w, z1), (x1, -w, z1)], [(0, 0), (u, 0), (u, v), (0, v)])
    return mesh


def gabled(half_x_m: float, half_y_m: float, wall_m: float, rise_m: float, *, tile_m: float) -> Mesh:
    """Return walls with gables at the -y and +y ends: eaves at z = `wall_m`, ridge at `wall_m + rise_m`."""
    x = half_x_m
    profile = [(-x, 0.0), (x, 0.0), (x, wall_m), (0.0, wall_m + rise_m), (-x, wall_m)]
    return extrude_xz(profile, half_y_m, tile_m=tile_m)


def box_with_tiles(half: Vec3, tile_m: Vec2) -> Mesh:
    """Return a box whose texture repeats every `tile_m` on each side, from its lower left corner."""
    x, y, z = half
    mesh = Mesh.empty()
    corners: list[tuple[list[Vec3], float, float]] = [
        ([(-x, -y, -z), (x, -y, -z), (x, -y, z), (-x, -y, z)], 2 * x, 2 * z),
        ([(x, y, -z), (-x, y, -z), (-x, y, z), (x, y, z)], 2 * x, 2 * z),
        ([(x, -y, -z), (x, y, -z), (x, y, z), (x, -y, z)], 2 * y, 2 * z),
        ([(-x, y, -z), (-x, -y, -z), (-x, -y, z), (-x, y, z)], 2 * y, 2 * z),
        ([(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)], 2 * x, 2 * y),
        ([(-x, y, -z), (x, y, -z), (x, -y, -z), (-x, -y, -z)], 2 * x, 2 * y),
    ]
    for points, u_m, v_m in corners:
        u, v = u_m / tile_m[0], v_m / tile_m[1]
        mesh.add_polygon(points, [(0, 0), (u, 0), (u, v), (0, v)])
    return mesh


def ribbon(
    points: Sequence[Vec2], half_width_m: float, z_bottom_m: float, z_top_m: float, *, tile_m: float, closed: bool
) -> Mesh:
    """Return a flat band of constant width along a polyline: a path. Texture coordinates are metres in W."""
    n = len(points)
    mesh = Mesh.empty()
    rims: list[tuple[Vec2, Vec2]] = []
    for i, (x, y) in enumerate(points):
        ax, ay = points[i - 1] if closed or i else points[0]
        bx, by = points[(i + 1) % n] if closed or i < n - 1 else points[-1]
        dx, dy = bx - ax, by - ay
        scale = half_width_m / sqrt(dx * dx + dy * dy)
        rims.append(((x - dy * scale, y + dx * scale), (x + dy * scale, y - dx * scale)))
    for left, right in rims:
        for (px, py), z in ((left, z_top_m), (right, z_top_m), (left, z_bottom_m), (right, z_bottom_m)):
            mesh.vertices.append((px, py, z))
            mesh.uvs.append((px / tile_m, py / tile_m))
    for i in range(n if closed else n - 1):
        a, b = 4 * i, 4 * ((i + 1) % n)
        quads = ((a, a + 1, b + 1, b), (a + 3, a + 2, b + 2, b + 3), (a + 2, a, b, b + 2), (a + 1, a + 3, b + 3, b + 1))
        for p, q, r, s in quads:
            mesh.triangles += [(p, q, r), (p, r, s)]
    if not closed:
        e = 4 * (n - 1)
        mesh.triangles += [(0, 2, 3), (0, 3, 1), (e, e + 1, e + 3), (e, e + 3, e + 2)]
    return mesh


def revolve(profile: Sequence[Vec2], sides: int, *, wobble: Callable[[int, int], float] | None = None) -> Mesh:
    """Return a profile (radius, z), from bottom to top, revolved about z; both ends close in a point on the axis.

    `wobble(ring, side)` scales the radius there, for natural shapes.
    """
    mesh = Mesh.empty()
    rings = len(profile)
    for i, (radius, z) in enumerate(profile):
        for j in range(sides + 1):
            angle = TURN_RAD * (j % sides) / sides
            r = radius * (wobble(i, j % sides) if wobble else 1.0)
            mesh.vertices.append((r * det_cos(angle), r * det_sin(angle), z))
            mesh.uvs.append((2.0 * j / sides, i / (rings - 1)))
    row = sides + 1
    for i in range(rings - 1):
        for j in range(sides):
            a = i * row + j
            mesh.triangles += [(a, a + 1, a + row + 1), (a, a + row + 1, a + row)]
    first = len(mesh.vertices)
    mesh.vertices += [(0.0, 0.0, profile[0][1]), (0.0, 0.0, profile[-1][1])]
    mesh.uvs += [(0.5, 0.0), (0.5, 1.0)]
    top = (rings - 1) * row
    for j in range(sides):
        mesh.triangles += [(first, j + 1, j), (first + 1, top + j, top + j + 1)]
    return mesh


def blob(bumps: Callable[[int, int], float], *, rings: int = 9, sides: int = 16) -> Mesh:
    """Return a lumpy ball of about unit radius, centre at the origin."""
    profile = []
    for i in range(rings):
        angle = TURN_RAD / 2 * (i + 0.5) / rings
        profile.append((det_sin(angle), -det_cos(angle)))
    return revolve(profile, sides, wobble=bumps)


def slab(outline: Sequence[Vec2], z_bottom_m: float, z_top_m: float, *, tile_m: float) -> Mesh:
    """Return a flat plate with a star-shaped outline (counter-clockwise about the origin); texture in metres."""
    mesh = Mesh.empty()
    n = len(outline)
    for z in (z_top_m, z_bottom_m):
        for x, y in ((0.0, 0.0), *outline):
            mesh.vertices.append((x, y, z))
            mesh.uvs.append((x / tile_m, y / tile_m))
    low = n + 1
    for i in range(n):
        a, b = 1 + i, 1 + (i + 1) % n
        mesh.triangles += [(0, a, b), (low, low + b, low + a)]
        mesh.triangles += [(a, low + a, low + b), (a, low + b, b)]
    return mesh


def ellipse(
    half_x_m: float, half_y_m: float, sides: int, *, wobble: Callable[[int], float] | None = None
) -> list[Vec2]:
    """Return the outline of an ellipse round the origin, its radius scaled by `wobble(side)`."""
    points = []
    for i in range(sides):
        angle = TURN_RAD * i / sides
        r = wobble(i) if wobble else 1.0
        points.append((half_x_m * r * det_cos(angle), half_y_m * r * det_sin(angle)))
    return points
