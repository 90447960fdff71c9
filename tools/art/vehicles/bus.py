"""City bus, 11 x 2.55 x 3.1 m, with doors on its right side."""

from __future__ import annotations

from itertools import pairwise

from sim.scene.maps.meshes import Mesh
from tools.art.vehicles.blocks import Ring, add_block, add_disc_sheet, add_end_sheet, add_side_sheet
from tools.art.vehicles.lofts import add_box, add_ellipsoid, add_sheet, add_tube
from tools.art.vehicles.parts import MATERIALS, Parts, Proxy, add_plate, axle_proxies
from tools.art.vehicles.wheels import add_wheel

LENGTH_M, WIDTH_M, HEIGHT_M = 11.0, 2.55, 3.1
WHEEL_M = 0.48
AXLES_M = (2.75, -3.15)
_HALF = 0.5 * WIDTH_M
_BODY: tuple[Ring, ...] = (
    (0.28, -5.42, 5.40, _HALF - 0.03), (0.45, -5.48, 5.48, _HALF), (1.05, -5.5, 5.5, _HALF),
    (1.15, -5.5, 5.49, _HALF - 0.005), (2.55, -5.46, 5.36, _HALF - 0.04), (2.80, -5.42, 5.30, _HALF - 0.07),
    (2.93, -5.34, 5.20, _HALF - 0.16), (2.98, -5.20, 5.05, _HALF - 0.34),
)  # fmt: skip
_ROOF_UNIT: tuple[Ring, ...] = ((2.97, -2.6, 0.2, 0.85), (3.08, -2.5, 0.1, 0.78), (3.1, -2.35, -0.05, 0.65))


def bus_parts() -> Parts:
    parts = {name: Mesh.empty() for name in MATERIALS}
    paint, glass, trim, head, tail = (parts[name] for name in ("paint", "glass", "trim", "head_lamp", "tail_lamp"))
    add_block(paint, _BODY, 0.16, bow_m=0.06)
    add_block(paint, _ROOF_UNIT, 0.1)
    add_block(trim, ((0.18, -5.2, 5.1, _HALF - 0.12), (0.30, -5.2, 5.1, _HALF - 0.12)), 0.1)
    for side in (1.0, -1.0):
        # A continuous dark band with the panes; doors on the right reach down.
        low = [(side * y, z) for y, z in ((_HALF + 0.005, 1.10), (_HALF - 0.030, 2.46))]
        xs = [5.14, -5.0] if side > 0 else [-5.0, 5.14]
        add_sheet(trim, [[(x, y, z) for x in xs] for y, z in low])
        edges = [5.10, 4.1, 2.75, 1.4, 0.05, -1.3, -2.65, -4.0, -4.95]
        for front, rear in pairwise(edges):
            pane = [(side * y, z) for y, z in ((_HALF + 0.009, 1.16), (_HALF - 0.022, 2.40))]
            ends = [front - 0.03, rear + 0.03] if side > 0 else [rear + 0.03, front - 0.03]
            add_sheet(glass, [[(x, y, z) for x in ends] for y, z in pane])
        for x in AXLES_M:
            add_disc_sheet(trim, (x, side * (_HALF + 0.004), WHEEL_M), WHEEL_M + 0.09, side, low_m=0.26)
            add_wheel(parts["tyre"], parts["rim"], (x, side * (_HALF + 0.012), WHEEL_M), WHEEL_M, 0.28, 8, side)
    for front, rear in ((5.08, 3.92), (0.62, -0.72)):
        add_side_sheet(trim, rear, front, 0.36, 2.46, -_HALF - 0.006)
        middle = 0.5 * (front + rear)
        for a, b in ((front - 0.06, middle + 0.03), (middle - 0.03, rear + 0.06)):
            add_side_sheet(glass, b, a, 0.46, 2.40, -_HALF - 0.014)
    _add_front(parts)
    add_end_sheet(glass, -5.507, -5.475, -0.95, 0.95, 1.45, 2.45, -1.0)
    add_end_sheet(trim, -5.507, -5.507, -0.9, 0.9, 0.55, 1.25, -1.0)
    for side in (1.0, -1.0):
        for bottom, top, mesh in ((0.75, 1.15, tail), (1.18, 1.30, head), (2.55, 2.68, tail)):
            y0, y1 = sorted((side * 0.97, side * 1.10))
            in_m = 0.06 * (bottom > 2.0)
            add_end_sheet(mesh, -5.512 + in_m, -5.512 + in_m, y0, y1, bottom, top, -1.0)
    add_plate(parts["plate"], (-5.52, 0.0, 0.45), -1.0)
    add_ellipsoid(trim, (5.55, 1.32, 2.25), (0.10, 0.09, 0.24), rings=5, sides=8)
    add_ellipsoid(trim, (5.55, -1.32, 2.25), (0.10, 0.09, 0.24), rings=5, sides=8)
    for side in (1.0, -1.0):
        add_tube(trim, [(5.22, side * 1.14, 2.55), (5.5, side * 1.28, 2.60), (5.55, side * 1.32, 2.40)], 0.025, 5)
    add_box(trim, (5.30, -1.0, 0.30), (5.49, 1.0, 0.44))
    return parts


def _add_front(parts: Parts) -> None:
    """Add windscreen, destination sign, lamps and plate."""
    glass, trim, head = parts["glass"], parts["trim"], parts["head_lamp"]
    ys = (-1.16, -0.6, 0.0, 0.6, 1.16)

    def bowed(z: float, out: float) -> list[tuple[float, float, float]]:
        x = 5.5 if z <= 1.05 else 5.49 - (z - 1.15) * 0.13 / 1.40 if z <= 2.55 else 5.36 - (z - 2.55) * 0.24
        return [(x - 0.06 * (y / _HALF) * (y / _HALF) + out, y, z) for y in ys]

    add_sheet(glass, [bowed(1.02, 0.014), bowed(1.6, 0.014), bowed(2.36, 0.014)])
    add_sheet(trim, [bowed(2.37, 0.012), bowed(2.56, 0.012), bowed(2.72, 0.014)])
    # Letters of the destination: a row of lit dashes.
    for k in range(7):
        y = -0.62 + 0.17 * k
        width = (0.10, 0.12, 0.06, 0.12, 0.10, 0.12, 0.08)[k]
        add_end_sheet(parts["lit"], 5.385, 5.36, y, y + width, 2.47, 2.63, 1.0)
    for side in (1.0, -1.0):
        y0, y1 = sorted((side * 0.72, side * 1.08))
        add_end_sheet(trim, 5.488, 5.488, y0 - 0.03, y1 + 0.03, 0.57, 0.83, 1.0)
        add_end_sheet(head, 5.500, 5.500, y0, y1, 0.60, 0.80, 1.0)
    add_end_sheet(trim, 5.507, 5.507, -0.55, 0.55, 0.62, 0.80, 1.0)
    add_plate(parts["plate"], (5.512, 0.0, 0.45), 1.0)


def bus_proxies() -> list[Proxy]:
    body, unit = Mesh.empty(), Mesh.empty()
    add_block(body, _BODY, 0.16, bow_m=0.06, steps=1)
    add_block(unit, _ROOF_UNIT, 0.1, steps=1)
    return [Proxy("hull", hull=body), Proxy("hull", hull=unit), *axle_proxies(AXLES_M, WHEEL_M, _HALF, 0.14)]
