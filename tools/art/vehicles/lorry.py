"""Lorry with a box body, 8 x 2.5 x 3.3 m."""

from __future__ import annotations

from sim.scene.maps.meshes import Mesh
from tools.art.vehicles.blocks import Ring, add_block, add_disc_sheet, add_end_sheet, add_side_sheet
from tools.art.vehicles.lofts import add_box, add_sheet, add_tube
from tools.art.vehicles.parts import MATERIALS, Parts, Proxy, add_plate, axle_proxies
from tools.art.vehicles.wheels import add_steel_wheel

LENGTH_M, WIDTH_M, HEIGHT_M = 8.0, 2.5, 3.3
WHEEL_M = 0.47
AXLES_M = (2.85, -2.15)
_HALF = 0.5 * WIDTH_M
_CAB = 1.16  # half width of the cab
_CABIN: tuple[Ring, ...] = (
    (0.42, 2.12, 3.93, _CAB - 0.02), (0.62, 2.12, 3.98, _CAB), (1.35, 2.12, 3.98, _CAB),
    (1.50, 2.12, 3.96, _CAB - 0.005), (2.35, 2.14, 3.76, _CAB - 0.06), (2.55, 2.16, 3.60, _CAB - 0.10),
    (2.64, 2.24, 3.42, _CAB - 0.20),
)  # fmt: skip
# The deflector stands on the roof of the cab, narrower than it, and leans back to the front wall of the body.
_DEFLECTOR: tuple[Ring, ...] = (
    (2.60, 2.20, 3.12, 0.90), (2.72, 2.20, 3.04, 0.92), (2.98, 2.22, 2.72, 0.92), (3.16, 2.24, 2.46, 0.90),
    (3.22, 2.28, 2.36, 0.82),
)  # fmt: skip


