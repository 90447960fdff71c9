"""City bicycle, 1.75 x 0.6 x 1.05 m, on its stand."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.vehicles.lofts import add_box, add_ellipsoid, add_lathe, add_torus, add_tube
from sim.scene.maps.vehicles.parts import MATERIALS, Parts, Proxy

LENGTH_M, WIDTH_M, HEIGHT_M = 1.75, 0.60, 1.05
WHEEL_M = 0.345
AXLES_M = (0.53, -0.53)
_SPOKES = 14


def bicycle_parts() -> Parts:
    parts = {name: Mesh.empty() for name in MATERIALS}
    paint, trim, rim = parts["paint"], parts["trim"], parts["rim"]
    for x in AXLES_M:
        add_torus(parts["tyre"], (x, 0.0, WHEEL_M), WHEEL_M - 0.02, 0.020, 24, 6)
        add_torus(rim, (x, 0.0, WHEEL_M), WHEEL_M - 0.045, 0.010, 24, 4)
        add_lathe(rim, (x, 0.0, WHEEL_M), [(0.0, -0.04), (0.022, -0.035), (0.022, 0.035), (0.0, 0.04)], 8)
        for k in range(_SPOKES):
            angle = TURN_RAD * k / _SPOKES
            r = WHEEL_M - 0.045
            end = (x + r * det_cos(angle), 0.0, WHEEL_M + r * det_sin(angle))
            add_tube(rim, [(x, 0.02 if k % 2 else -0.02, WHEEL_M), end], 0.0025, 3)
    front, rear = (AXLES_M[0], WHEEL_M), (AXLES_M[1], WHEEL_M)
    crank, seat_low, seat_top = (-0.08, 0.29), (-0.20, 0.70), (-0.25, 0.86)
    head_low, head_top = (0.34, 0.68), (0.30, 0.82)
    _line(paint, [crank, seat_low], 0.017)
    _line(paint, [crank, head_low], 0.019)
    _line(paint, [(-0.185, 0.64), head_top], 0.017)
    _line(paint, [head_low, head_top], 0.021)
    _line(rim, [seat_low, seat_top], 0.013)
    _line(rim, [head_top, (0.285, 0.94)], 0.013)
    for y in (0.055, -0.055):
        add_tube(paint, [(head_low[0], 0.6 * y, head_low[1]), (0.40, y, 0.58), (front[0], y, front[1])], 0.012, 5)
        add_tube(paint, [(crank[0], 0.5 * y, crank[1]), (rear[0], y, rear[1])], 0.009, 5)
        add_tube(paint, [(seat_low[0], 0.4 * y, seat_low[1] - 0.02), (rear[0], y, rear[1])], 0.008, 5)
    # Mudguards, carrier, chain guard, saddle, handlebar with grips, lamps, pedals, stand.
    for (x, _), first, last in ((front, 0.18, 1.05), (rear, -0.05, 1.02)):
        arc = [
            (x + (WHEEL_M + 0.02) * det_cos(a), 0.0, WHEEL_M + (WHEEL_M + 0.02) * det_sin(a))
            for a in (TURN_RAD / 2 * (first + (last - first) * k / 8) for k in range(9))
        ]
        add_tube(trim, arc, 0.018, 4)
    for y in (0.06, -0.06):
        add_tube(rim, [(-0.24, y, 0.72), (-0.72, y, 0.73)], 0.007, 4)
        add_tube(rim, [(-0.62, y, 0.73), (rear[0], y, rear[1])], 0.006, 4)
    add_tube(
        trim, [(crank[0], -0.04, crank[1]), (-0.30, -0.045, 0.315), (rear[0], -0.045, rear[1])], (0.07, 0.045, 0.03), 6
    )
    add_ellipsoid(trim, (-0.28, 0.0, 0.895), (0.13, 0.075, 0.035), rings=5, sides=10)
    bar = [
        (0.14, 0.29, 0.98),
        (0.24, 0.24, 1.0),
        (0.29, 0.08, 0.95),
        (0.29, -0.08, 0.95),
        (0.24, -0.24, 1.0),
        (0.14, -0.29, 0.98),
    ]
    add_tube(rim, bar, 0.012, 5)
    for y in (0.26, -0.26):
        add_tube(trim, [(0.12, 1.12 * y, 0.98), (0.22, 0.98 * y, 0.995)], 0.018, 6)
    add_ellipsoid(parts["head_lamp"], (0.40, 0.0, 0.80), (0.04, 0.04, 0.04), rings=4, sides=8)
    add_ellipsoid(parts["tail_lamp"], (-0.74, 0.0, 0.70), (0.02, 0.035, 0.03), rings=4, sides=8)
    for y, dx, dz in ((0.09, 0.12, -0.12), (-0.09, -0.12, 0.12)):
        add_tube(rim, [(crank[0], y, crank[1]), (crank[0] + dx, y, crank[1] + dz)], 0.009, 4)
        out = 0.08 if y > 0 else -0.08
        add_box(
            trim, (crank[0] + dx - 0.04, min(y, y + out), crank[1] + dz - 0.012),
            (crank[0] + dx + 0.04, max(y, y + out), crank[1] + dz + 0.012),
        )  # fmt: skip
    add_tube(trim, [(-0.12, 0.04, 0.28), (-0.16, 0.16, 0.01)], 0.010, 4)
    return parts


def _line(mesh: Mesh, points: Sequence[tuple[float, float]], radius_m: float) -> None:
    line: list[Vec3] = [(x, 0.0, z) for x, z in points]
    add_tube(mesh, line, radius_m, 6)


def bicycle_proxies() -> list[Proxy]:
    half = 0.5 * (WHEEL_M - 0.01) * sqrt(2.0)  # of the square within a wheel
    return [
        *(Proxy("box", (half, 0.025, half), (x, 0.0, WHEEL_M)) for x in AXLES_M),
        Proxy("box", (0.28, 0.03, 0.22), (0.02, 0.0, 0.62)),
        Proxy("box", (0.10, 0.28, 0.03), (0.22, 0.0, 0.97)),
        Proxy("box", (0.12, 0.06, 0.04), (-0.28, 0.0, 0.88)),
    ]
