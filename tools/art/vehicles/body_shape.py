"""Lofted bodies of cars: a lower body whose sections follow a plan outline, and a greenhouse of panes and pillars.

A point of the lower body's skin is that of the plan outline, moved inwards by a profile over the height:

    p = o(s) - n(s) inset(s, q),   q = (z - z_sill) / (z_shoulder(x) - z_sill)
    inset = n_x^2 front_or_rear(q) + n_y^2 side(q)

o is the outline in the plan with its outward normal n. Round a wheel the skin begins at the arch instead of the sill.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, Vec2
from tools.art.vehicles.car_shape import CarShape
from tools.art.vehicles.lofts import add_indexed_grid, add_vertex, at_knots, mix

ARCH_GAP_M = 0.055  # between tyre and arch
_ARCH_STATIONS = 7
_FOOT_M = 0.008
_ROWS = (0.0, 0.12, 0.34, 0.58, 0.68, 0.84, 0.94, 1.0)  # of the height up to the shoulder
_ACROSS = (0.0, 0.10, 0.3, 0.5, 0.7, 0.90, 1.0)  # of a strip from the left shoulder to the right one
_CROWN_M = 0.045
_RINGS = (0.0, 0.06, 0.5, 0.93, 1.0)  # of the greenhouse, from its base to the roof
_ROOF_INSET_M = 0.055  # of the roof's edge from the panes' plane
_ROOF_STEP_M = 0.2  # least distance of the points of a line along the roof
_BULGE_M = 0.02


class LowerBody:
    """Skin from sills to shoulder, with bonnet and boot. Stations run round the left half, from front to rear."""

    def __init__(self, shape: CarShape) -> None:
        self.shape = shape
        self.stations = self._stations()
        n = len(self.stations)
        self.normals: list[Vec2] = []
        for i in range(n):
            (ax, ay), (bx, by) = self.stations[max(i - 1, 0)], self.stations[min(i + 1, n - 1)]
            dx, dy = bx - ax, by - ay
            length = sqrt(dx * dx + dy * dy)
            self.normals.append((dy / length, -dx / length))
        self.normals[0], self.normals[-1] = (1.0, 0.0), (-1.0, 0.0)
        # Profiles at the rows of the mesh: points between rows then lie on its faces.
        self._front, self._rear, self._side = (
            tuple((q, at_knots(knots, q)) for q in _ROWS) for knots in (shape.front, shape.rear, shape.side)
        )

    def _stations(self) -> list[Vec2]:
        """Return points of the plan outline (x, y), from the middle of the front to the middle of the rear."""
        s = self.shape
        half_l, half_w = 0.5 * s.length_m, 0.5 * s.width_m
        points: list[Vec2] = []
        for sign, (a, b) in ((1.0, s.corner_front), (-1.0, s.corner_rear)):
            face = half_w - b
            bow = 0.05
            end = [(sign * (half_l - bow * (y / face) * (y / face)), y) for y in (0.0, 0.3 * face, 0.62 * face, face)]
            # The corner bends from the face to the side: a quarter of an ellipse.
            for k in range(1, 7):
                angle = TURN_RAD / 4 * k / 6
                end.append((sign * (half_l - bow - a * (1.0 - det_cos(angle))), face + (b - 0.008) * det_sin(angle)))
            points += end if sign > 0 else end[::-1]
            if sign > 0:
                points += self._side_stations(half_l - bow - a, -(half_l - bow - s.corner_rear[0]))
        return points

    def _side_stations(self, x_front: float, x_rear: float) -> list[Vec2]:
        s = self.shape
        half_w = 0.5 * s.width_m
        xs = []
        for wheel in s.wheels_x_m:
            reach = self.arch_m() - 1e-6
            xs += [wheel + reach + _FOOT_M, wheel - reach - _FOOT_M]  # there the skin reaches down to the sill
            for k in range(_ARCH_STATIONS):
                xs.append(wheel + reach * det_cos(TURN_RAD / 2 * k / (_ARCH_STATIONS - 1)))
        for x, _ in s.shoulder:
            if all(abs(x - other) > 0.12 for other in xs):
                xs.append(x)
        for x in (0.55, 0.0, -0.5):
            if all(abs(x - other) > 0.2 for other in xs):
                xs.append(x)
        xs = sorted((x for x in xs if x_rear + 0.04 < x < x_front - 0.04), reverse=True)
        return [(x, half_w - 0.008 * (x / (0.5 * s.length_m)) * (x / (0.5 * s.length_m))) for x in xs]

    def arch_m(self) -> float:
        return self.shape.wheel_m + ARCH_GAP_M

    def low_m(self, x: float) -> float:
        """Return the height of the lower edge of the side at x."""
        s = self.shape
        low = s.clearance_m
        for wheel in s.wheels_x_m:
            square = self.arch_m() * self.arch_m() - (x - wheel) * (x - wheel)
            if square > 0.0:
                low = max(low, s.wheel_m + sqrt(square))
        return low

    def shoulder_m(self, x: float) -> float:
        return at_knots(self.shape.shoulder, x)

    def point(self, station: float, z: float, out_m: float = 0.0) -> Vec3:
        """Return the point of the skin at a station (a fraction lies between two) and a height, moved outwards."""
        i = min(int(station), len(self.stations) - 2)
        t = station - i
        (ax, ay), (bx, by) = self.stations[i], self.stations[i + 1]
        (anx, any_), (bnx, bny) = self.normals[i], self.normals[i + 1]
        x, y, nx, ny = mix(ax, bx, t), mix(ay, by, t), mix(anx, bnx, t), mix(any_, bny, t)
        sill = self.shape.clearance_m
        q = min(max((z - sill) / (self.shoulder_m(x) - sill), 0.0), 1.0)
        end = at_knots(self._front if nx > 0.0 else self._rear, q)
        inset = nx * nx * end + ny * ny * at_knots(self._side, q) - out_m
        return x - nx * inset, y - ny * inset, z

    def lid_point(self, x: float, share: float, out_m: float = 0.0) -> Vec3:
        """Return a point on bonnet or boot lid, at `share` (-1 to 1, to the left) of its half width."""
        _, y, z = self.point(self.at_x(x), self.shoulder_m(x))
        return x, share * y, z + _CROWN_M * (1.0 - share * share) * 2.0 * y / self.shape.width_m + out_m

    def at_x(self, x: float) -> float:
        """Return the station at x on the side."""
        return self._where(lambda p: -p[0], -x, 3, len(self.stations) - 4)

    def front_at_y(self, y: float) -> float:
        """Return the station at y on the front face or its corner."""
        return self._where(lambda p: p[1], y, 0, 9)

    def rear_at_y(self, y: float) -> float:
        return self._where(lambda p: -p[1], -y, len(self.stations) - 10, len(self.stations) - 1)

    def _where(self, key, value: float, low: int, high: int) -> float:  # type: ignore[no-untyped-def]
        for i in range(low, high):
            a, b = key(self.stations[i]), key(self.stations[i + 1])
            if a <= value <= b:
                return i + (value - a) / (b - a) if b > a else float(i)
        return float(low if value < key(self.stations[low]) else high)

    def add_to(self, mesh: Mesh) -> None:
        """Add the closed skin."""
        lows = [self.low_m(x) if self._on_side(i) else self.shape.clearance_m for i, (x, _) in enumerate(self.stations)]
        self._add_loft(mesh, range(len(self.stations)), lows, _ROWS, _ACROSS, _CROWN_M)

    def hull(self) -> Mesh:
        """Return a closed mesh of few points of the skin, without arches: its convex hull is the body for contact."""
        n = len(self.stations)
        side = [i for i in range(10, n - 10) if (i - 10) % 6 == 0]
        mesh = Mesh.empty()
        lows = [self.shape.clearance_m] * n
        self._add_loft(
            mesh, [0, 3, 5, 7, *side, n - 8, n - 6, n - 4, n - 1], lows, (0.0, 0.34, 0.68, 1.0), (0.0, 1.0), 0.0
        )
        return mesh

    def _add_loft(
        self,
        mesh: Mesh,
        stations: Sequence[int],
        lows: Sequence[float],
        shares: Sequence[float],
        across: Sequence[float],
        crown_m: float,
    ) -> None:
        left: list[list[int]] = []
        right: list[list[int]] = []
        last = len(self.stations) - 1
        for share in shares:
            row_l, row_r = [], []
            for i in stations:
                x, y, z = self.point(i, mix(lows[i], self.shoulder_m(self.stations[i][0]), share))
                row_l.append(add_vertex(mesh, (x, y, z)))
                row_r.append(row_l[-1] if i in (0, last) else add_vertex(mesh, (x, -y, z)))
            left.append(row_l)
            right.append(row_r)
        add_indexed_grid(mesh, [a + b[-2:0:-1] for a, b in zip(left, right, strict=True)], closed=True)
        add_strips(mesh, left[-1], right[-1], across, crown_m)
        # Underside: straight across, seen from below.
        add_indexed_grid(mesh, [right[0], left[0]])

    def _on_side(self, station: int) -> bool:
        return 9 < station < len(self.stations) - 10


def add_strips(mesh: Mesh, left: Sequence[int], right: Sequence[int], across: Sequence[float], crown_m: float) -> None:
    """Close the space between two rows of vertices, front to rear, by a surface that is higher in the middle."""
    widest = max(abs(mesh.vertices[i][1]) for i in left)
    rows: list[list[int]] = []
    for a, b in zip(left, right, strict=True):
        if a == b:
            rows.append([a] * len(across))
            continue
        p, q = mesh.vertices[a], mesh.vertices[b]
        row = [a]
        for t in across[1:-1]:
            u = 2.0 * t - 1.0
            rise = crown_m * (1.0 - u * u) * p[1] / widest
            row.append(add_vertex(mesh, (mix(p[0], q[0], t), mix(p[1], q[1], t), mix(p[2], q[2], t) + rise)))
        rows.append([*row, b])
    # Seen from above with the front at the top: columns run from left to right, rows to the front.
    add_indexed_grid(mesh, rows[::-1])


class Greenhouse:
    """Panes, pillars and roof of a car."""

    def __init__(self, shape: CarShape, body: LowerBody) -> None:
        self.shape = shape
        self._body = body

    def point(self, column: float, share: float, out_m: float = 0.0) -> Vec3:
        """Return a point on the left half at a column (a fraction lies between two) and a share of the height."""
        s = self.shape
        columns = s.columns
        i = min(int(column), len(columns) - 2)
        t = column - i
        a, b = columns[i], columns[i + 1]
        bx, by = mix(a.base[0], b.base[0], t), s.half_base_m * mix(a.base[1], b.base[1], t)
        rx, ry = mix(a.roof[0], b.roof[0], t), s.half_roof_m * mix(a.roof[1], b.roof[1], t)
        z0 = self._body.shoulder_m(bx) - 0.02
        if by < 0.9 * s.half_base_m:
            z0 += 0.6 * _CROWN_M * (1.0 - by / s.half_base_m)
        z1 = at_knots(s.roof, rx)
        dx, dy = b.base[0] - a.base[0], s.half_base_m * (b.base[1] - a.base[1])
        length = sqrt(dx * dx + dy * dy)
        nx, ny = dy / length, -dx / length
        out = out_m + _BULGE_M * 4.0 * share * (1.0 - share)
        if share > _RINGS[-2]:
            # The edge of the roof is rounded: the last ring lies further in.
            out -= _ROOF_INSET_M * (share - _RINGS[-2]) / (1.0 - _RINGS[-2])
        y = max(mix(by, ry, share) + ny * out, 0.0)
        return mix(bx, rx, share) + nx * out, y, mix(z0, z1, share) + 0.3 * out_m

    def add_to(self, mesh: Mesh, *, open_front: bool = False) -> None:
        """Add pillars and roof; with `open_front` the skin has holes for the front side windows."""
        n = len(self.shape.columns)
        left: list[list[int]] = []
        right: list[list[int]] = []
        for share in _RINGS:
            row_l, row_r = [], []
            for i in range(n):
                x, y, z = self._smooth_point(i, share)
                row_l.append(add_vertex(mesh, (x, y, z)))
                row_r.append(row_l[-1] if i in (0, n - 1) else add_vertex(mesh, (x, -y, z)))
            left.append(row_l)
            right.append(row_r)
        holes = self._open(open_front)
        for k in range(len(_RINGS) - 1):
            for i in range(n - 1):
                if i in holes and 0 < k < len(_RINGS) - 2:
                    continue
                add_indexed_grid(mesh, [left[k][i : i + 2], left[k + 1][i : i + 2]])
                add_indexed_grid(mesh, [right[k][i : i + 2][::-1], right[k + 1][i : i + 2][::-1]])
        add_strips(mesh, left[-1], right[-1], (0.0, 0.14, 0.38, 0.62, 0.86, 1.0), 0.05)
        add_indexed_grid(mesh, [right[0], left[0]])

    def hull(self) -> Mesh:
        """Return a closed mesh whose convex hull is the greenhouse for contact."""
        mesh = Mesh.empty()
        columns = self.shape.columns
        chosen = [
            0,
            2,
            3,
            *(i for i in range(4, len(columns) - 3) if i % 3 == 0),
            *range(len(columns) - 3, len(columns)),
        ]
        left: list[list[int]] = []
        right: list[list[int]] = []
        for share in (0.0, 0.93, 1.0):
            points = [self._smooth_point(i, share) for i in chosen]
            left.append([add_vertex(mesh, (x, y, z)) for x, y, z in points])
            right.append([left[-1][0], *(add_vertex(mesh, (x, -y, z)) for x, y, z in points[1:-1]), left[-1][-1]])
        add_indexed_grid(mesh, [a + b[-2:0:-1] for a, b in zip(left, right, strict=True)], closed=True)
        add_strips(mesh, left[-1], right[-1], (0.0, 0.38, 0.62, 1.0), 0.05)
        add_indexed_grid(mesh, [right[0], left[0]])
        return mesh

    def _smooth_point(self, i: int, share: float) -> Vec3:
        """Return the mean of the points that the faces before and after column `i` give."""
        n = len(self.shape.columns)
        if i in (0, n - 1):
            x, _, z = self.point(i, share)
            return x, 0.0, z
        a, b = self.point(i, share), self.point(i - 1e-9, share)
        return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])

    def roof_point(self, x: float, share: float, out_m: float = 0.0) -> Vec3:
        """Return a point on the roof, at `share` (-1 to 1, to the left) of its half width."""
        y = self.shape.half_roof_m - _ROOF_INSET_M
        return x, share * y, at_knots(self._roof_knots(), x) + 0.05 * (1.0 - share * share) + out_m

    def roof_line_m(self, first: float, last: float) -> list[float]:
        """Return where a line along the roof from `first` to `last` needs points, so that it lies on the faces."""
        rear, front = sorted((first, last))
        line = [rear]
        line += [x for x, _ in self._roof_knots() if rear + _ROOF_STEP_M < x < front - _ROOF_STEP_M]
        for at in range(len(line) - 1, 0, -1):  # corners that lie close together need one point only
            if line[at] - line[at - 1] < _ROOF_STEP_M:
                del line[at]
        line.append(front)
        return line if first == rear else line[::-1]

    def _roof_knots(self) -> list[Vec2]:
        """Return (x, z) of the corners of the roof's faces along its edge, from the rear."""
        return [(x, at_knots(self.shape.roof, x)) for x in sorted({c.roof[0] for c in self.shape.columns})]

    def _open(self, open_front: bool) -> list[int]:
        return self._panes()[2:3] if open_front else []

    def _panes(self) -> list[int]:
        return [i for i, column in enumerate(self.shape.columns) if column.pane]

    def add_panes(self, glass: Mesh, trim: Mesh, *, open_front: bool = False) -> None:
        """Add the glass, slightly before the skin; with `open_front` the front side windows have none."""
        for i in self._panes():
            if i in self._open(open_front):
                continue
            top = 0.93 if self.shape.columns[i].pane == "glass" else 0.68
            self._add_pane(glass, i, (0.07, 0.5 * (0.07 + top), top), 0.008)
            if i < 2:  # the windscreen ends above the wipers
                self._add_pane(trim, i, (0.0, 0.07), 0.010)

    def _add_pane(self, mesh: Mesh, column: int, shares: Sequence[float], out_m: float) -> None:
        rows = []
        for share in shares:
            row = []
            for c in (column, column + 1):
                p = self._smooth_point(c, share)
                # Panes side by side have one normal at their common edge, so that no gap opens.
                before, after = c > 0 and bool(self.shape.columns[c - 1].pane), bool(self.shape.columns[c].pane)
                lines = [c - 0.5] * before + [c + 0.5] * after
                shift = [0.0, 0.0, 0.0]
                for line in lines:
                    q, r = self.point(line, share, out_m), self.point(line, share)
                    shift = [s + (b - a) / len(lines) for s, a, b in zip(shift, r, q, strict=True)]
                row.append(
                    (p[0] + shift[0], p[1] + shift[1] if self.shape.columns[c].base[1] else 0.0, p[2] + shift[2])
                )
            rows.append(row)
        a, b = self.shape.columns[column], self.shape.columns[column + 1]
        across = self.shape.half_base_m * abs(b.base[1] - a.base[1]) > abs(b.base[0] - a.base[0])
        for side in (1.0, -1.0):
            indices = []
            for j, row in enumerate(rows):
                v = j / (len(rows) - 1)
                us = [0.5 + 0.5 * side * c.base[1] for c in (a, b)] if across else [0.98, 0.02]
                edge = [
                    add_vertex(mesh, (x, side * y, z), (u, (0.51 if across else 0.01) + 0.48 * v))
                    for (x, y, z), u in zip(row, us, strict=True)
                ]
                indices.append(edge if side > 0 else edge[::-1])
            add_indexed_grid(mesh, indices)


def skin_patch(
    body: LowerBody,
    stations: Sequence[float],
    lower_m: Sequence[float],
    upper_m: Sequence[float],
    out_m: float,
    rows: int = 2,
) -> list[list[Vec3]]:
    """Return rows of points on the lower body's left half, bottom to top, `out_m` before the skin."""
    return [
        [
            body.point(s, mix(low, high, j / (rows - 1)), out_m)
            for s, low, high in zip(stations, lower_m, upper_m, strict=True)
        ]
        for j in range(rows)
    ]


def arch_points(body: LowerBody, wheel_x_m: float, radius_m: float) -> list[Vec2]:
    """Return points (x, z) of an arch from its front foot to its rear foot."""
    z = body.shape.wheel_m
    points = [(wheel_x_m + radius_m, body.shape.clearance_m)]
    for k in range(11):
        angle = TURN_RAD / 2 * k / 10
        points.append((wheel_x_m + radius_m * det_cos(angle), z + radius_m * det_sin(angle)))
    return [*points, (wheel_x_m - radius_m, body.shape.clearance_m)]