def lorry_parts() -> Parts:
    parts = {name: Mesh.empty() for name in MATERIALS}
    paint, glass, trim, rim, head, tail, box = (
        parts[name] for name in ("paint", "glass", "trim", "rim", "head_lamp", "tail_lamp", "box")
    )
    add_block(paint, _CABIN, 0.14, bow_m=0.05)
    add_block(paint, _DEFLECTOR, 0.06)
    _add_body(box)
    for z in (1.02, 3.24):  # edges of the box in metal
        add_box(rim, (-4.01, -_HALF - 0.006, z), (2.01, _HALF + 0.006, z + 0.07))
    for x in (-4.012, 1.942):
        for y in (-_HALF - 0.006, _HALF - 0.064):
            add_box(rim, (x, y, 1.05), (x + 0.07, y + 0.07, 3.28))
    add_box(trim, (-3.85, -0.42, 0.62), (3.3, 0.42, 1.02))
    add_box(trim, (1.0, -1.05, 0.45), (1.9, -0.5, 0.95))
    add_box(rim, (-0.2, 0.55, 0.45), (1.0, 1.08, 0.95))  # tank
    for side in (1.0, -1.0):
        for z in (0.50, 0.76):
            add_box(rim, (-1.45, side * 1.16 - 0.02, z), (1.75, side * 1.16 + 0.02, z + 0.12))
        add_box(trim, (AXLES_M[1] - 0.6, side * 1.0 - 0.24, 0.985), (AXLES_M[1] + 0.6, side * 1.0 + 0.24, 1.03))
        add_box(trim, (AXLES_M[1] - 0.63, side * 1.0 - 0.22, 0.35), (AXLES_M[1] - 0.60, side * 1.0 + 0.22, 1.0))
        add_disc_sheet(trim, (AXLES_M[0], side * (_CAB + 0.006), WHEEL_M), WHEEL_M + 0.09, side, low_m=0.40)
        add_steel_wheel(parts["tyre"], rim, trim, (AXLES_M[0], side * (_CAB + 0.02), WHEEL_M), WHEEL_M, 0.30, side)
        add_steel_wheel(parts["tyre"], rim, trim, (AXLES_M[1], side * (_HALF - 0.03), WHEEL_M), WHEEL_M, 0.55, side)
        # Side window, door seams, handle, mirror.
        rows = [(_CAB + 0.004, 1.52), (_CAB - 0.045, 2.30)]
        fronts = (3.72, 3.56)
        pane = [
            [(x, side * y, z) for x in ((front, 2.72) if side > 0 else (2.72, front))]
            for (y, z), front in zip(rows, fronts, strict=True)
        ]
        first = len(glass.uvs)
        add_sheet(glass, pane)
        glass.uvs[first:] = [(u, 0.5 * v) for u, v in glass.uvs[first:]]  # the side window of the texture
        for x in (2.62, 3.80):
            add_side_sheet(trim, x, x + 0.018, 0.80, 1.48, side * (_CAB + 0.004))
        add_side_sheet(trim, 2.62, 3.82, 0.78, 0.80, side * (_CAB + 0.004))
        # The lower edge of the cab, dark from bumper to wheel and behind it.
        for rear, front in ((3.42, 3.80), (2.14, 2.28)):
            add_side_sheet(trim, rear, front, 0.44, 0.62, side * (_CAB + 0.005))
        # Steps below the door, the air intake behind it, and the gap between cab and body.
        for z in (0.42, 0.60):
            add_side_sheet(trim, 3.40, 3.88, z, z + 0.10, side * (_CAB + 0.006))
        add_side_sheet(trim, 2.16, 2.34, 1.05, 2.30, side * (_CAB + 0.006))
        # Side marker lamps along the lower edge of the body.
        for x in (-3.7, -2.2, -0.7, 0.8, 1.85):
            add_side_sheet(parts["lit"], x - 0.06, x + 0.06, 1.035, 1.085, side * (_HALF + 0.012))
        y0, y1 = sorted((side * 0.98, side * 1.08))
        add_end_sheet(parts["lit"], 3.995, 3.995, y0, y1, 0.58, 0.64, 1.0)
        add_box(trim, (2.70, side * _CAB - 0.03, 1.36), (2.90, side * _CAB + 0.03, 1.41))
        # Mirrors: a tall housing on two arms, its glass to the rear, and a small wide-angle one below.
        y0, y1 = sorted((side * 1.22, side * 1.42))
        for low, high in ((1.86, 2.26), (1.62, 1.82)):
            add_block(trim, (
                (low, 3.79, 3.86, 0.10), (low + 0.03, 3.78, 3.88, 0.11), (high - 0.03, 3.78, 3.88, 0.11),
                (high, 3.79, 3.86, 0.10),
            ), 0.03, steps=2, middle_y_m=side * 1.32)  # fmt: skip
            add_end_sheet(glass, 3.776, 3.776, y0 + 0.02, y1 - 0.02, low + 0.04, high - 0.04, -1.0)
        for z in (1.70, 2.24):
            add_tube(trim, [(3.72, side * 1.08, z + 0.06), (3.84, side * 1.32, z)], 0.02, 5)
        # Lamps in the bumper: a dark recess, a bright reflector and a round lens.
        y0, y1 = sorted((side * 0.70, side * 1.08))
        add_end_sheet(trim, 4.002, 4.002, y0 - 0.02, y1 + 0.02, 0.395, 0.575, 1.0)
        add_end_sheet(head, 4.006, 4.006, y0, y1, 0.415, 0.555, 1.0)
        for y in (side * 0.80, side * 0.98):
            add_end_sheet(glass, 4.010, 4.010, y - 0.055, y + 0.055, 0.43, 0.54, 1.0)
        y0, y1 = sorted((side * 0.75, side * 1.15))
        add_box(trim, (-3.96, y0, 0.70), (-3.90, y1, 0.92))
        add_end_sheet(tail, -3.965, -3.965, y0 + 0.02, y1 - 0.02, 0.73, 0.89, -1.0)
        y0, y1 = sorted((side * 1.02, side * 1.16))
        add_end_sheet(tail, -4.016, -4.016, y0, y1, 3.14, 3.21, -1.0)
    _add_ends(parts)
    return parts


def _add_body(box: Mesh) -> None:
    """Add the box body. Its texture has the sides in the upper half, doors and roof in the lower one."""
    low, high = 1.02, 3.3
    for side in (1.0, -1.0):
        y = side * _HALF
        ends = (2.0, -4.0) if side > 0.0 else (-4.0, 2.0)
        corners = [(ends[0], y, low), (ends[1], y, low), (ends[1], y, high), (ends[0], y, high)]
        box.add_polygon(corners, [(0.0, 0.5), (1.0, 0.5), (1.0, 1.0), (0.0, 1.0)])
    rear = [(-4.0, _HALF, low), (-4.0, -_HALF, low), (-4.0, -_HALF, high), (-4.0, _HALF, high)]
    front = [(2.0, -_HALF, low), (2.0, _HALF, low), (2.0, _HALF, high), (2.0, -_HALF, high)]
    for corners in (rear, front):
        box.add_polygon(corners, [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)])
    top, edge = high + 0.014, _HALF - 0.06  # above the rails
    roof = [(-3.94, -edge, top), (1.94, -edge, top), (1.94, edge, top), (-3.94, edge, top)]
    box.add_polygon(roof, [(0.5, 0.5), (0.5, 0.0), (1.0, 0.0), (1.0, 0.5)])
    floor = [(-4.0, _HALF, low), (2.0, _HALF, low), (2.0, -_HALF, low), (-4.0, -_HALF, low)]
    box.add_polygon(floor, [(0.5, 0.5), (0.5, 0.0), (1.0, 0.0), (1.0, 0.5)])


