"""Motorcycle, 2.1 x 0.8 x 1.15 m, on its stand."""

from __future__ import annotations

from sim.scene.maps.meshes import Mesh
from tools.art.vehicles.blocks import add_block
from tools.art.vehicles.lofts import add_box, add_ellipsoid, add_torus, add_tube
from tools.art.vehicles.parts import MATERIALS, Parts, Proxy
from tools.art.vehicles.wheels import add_wheel

LENGTH_M, WIDTH_M, HEIGHT_M = 2.1, 0.80, 1.15
WHEEL_M = 0.315
AXLES_M = (0.72, -0.70)


def motorcycle_parts() -> Parts:
    parts = {name: Mesh.empty() for name in MATERIALS}
    paint, trim, rim = parts["paint"], parts["trim"], parts["rim"]
    for x, width in zip(AXLES_M, (0.12, 0.16), strict=True):
        add_torus(parts["tyre"], (x, 0.0, WHEEL_M), WHEEL_M - 0.5 * width * 0.62, 0.5 * width * 0.62, 24, 8)
        for side in (1.0, -1.0):
            add_wheel(Mesh.empty(), rim, (x, side * 0.035, WHEEL_M), 0.90 * WHEEL_M, 0.07, 6, side)
            add_torus(rim, (x, side * 0.055, WHEEL_M), 0.13, 0.008, 16, 4)  # brake disc
    # Engine, frame, exhaust.
    add_block(trim, ((0.18, -0.22, 0.36, 0.15), (0.40, -0.26, 0.38, 0.17), (0.56, -0.18, 0.30, 0.14)), 0.05)
    add_ellipsoid(rim, (0.04, 0.16, 0.33), (0.13, 0.05, 0.12), rings=5, sides=10)
    add_ellipsoid(rim, (0.04, -0.16, 0.33), (0.13, 0.05, 0.12), rings=5, sides=10)
    for z in (0.46, 0.50, 0.54):
        add_box(rim, (0.06, -0.17, z), (0.30, 0.17, z + 0.015))
    add_tube(trim, [(0.50, 0.0, 0.88), (0.38, 0.0, 0.62), (0.30, 0.0, 0.22), (-0.25, 0.0, 0.20)], 0.028, 6)
    for y in (0.10, -0.10):
        add_tube(trim, [(-0.18, y, 0.36), (-0.45, y, 0.34), (AXLES_M[1], y, WHEEL_M)], 0.028, 6)
        add_tube(rim, [(0.48, y, 0.95), (0.60, y, 0.62), (AXLES_M[0], y, WHEEL_M)], (0.026, 0.026, 0.03), 8)
        add_tube(rim, [(-0.42, y, 0.70), (-0.60, y, 0.36)], 0.028, 6)
    add_tube(
        rim,
        [(0.34, -0.12, 0.48), (0.36, -0.16, 0.24), (0.0, -0.17, 0.20), (-0.40, -0.17, 0.26), (-0.88, -0.18, 0.38)],
        (0.024, 0.024, 0.03, 0.055, 0.055),
        8,
    )
    # Tank, seat, tail, mudguards.
    add_ellipsoid(paint, (0.20, 0.0, 0.80), (0.29, 0.155, 0.135), rings=8, sides=14)
    add_block(trim, ((0.68, -0.55, 0.02, 0.12), (0.77, -0.62, 0.02, 0.14), (0.80, -0.58, -0.02, 0.11)), 0.06)
    add_block(paint, ((0.60, -0.86, -0.30, 0.09), (0.72, -0.92, -0.28, 0.11), (0.80, -0.90, -0.52, 0.08)), 0.05)
    add_block(paint, ((0.54, -0.30, 0.0, 0.13), (0.70, -0.30, 0.06, 0.13)), 0.04)
    add_block(paint, ((0.60, 0.50, 0.95, 0.065), (0.66, 0.55, 0.90, 0.07), (0.69, 0.62, 0.82, 0.04)), 0.03)
    add_tube(trim, [(-0.80, 0.0, 0.62), (-0.96, 0.0, 0.42)], 0.05, 5)
    add_ellipsoid(parts["tail_lamp"], (-0.91, 0.0, 0.72), (0.03, 0.09, 0.035), rings=4, sides=8)
    add_box(parts["plate"], (-0.985, -0.09, 0.42), (-0.975, 0.09, 0.54))
    # Head lamp, instruments, handlebar, mirrors, indicators.
    add_ellipsoid(paint, (0.60, 0.0, 0.92), (0.10, 0.115, 0.115), rings=6, sides=12)
    add_ellipsoid(parts["head_lamp"], (0.655, 0.0, 0.92), (0.06, 0.09, 0.09), rings=6, sides=12)
    add_box(trim, (0.50, -0.09, 1.00), (0.54, 0.09, 1.06))
    bar = [
        (0.34, 0.38, 1.02),
        (0.42, 0.26, 1.05),
        (0.48, 0.08, 1.0),
        (0.48, -0.08, 1.0),
        (0.42, -0.26, 1.05),
        (0.34, -0.38, 1.02),
    ]
    add_tube(trim, bar, 0.015, 6)
    for side in (1.0, -1.0):
        add_tube(trim, [(0.33, side * 0.39, 1.015), (0.40, side * 0.28, 1.045)], 0.022, 6)
        add_tube(trim, [(0.42, side * 0.25, 1.05), (0.44, side * 0.33, 1.13)], 0.007, 4)
        add_ellipsoid(trim, (0.44, side * 0.34, 1.12), (0.015, 0.06, 0.03), rings=4, sides=8)
        add_ellipsoid(parts["lit"], (0.56, side * 0.19, 0.88), (0.03, 0.025, 0.022), rings=4, sides=6)
        add_tube(trim, [(-0.10, side * 0.14, 0.34), (-0.10, side * 0.28, 0.33)], 0.016, 5)
    add_tube(trim, [(-0.05, 0.12, 0.24), (-0.12, 0.30, 0.01)], 0.014, 5)
    return parts


def motorcycle_proxies() -> list[Proxy]:
    return [
        *(Proxy("box", (0.20, 0.05, 0.22), (x, 0.0, WHEEL_M)) for x in AXLES_M),
        Proxy("box", (0.26, 0.14, 0.20), (0.06, 0.0, 0.38)),
        Proxy("box", (0.20, 0.12, 0.09), (0.22, 0.0, 0.80)),
        Proxy("box", (0.40, 0.09, 0.08), (-0.42, 0.0, 0.70)),
        Proxy("box", (0.06, 0.36, 0.03), (0.42, 0.0, 1.03)),
        Proxy("box", (0.12, 0.10, 0.16), (0.56, 0.0, 0.80)),
    ]
