"""Lofted meshes: closed outlines, one above the other, joined by triangles, with smooth normals.

    p(z, a) = (x + r_x cos a, half_y sin a, z) k,   k = 1 + square sin^2 2a,   r_x = front if cos a > 0 else back

Texture coordinates: u runs once round, 0.5 in front (+x), v upwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from math import sqrt

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, Vec2


@dataclass(frozen=True)
class Section:
    """Cross-section of a loft at height z: extents to the front (+x), the back and either side, and its middle."""

    z: float
    front: float
    back: float
    half_y: float
    x: float = 0.0
    y: float = 0.0
    square: float = 0.0  # 0: an ellipse; 0.15: nearly a rectangle


@dataclass
class SmoothMesh(Mesh):
    """Mesh with a normal at each vertex; vertices of one group are shaded as one."""

    groups: list[int] = field(default_factory=list)

    @staticmethod
    def empty() -> SmoothMesh:
        return SmoothMesh([], [], [], [])

    def add(self, other: SmoothMesh) -> None:
        """Add another closed mesh, not joined with this one."""
        first, group = len(self.vertices), 1 + max(self.groups, default=-1)
        self.vertices += other.vertices
        self.uvs += other.uvs
        self.groups += [group + g for g in other.groups]
        self.triangles += [(first + a, first + b, first + c) for a, b, c in other.triangles]

    def with_uv(self, uv: Vec2) -> SmoothMesh:
        """Return the mesh with one place of the texture everywhere."""
        return SmoothMesh(self.vertices, [uv] * len(self.vertices), self.triangles, self.groups)

    @property
    def radius(self) -> float:
        """Distance from the origin to the farthest vertex."""
        return sqrt(max(x * x + y * y + z * z for x, y, z in self.vertices))

    def normals(self) -> list[Vec3]:
        """Return the unit normal of each vertex: the mean of its group's triangles, weighted by area."""
        sums = {g: [0.0, 0.0, 0.0] for g in self.groups}
        for a, b, c in self.triangles:
            (px, py, pz), (qx, qy, qz), (rx, ry, rz) = self.vertices[a], self.vertices[b], self.vertices[c]
            ux, uy, uz, vx, vy, vz = qx - px, qy - py, qz - pz, rx - px, ry - py, rz - pz
            x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            for group in (self.groups[a], self.groups[b], self.groups[c]):
                total = sums[group]
                total[0] += x
                total[1] += y
                total[2] += z
        units = {}
        for group, (x, y, z) in sums.items():
            length = sqrt(x * x + y * y + z * z)
            units[group] = (x / length, y / length, z / length) if length > 0.0 else (0.0, 0.0, 1.0)
        return [units[g] for g in self.groups]


@cache
def _circle(sides: int) -> tuple[Vec2, ...]:
    """Return cosine and sine of the angle of each corner; corner 0 is at the back (-x)."""
    angles = [TURN_RAD * (i / sides - 0.5) for i in range(sides)]
    return tuple((det_cos(a), det_sin(a)) for a in angles)


def outline(section: Section, sides: int) -> list[Vec3]:
    """Return the corners of a cross-section, counter-clockwise seen from above, from the back."""
    points = []
    for c, s in _circle(sides):
        sine = 2.0 * s * c
        k = 1.0 + section.square * sine * sine
        reach = section.front if c > 0.0 else section.back
        points.append((section.x + k * reach * c, section.y + k * section.half_y * s, section.z))
    return points


def skin(
    outlines: Sequence[Sequence[Vec3]],
    *,
    ends: tuple[Vec3, Vec3],
    creases: Sequence[int] = (),
    rows: Sequence[float] | None = None,
) -> SmoothMesh:
    """Join outlines of equal numbers of corners, bottom to top, and close both ends by a point.

    At the outlines numbered in `creases` shading has an edge. `rows`: v of each outline, z without.
    """
    mesh = SmoothMesh.empty()
    n = len(outlines[0])
    starts: list[tuple[int, int]] = []  # first vertex of an outline, seen from below and from above
    group = 0
    for number, points in enumerate(outlines):
        v = rows[number] if rows is not None else points[0][2]
        copies = []
        for _ in range(2 if number in creases else 1):
            copies.append(len(mesh.vertices))
            for i in range(n + 1):
                mesh.vertices.append(points[i % n])
                mesh.uvs.append((i / n, v))
                mesh.groups.append(group + i % n)
            group += n
        starts.append((copies[0], copies[-1]))
    for (_, low), (high, _) in pairwise(starts):
        for i in range(n):
            a, b = low + i, high + i
            mesh.triangles += [(a, a + 1, b + 1), (a, b + 1, b)]
    for (point, row), is_top in zip(((ends[0], starts[0][0]), (ends[1], starts[-1][1])), (False, True), strict=True):
        middle = len(mesh.vertices)
        mesh.vertices.append(point)
        mesh.uvs.append((0.5, mesh.uvs[row][1]))
        mesh.groups.append(group)
        group += 1
        for i in range(n):
            pair = (row + i, row + i + 1) if is_top else (row + i + 1, row + i)
            mesh.triangles.append((middle, *pair))
    return mesh


def loft(
    sections: Sequence[Section],
    sides: int,
    *,
    creases: Sequence[int] = (),
    caps: tuple[float, float] = (0.0, 0.0),
    rows: Sequence[float] | None = None,
) -> SmoothMesh:
    """Loft through cross-sections, bottom to top; `caps`: how far both ends bulge. Negative numbers count creases from
    the top."""
    low, high = sections[0], sections[-1]
    ends = ((low.x, low.y, low.z - caps[0]), (high.x, high.y, high.z + caps[1]))
    at = [i % len(sections) for i in creases]
    return skin([outline(s, sides) for s in sections], ends=ends, creases=at, rows=rows)


def ball(centre: Vec3, radii: Vec3, sides: int = 8, rings: int = 3) -> SmoothMesh:
    """Return an ellipsoid."""
    sections = []
    for i in range(1, rings + 1):
        angle = 0.5 * TURN_RAD * i / (rings + 1)
        c, s = det_cos(angle), det_sin(angle)
        sections.append(
            Section(centre[2] - radii[2] * c, radii[0] * s, radii[0] * s, radii[1] * s, centre[0], centre[1])
        )
    gap = radii[2] * (1.0 - det_cos(0.5 * TURN_RAD / (rings + 1)))
    return loft(sections, sides, caps=(gap, gap))


def block(centre: Vec3, half: Vec3, *, square: float = 0.28, taper: float = 0.85) -> SmoothMesh:
    """Return a box with soft edges: bags, pouches."""
    x, y, z = centre
    hx, hy, hz = half
    sections = [
        Section(z - hz, taper * hx, taper * hx, taper * hy, x, y, square),
        Section(z - 0.75 * hz, hx, hx, hy, x, y, square),
        Section(z + 0.7 * hz, hx, hx, hy, x, y, square),
        Section(z + hz, taper * hx, taper * hx, taper * hy, x, y, square),
    ]
    return loft(sections, 8, creases=(0, -1))
