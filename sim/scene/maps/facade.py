"""Facades with depth, as one mesh per material of a building: walls, trim, glass, metal, roof.

A building is made of sides. A point of a side has x along the wall, z upwards, and `out` away from it; openings recede
to a negative `out`, and a pane closes each. All fronts of a side share one plane and one mapping of the texture, all
left jambs another, and so on: few triangles and few different faces keep the raster fast. Panes reach a little behind
the wall, so that no ray passes between the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import sqrt

from signals.samples import Vec3
from sim.scene.maps.facade_layout import BANDS, PANES, SHOPS_V, STOREY_M, TRIM_ROWS, WALL_M
from sim.scene.maps.map_builder import Body, MapBuilder
from sim.scene.maps.meshes import Mesh, Vec2
from sim.scene.random_generator import RandomGenerator

PARTS = ("front", "wall", "glass", "trim", "roof")
ROOF_TILE_M = 4.8  # edge of the texture of roof tiles
_PANE_FIELDS = PANES * PANES
_PLAIN_FROM_M, _PLAIN_M = 0.15, 2.7  # height and extent of the part of a wall's texture without bands
_BEHIND_M = 0.03  # by which a pane reaches behind the wall

Quad = tuple[Vec3, Vec3, Vec3, Vec3]


@dataclass(frozen=True)
class Opening:
    """Recess of a wall with a pane or a door at its back [m]."""

    x0: float
    x1: float
    z0: float
    z1: float
    depth_m: float = 0.15
    is_door: bool = False


@dataclass(frozen=True)
class Side:
    """Wall of a building: from `origin` along the unit vector `along`, outwards to the right of it."""

    origin: Vec2
    along: Vec2
    length_m: float
    shift_m: float = 0.0  # of the wall's texture

    def at(self, x: float, z: float, out: float) -> Vec3:
        (px, py), (ax, ay) = self.origin, self.along
        return (px + x * ax + out * ay, py + x * ay - out * ax, z)


def sides_of(half_x_m: float, half_y_m: float, shift_m: float = 0.0) -> tuple[Side, Side, Side, Side]:
    """Return the sides of a rectangle: -y, +x, +y, -x."""
    x, y = half_x_m, half_y_m
    return (
        Side((-x, -y), (1.0, 0.0), 2 * x, shift_m),
        Side((x, -y), (0.0, 1.0), 2 * y, shift_m + 3.0),
        Side((x, y), (-1.0, 0.0), 2 * x, shift_m + 6.0),
        Side((-x, y), (0.0, -1.0), 2 * y, shift_m + 9.0),
    )


@dataclass
class Facades:
    """Meshes of one building under construction. `wall_width_m`: width of the wall's texture."""

    wall_width_m: float
    meshes: dict[str, Mesh] = field(default_factory=lambda: {part: Mesh.empty() for part in PARTS})

    def wall(self, side: Side, x: Vec2, z: Vec2, out: float = 0.0) -> None:
        """Add a rectangle of plain wall, in strips no higher than the plain part of the texture."""
        (x0, x1), (z0, z1) = x, z
        if x1 - x0 < 1e-6 or z1 - z0 < 1e-6:
            return
        strips = -int(-(z1 - z0) // _PLAIN_M)
        for i in range(strips):
            low, high = z0 + (z1 - z0) * i / strips, z0 + (z1 - z0) * (i + 1) / strips
            self.gable(side, [(x0, low), (x1, low), (x1, high), (x0, high)], low, out)

    def gable(self, side: Side, points: Sequence[Vec2], base_z: float, out: float = 0.0) -> None:
        """Add a convex polygon of plain wall, at most 2.7 m high above `base_z`."""
        uvs = [((x + side.shift_m) / self.wall_width_m, (_PLAIN_FROM_M + z - base_z) / WALL_M) for x, z in points]
        self.meshes["wall"].add_polygon([side.at(x, z, out) for x, z in points], uvs)

    def pierced(self, side: Side, x: Vec2, z: Vec2, window: Opening) -> None:
        """Add a rectangle of wall whose texture has a hole for a window in every bay and storey.

        `window`: its place in the first bay and storey, which repeat every 3 m. Behind the holes stands one pane; jambs
        run up the whole wall.
        """
        (x0, x1), (z0, z1), d = x, z, window.depth_m
        corners = [(x0, z0), (x1, z0), (x1, z1), (x0, z1)]
        uvs = [((a + side.shift_m) / self.wall_width_m, c / WALL_M) for a, c in corners]
        self.meshes["front"].add_polygon([side.at(a, c, 0.0) for a, c in corners], uvs)
        uvs = [((a + side.shift_m) / WALL_M, c / WALL_M) for a, c in corners]
        self.meshes["glass"].add_polygon([side.at(a, c, -d) for a, c in corners], uvs)
        for bay in range(round(x0 / STOREY_M), round(x1 / STOREY_M)):
            a, b = STOREY_M * bay + window.x0, STOREY_M * bay + window.x1
            self.jambs(side, Opening(a, b, 0.0, 0.0, d), (z0 + window.z0 - 0.0, z1 - STOREY_M + window.z1))
            for storey in range(round(z0 / STOREY_M), round(z1 / STOREY_M)):
                self.ledge(side, (a, b), STOREY_M * storey + window.z1, d)
                self.sill(side, (a, b), STOREY_M * storey + window.z0, d, "stone")

    def flat(self, side: Side, x: Vec2, z: Vec2) -> None:
        """Add a rectangle of wall whose texture shows the windows."""
        (x0, x1), (z0, z1) = x, z
        corners = [(x0, z0), (x1, z0), (x1, z1), (x0, z1)]
        uvs = [((a + side.shift_m) / WALL_M, c / WALL_M) for a, c in corners]
        self.meshes["front"].add_polygon([side.at(a, c, 0.0) for a, c in corners], uvs)

    def storey(self, side: Side, x: Vec2, z: Vec2, openings: Sequence[Opening]) -> None:
        """Add a storey of plain wall round its openings, which are ordered along the side."""
        edge = x[0]
        for i, opening in enumerate(openings):
            last = i + 1 == len(openings)
            end = x[1] if last else 0.5 * (opening.x1 + openings[i + 1].x0)
            self.wall(side, (edge, opening.x0), z)
            self.wall(side, (opening.x1, end), z)
            self.wall(side, (opening.x0, opening.x1), (z[0], opening.z0))
            self.wall(side, (opening.x0, opening.x1), (opening.z1, z[1]))
            self.jambs(side, opening, (opening.z0, opening.z1))
            self.ledge(side, (opening.x0, opening.x1), opening.z1, opening.depth_m)
            edge = end
        if not openings:
            self.wall(side, x, z)

    def jambs(self, side: Side, o: Opening, z: Vec2) -> None:
        """Add the left and the right side of an opening. The texture has no hole between two bays, u = 0."""
        (z0, z1), d = z, -o.depth_m
        v0, v1, u = z0 / WALL_M, z1 / WALL_M, o.depth_m / self.wall_width_m
        left = [side.at(o.x0, z0, d), side.at(o.x0, z1, d), side.at(o.x0, z1, 0.0), side.at(o.x0, z0, 0.0)]
        right = [side.at(o.x1, z0, d), side.at(o.x1, z0, 0.0), side.at(o.x1, z1, 0.0), side.at(o.x1, z1, d)]
        self.meshes["wall"].add_polygon(left, [(0.0, v0), (0.0, v1), (u, v1), (u, v0)])
        self.meshes["wall"].add_polygon(right, [(0.0, v0), (u, v0), (u, v1), (0.0, v1)])

    def ledge(self, side: Side, x: Vec2, z: float, depth_m: float) -> None:
        """Add the head of an opening."""
        (x0, x1), d = x, -depth_m
        u0, u1 = (x0 + side.shift_m) / self.wall_width_m, (x1 + side.shift_m) / self.wall_width_m
        v, w = (_PLAIN_FROM_M + 0.2) / WALL_M, (_PLAIN_FROM_M + 0.2 + depth_m) / WALL_M
        head = [side.at(x0, z, d), side.at(x1, z, d), side.at(x1, z, 0.0), side.at(x0, z, 0.0)]
        self.meshes["wall"].add_polygon(head, [(u0, v), (u1, v), (u1, w), (u0, w)])

    def sill(self, side: Side, x: Vec2, z: float, depth_m: float, name: str) -> None:
        """Add the sill of an opening, of stone `name` of BANDS: 6 cm before the wall."""
        (x0, x1), d = (x[0] - 0.06, x[1] + 0.06), -depth_m
        front = [side.at(x0, z - 0.06, 0.06), side.at(x1, z - 0.06, 0.06), side.at(x1, z, 0.06), side.at(x0, z, 0.06)]
        top = [side.at(x[0], z, d), side.at(x0, z, 0.06), side.at(x1, z, 0.06), side.at(x[1], z, d)]
        for points in (front, top):
            self.meshes["wall"].add_polygon(points, self._band_uvs(name, x1 - x0))

    def band(self, side: Side, x: Vec2, z: Vec2, out_m: float, name: str, *, faces: str = "ftb") -> None:
        """Add a band of another stone, `name` of BANDS, before the wall."""
        middle, high = (STOREY_M * BANDS.index(name)) / WALL_M, 0.09 / WALL_M
        (x0, x1), (z0, z1) = x, z
        u0, u1 = (x0 + side.shift_m) / self.wall_width_m, (x1 + side.shift_m) / self.wall_width_m
        corners = {
            "f": ((x0, z0, out_m), (x1, z0, out_m), (x1, z1, out_m), (x0, z1, out_m)),
            "t": ((x0, z1, out_m), (x1, z1, out_m), (x1, z1, 0.0), (x0, z1, 0.0)),
            "b": ((x0, z0, 0.0), (x1, z0, 0.0), (x1, z0, out_m), (x0, z0, out_m)),
        }
        for face in faces:
            uvs = [(u0, middle - high), (u1, middle - high), (u1, middle + high), (u0, middle + high)]
            self.meshes["wall"].add_polygon([side.at(*p) for p in corners[face]], uvs)

    def box(
        self, part: str, side: Side, x: Vec2, z: Vec2, out: Vec2, *, row: str = "white", faces: str = "ftblr",
        once: bool = False,
    ) -> None:  # fmt: skip
        """Add faces of a box: f(ront), t(op), b(ottom), l(eft), r(ight).

        `row`: of the trim, or of BANDS for part `wall`; `once`: its image fills the front.
        """
        (x0, x1), (z0, z1), (o0, o1) = x, z, out
        corners = {
            "f": ((x0, z0, o1), (x1, z0, o1), (x1, z1, o1), (x0, z1, o1), x1 - x0, z1 - z0),
            "t": ((x0, z1, o0), (x0, z1, o1), (x1, z1, o1), (x1, z1, o0), o1 - o0, x1 - x0),
            "b": ((x0, z0, o0), (x1, z0, o0), (x1, z0, o1), (x0, z0, o1), x1 - x0, o1 - o0),
            "l": ((x0, z0, o0), (x0, z0, o1), (x0, z1, o1), (x0, z1, o0), o1 - o0, z1 - z0),
            "r": ((x1, z0, o0), (x1, z1, o0), (x1, z1, o1), (x1, z0, o1), z1 - z0, o1 - o0),
        }
        mesh, uvs_of = self.meshes[part], self._band_uvs if part == "wall" else _row_uvs
        for face in faces:
            *points, wide, high = corners[face]
            turned = face == "t" or (wide < high and not once)  # rows run along the longer edge
            u = 1.0 if once else max(wide, high)
            mesh.add_polygon([side.at(*p) for p in points], uvs_of(row, u, turned=turned))

    def _band_uvs(self, name: str, length_m: float, *, turned: bool = False) -> list[Vec2]:
        """Return texture coordinates of a rectangle in a band of the wall's texture."""
        middle, high, u = (STOREY_M * BANDS.index(name)) / WALL_M, 0.09 / WALL_M, length_m / self.wall_width_m
        if turned:
            return [(0.0, middle + high), (0.0, middle - high), (u, middle - high), (u, middle + high)]
        return [(0.0, middle - high), (u, middle - high), (u, middle + high), (0.0, middle + high)]

    def pane(self, side: Side, o: Opening, cell: int, *, mirrored: bool = False) -> None:
        """Add a pane that shows window `cell` of the texture `panes`, with its frame."""
        e = _BEHIND_M
        x0, x1, z0, z1, out = o.x0 - e, o.x1 + e, o.z0 - e, o.z1 + e, -o.depth_m
        points = [side.at(x0, z0, out), side.at(x1, z0, out), side.at(x1, z1, out), side.at(x0, z1, out)]
        row, column = divmod(cell % _PANE_FIELDS, PANES)
        u0, u1 = column / PANES, (column + 1) / PANES
        v0, v1 = 1.0 - (row + 1) / PANES, 1.0 - row / PANES
        if mirrored:
            u0, u1 = u1, u0
        self.meshes["glass"].add_polygon(points, [(u0, v0), (u1, v0), (u1, v1), (u0, v1)])

    def door(self, side: Side, o: Opening) -> None:
        """Add a door of dark boards with a light above, at the back of an opening."""
        e, z = _BEHIND_M, o.z1 - 0.45
        for low, high, name in ((o.z0 - e, z, "dark"), (z, o.z1 + e, "cream")):
            points = [(o.x0 - e, low), (o.x1 + e, low), (o.x1 + e, high), (o.x0 - e, high)]
            self.meshes["wall"].add_polygon(
                [side.at(a, c, -o.depth_m) for a, c in points], self._band_uvs(name, o.x1 - o.x0)
            )

    def shops(self, side: Side, x: Vec2, first: int) -> None:
        """Add a row of shop windows of one bay each, set back by 0.2 m, to the trim, which holds two kinds."""
        (x0, x1), z0, z1, d = x, 0.0, 2.5, -0.2
        u0, u1 = 0.5 * first, 0.5 * first + 0.5 * (x1 - x0) / STOREY_M
        points = [side.at(x0, z0, d), side.at(x1, z0, d), side.at(x1, z1, d), side.at(x0, z1, d)]
        self.meshes["trim"].add_polygon(points, [(u0, 0.0), (u1, 0.0), (u1, SHOPS_V), (u0, SHOPS_V)])
        self.jambs(side, Opening(x0, x1, z0, z1, -d), (z0, z1))
        self.ledge(side, x, z1, -d)

    def window(self, side: Side, o: Opening, rng: RandomGenerator) -> None:
        """Add a pane drawn at random."""
        cell, mirrored = rng.index(_PANE_FIELDS), rng.chance(0.5)
        self.pane(side, o, cell, mirrored=mirrored)

    def pitched_roof(self, roof: Pitched, *, ridge_along_x: bool = False) -> None:
        """Add a roof with its ridge along y (or x): slopes, soffits, fascias, verges, ridge tiles, gutters."""

        def at(x: float, y: float, z: float) -> Vec3:
            return (-y, x, z) if ridge_along_x else (x, y, z)

        ex, ix, length = roof.eaves_m, roof.wall_m, roof.half_length_m
        slope = sqrt(ex * ex + (roof.ridge_z - roof.eaves_z) * (roof.ridge_z - roof.eaves_z))
        u, v = 2.0 * length / ROOF_TILE_M, slope / ROOF_TILE_M
        tiles, trim = self.meshes["roof"], self.meshes["wall"]
        for s in (1.0, -1.0):
            a, b = -length * s, length * s  # the slope on the other side is the same, turned by half a turn
            top = [
                at(s * ex, a, roof.eaves_z),
                at(s * ex, b, roof.eaves_z),
                at(0.0, b, roof.ridge_z),
                at(0.0, a, roof.ridge_z),
            ]
            tiles.add_polygon(top, [(0.0, 0.0), (u, 0.0), (u, v), (0.0, v)])
            # The lowest row of tiles shows its thickness.
            edge = [
                at(s * ex, a, roof.low_z),
                at(s * ex, b, roof.low_z),
                at(s * ex, b, roof.eaves_z),
                at(s * ex, a, roof.eaves_z),
            ]
            trim.add_polygon(edge, self._band_uvs("dark", 2.0 * length))
            soffit = [
                at(s * ix, a, roof.soffit_z),
                at(s * ix, b, roof.soffit_z),
                at(s * ex, b, roof.low_z),
                at(s * ex, a, roof.low_z),
            ]
            trim.add_polygon(soffit, self._band_uvs("cream", 2.0 * length))
            for end in (-1.0, 1.0):
                y = end * length
                verge = [
                    at(0.0, y, roof.ridge_z),
                    at(s * ex, y, roof.eaves_z),
                    at(s * ex, y, roof.low_z),
                    at(0.0, y, roof.ridge_z - 0.22),
                ]
                trim.add_polygon(verge if s * end < 0.0 else verge[::-1], self._band_uvs("cream", slope))
                under = [
                    at(0.0, y, roof.ridge_z - 0.22),
                    at(s * ex, y, roof.low_z),
                    at(s * ex, y - 0.5 * end, roof.low_z),
                    at(0.0, y - 0.5 * end, roof.ridge_z - 0.22),
                ]
                trim.add_polygon(under if s * end < 0.0 else under[::-1], self._band_uvs("cream", slope))
            # Half-round gutter as three strips below the eaves.
            g = roof.low_z
            rims = [(ex, g - 0.02), (ex + 0.02, g - 0.09), (ex + 0.09, g - 0.09), (ex + 0.12, g)]
            for (x0, z0), (x1, z1) in pairwise(rims):
                strip = [at(s * x0, a, z0), at(s * x0, b, z0), at(s * x1, b, z1), at(s * x1, a, z1)]
                trim.add_polygon(strip, self._band_uvs("dark", 2.0 * length))
        for x0, z0, x1, z1 in ((0.16, -0.085, 0.07, 0.05), (0.07, 0.05, -0.07, 0.05), (-0.07, 0.05, -0.16, -0.085)):
            z = roof.ridge_z
            cap = [at(x0, -length, z + z0), at(x0, length, z + z0), at(x1, length, z + z1), at(x1, -length, z + z1)]
            tiles.add_polygon(cap, [(0.0, 0.01), (u, 0.01), (u, 0.05), (0.0, 0.05)])

    def downpipe(self, side: Side, x: float, top_z: float) -> None:
        """Add a pipe down the wall, with its brackets."""
        self.box("wall", side, (x - 0.045, x + 0.045), (0.15, top_z), (0.03, 0.12), row="dark", faces="flr")

    def add_to(self, builder: MapBuilder, body: Body, materials: dict[str, str]) -> None:
        """Add the meshes to the body as geoms that are not solid. `materials`: by part."""
        for part, mesh in self.meshes.items():
            if mesh.triangles:
                asset = builder.mesh(f"{body.name}_{part}", mesh)
                body.geom("mesh", asset=asset, material=materials[part], solid=False, part=f"shown_{part}")


@dataclass(frozen=True)
class Pitched:
    """Roof with a ridge and two slopes: distances from the ridge's plane and heights [m]."""

    half_length_m: float
    wall_m: float
    eaves_m: float
    ridge_z: float
    eaves_z: float  # top of the tiles at the eaves
    low_z: float  # underside there
    soffit_z: float  # underside at the wall


def _row_uvs(row: str, length_m: float, *, turned: bool = False) -> list[Vec2]:
    """Return texture coordinates of a rectangle in a row of the trim; `turned`: the row runs along its second edge."""
    index, high_v = TRIM_ROWS.index(row), (1.0 - SHOPS_V) / len(TRIM_ROWS)
    low, high = 1.0 - (index + 0.88) * high_v, 1.0 - (index + 0.12) * high_v
    u = length_m
    flat = [(0.0, low), (u, low), (u, high), (0.0, high)]
    return [(0.0, high), (0.0, low), (u, low), (u, high)] if turned else flat
