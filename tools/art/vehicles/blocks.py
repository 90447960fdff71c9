"""Blocks with rounded upright edges, and what lies on their faces: panes, lamps, arches."""

from __future__ import annotations

from collections.abc import Sequence

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, Vec2
from tools.art.vehicles.lofts import add_indexed_grid, add_sheet, add_vertex

Ring = tuple[float, float, float, float]  # z, x at the rear, x at the front, half width


def add_block(
    mesh: Mesh, rings: Sequence[Ring], radius_m: float, *, bow_m: float = 0.0, steps: int = 4, middle_y_m: float = 0.0
) -> None:
    """Add a closed block through rings from bottom to top, about y = `middle_y_m`. `bow_m`: how far the front bends."""
    rows = []
    for z, rear, front, half in rings:
        row = []
        outline: list[Vec2] = []
        for cx, cy, first in (
            (front - radius_m, half - radius_m, 0), (rear + radius_m, half - radius_m, 1),
            (rear + radius_m, -half + radius_m, 2), (front - radius_m, -half + radius_m, 3),
        ):  # fmt: skip
            for k in range(steps + 1):
                angle = TURN_RAD / 4 * (first + k / steps)
                outline.append((cx + radius_m * det_cos(angle), cy + radius_m * det_sin(angle)))
        for x, y in outline:
            shift = bow_m * (y / half) * (y / half) if x > 0.5 * (front + rear) else 0.0
            row.append(add_vertex(mesh, (x - shift, middle_y_m + y, z)))
        rows.append(row)
    add_indexed_grid(mesh, rows, closed=True)
    # Lid and floor have vertices of their own, so that their edges stay sharp.
    for row, up in ((rows[-1], True), (rows[0], False)):
        points = [mesh.vertices[i] for i in row]
        mesh.add_polygon(points if up else points[::-1], [(0.0, 0.0)] * len(points))


def add_side_sheet(mesh: Mesh, x_rear: float, x_front: float, z_low: float, z_high: float, y: float) -> None:
    """Add an upright rectangle that looks along +y or, for y < 0, along -y."""
    xs = (x_front, x_rear) if y > 0.0 else (x_rear, x_front)
    add_sheet(mesh, [[(x, y, z) for x in xs] for z in (z_low, z_high)])


def add_end_sheet(
    mesh: Mesh, x_low: float, x_high: float, y0: float, y1: float, z_low: float, z_high: float, facing: float
) -> None:
    """Add a rectangle between y0 < y1 that looks along +x (`facing` 1) or -x; x may differ at its edges."""
    ys = (y0, y1) if facing > 0.0 else (y1, y0)
    add_sheet(mesh, [[(x, y, z) for y in ys] for x, z in ((x_low, z_low), (x_high, z_high))])


def add_disc_sheet(mesh: Mesh, centre: Vec3, radius_m: float, facing: float, *, low_m: float) -> None:
    """Add a disc across y that looks along `facing` y, without what lies below z = `low_m`."""
    points = []
    for k in range(17):
        angle = TURN_RAD / 2 * k / 16
        points.append((centre[0] + radius_m * det_cos(angle), centre[1], centre[2] + radius_m * det_sin(angle)))
    points += [(centre[0] - radius_m, centre[1], low_m), (centre[0] + radius_m, centre[1], low_m)]
    points = points[::-1] if facing > 0.0 else points
    mesh.add_polygon(points, [(0.0, 0.0)] * len(points))