def _add_ends(parts: Parts) -> None:
    glass, trim, rim = parts["glass"], parts["trim"], parts["rim"]
    ys = (-1.02, -0.5, 0.0, 0.5, 1.02)

    def bowed(x: float, z: float) -> list[tuple[float, float, float]]:
        return [(x - 0.05 * (y / _CAB) * (y / _CAB) + 0.012, y, z) for y in ys]

    first = len(glass.uvs)
    add_sheet(glass, [bowed(3.96, 1.50), bowed(3.86, 1.925), bowed(3.765, 2.33)])
    glass.uvs[first:] = [(u, 0.5 + 0.5 * v) for u, v in glass.uvs[first:]]  # the windscreen of the texture
    add_sheet(trim, [bowed(3.97, 1.40), bowed(3.96, 1.50)])
    # Grille: thin slats in the paint's colour before dark openings, a frame below the windscreen, the maker's badge.
    add_end_sheet(trim, 3.988, 3.988, -0.72, 0.72, 0.66, 1.22, 1.0)
    for z in (0.70, 0.835, 0.97, 1.105):
        add_box(parts["paint"], (3.96, -0.70, z), (4.0, 0.70, z + 0.035))
    add_end_sheet(trim, 3.984, 3.984, -0.90, 0.90, 1.28, 1.298, 1.0)
    add_end_sheet(rim, 3.996, 3.996, -0.075, 0.075, 1.31, 1.38, 1.0)
    # Visor above the windscreen, and wipers.
    add_block(trim, ((2.36, 3.60, 3.86, 0.98), (2.42, 3.60, 3.92, 0.99), (2.46, 3.56, 3.84, 0.97)), 0.05, steps=2)
    for y in (-0.55, 0.25):
        add_tube(trim, [(3.985, y, 1.49), (3.915, y + 0.42, 1.80)], 0.012, 4)
    add_block(parts["paint"], (
        (0.34, 3.72, 3.96, 1.13), (0.38, 3.70, 4.0, 1.15), (0.58, 3.70, 4.0, 1.15), (0.64, 3.72, 3.97, 1.13),
    ), 0.10, steps=3)  # fmt: skip
    add_end_sheet(trim, 4.003, 4.003, -0.60, 0.60, 0.39, 0.56, 1.0)
    add_plate(parts["plate"], (4.006, 0.0, 0.475), 1.0)
    # Doors of the box: a seam and two bars.
    add_end_sheet(trim, -4.004, -4.004, -0.012, 0.012, 1.08, 3.24, -1.0)
    for y in (-0.70, -0.20, 0.20, 0.70):  # bars that lock them, in keepers, with a handle
        add_tube(rim, [(-4.035, y, 1.06), (-4.035, y, 3.26)], 0.022, 6)
        for z in (1.10, 1.75, 2.45, 3.14):
            add_box(rim, (-4.045, y - 0.05, z), (-4.0, y + 0.05, z + 0.07))
        inner = 0.30 if y < 0.0 else -0.30
        add_tube(rim, [(-4.05, y, 1.60), (-4.06, y + inner, 1.58)], 0.016, 5)
    for y in (-1.19, 1.19):
        for z in (1.3, 1.95, 2.6, 3.1):
            add_box(rim, (-4.03, y - 0.06, z), (-4.0, y + 0.06, z + 0.07))
    add_box(trim, (-3.98, -1.2, 0.42), (-3.88, 1.2, 0.54))
    for side in (1.0, -1.0):  # mud flaps
        y0, y1 = sorted((side * 0.68, side * 1.22))
        add_end_sheet(trim, -2.85, -2.85, y0, y1, 0.28, 0.98, -1.0)
    add_plate(parts["plate"], (-3.985, 0.0, 0.48), -1.0)


def lorry_proxies() -> list[Proxy]:
    cab, deflector = Mesh.empty(), Mesh.empty()
    add_block(cab, _CABIN, 0.14, bow_m=0.05, steps=1)
    add_block(deflector, _DEFLECTOR, 0.06, steps=1)
    return [
        Proxy("box", (3.0, _HALF, 1.14), (-1.0, 0.0, 2.16)),
        Proxy("hull", hull=cab),
        Proxy("hull", hull=deflector),
        Proxy("box", (3.55, 0.42, 0.20), (-0.3, 0.0, 0.82)),
        Proxy("box", (0.60, 0.265, 0.25), (0.40, 0.815, 0.70)),
        *axle_proxies(AXLES_M, WHEEL_M, _HALF - 0.04, 0.16),
    ]
