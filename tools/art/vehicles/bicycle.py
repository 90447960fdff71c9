"""City bicycle, 1.75 x 0.6 x 1.05 m: on its stand, or in the parts that move when somebody rides it."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.vehicles.bicycle_layout import (
    AXLES_M,
    CRANK_AXLE_M,
    CRANK_M,
    PEDAL_HALF_M,
    POST_ALONG,
    SADDLE_HALF_M,
    SADDLE_M,
    WHEEL_M,
)
from tools.art.vehicles.lofts import add_box, add_ellipsoid, add_lathe, add_torus, add_tube
from tools.art.vehicles.parts import MATERIALS, Parts, Proxy

_SPOKES = 14


def bicycle_parts() -> Parts:
    """Return a bicycle on its stand."""
    parts = _no_parts()
    for x in AXLES_M:
        _add_wheel(parts, x, WHEEL_M)
    _add_frame(parts, saddle=True)
    (x, z), trim = CRANK_AXLE_M, parts["trim"]
    for y, dx, dz in ((0.09, 0.12, -0.12), (-0.09, -0.12, 0.12)):
        add_tube(parts["rim"], [(x, y, z), (x + dx, y, z + dz)], 0.009, 4)
        _add_pedal(trim, x + dx, y, z + dz)
    add_tube(trim, [(-0.12, 0.04, 0.28), (-0.16, 0.16, 0.01)], 0.010, 4)
    return parts


def frame_parts() -> Parts:
    """Return what does not move on a ridden bicycle, but for the saddle."""
    parts = _no_parts()
    _add_frame(parts, saddle=False)
    return parts


def saddle_parts() -> Parts:
    """Return the saddle, and a post long enough to raise it, where they are on a parked bicycle."""
    parts = _no_parts()
    top = (SADDLE_M[0] + 0.03, SADDLE_M[1] - 0.035)
    _line(parts["rim"], [(top[0] - 2.2 * POST_ALONG[0], top[1] - 2.2 * POST_ALONG[1]), top], 0.013)
    _add_saddle(parts)
    return parts


def wheel_parts() -> Parts:
    """Return a wheel about the origin."""
    parts = _no_parts()
    _add_wheel(parts, 0.0, 0.0)
    return parts


def crank_parts() -> Parts:
    """Return both cranks about the origin, the left one along +x."""
    parts = _no_parts()
    add_tube(parts["rim"], [(0.0, 0.09, 0.0), (0.0, -0.09, 0.0)], 0.012, 6)
    for y, x in ((0.09, CRANK_M), (-0.09, -CRANK_M)):
        add_tube(parts["rim"], [(0.0, y, 0.0), (x, y, 0.0)], 0.009, 4)
    return parts


def pedal_parts(side: float) -> Parts:
    """Return a pedal; its frame's origin is on the middle plane of the bicycle. `side`: 1 left, -1 right."""
    parts = _no_parts()
    _add_pedal(parts["trim"], 0.0, side * 0.09, 0.0)
    return parts


def _no_parts() -> Parts:
    return {name: Mesh.empty() for name in MATERIALS}


def _add_wheel(parts: Parts, x: float, z: float) -> None:
    rim = parts["rim"]
    add_torus(parts["tyre"], (x, 0.0, z), WHEEL_M - 0.02, 0.020, 24, 6)
    add_torus(rim, (x, 0.0, z), WHEEL_M - 0.045, 0.010, 24, 4)
    add_lathe(rim, (x, 0.0, z), [(0.0, -0.04), (0.022, -0.035), (0.022, 0.035), (0.0, 0.04)], 8)
    for k in range(_SPOKES):
        angle = TURN_RAD * k / _SPOKES
        r = WHEEL_M - 0.045
        end = (x + r * det_cos(angle), 0.0, z + r * det_sin(angle))
        add_tube(rim, [(x, 0.02 if k % 2 else -0.02, z), end], 0.0025, 3)


def _add_frame(parts: Parts, *, saddle: bool) -> None:
    """Add frame, fork, seat post, mudguards, carrier, chain guard, saddle, handlebar with grips, and lamps."""
    paint, trim, rim = parts["paint"], parts["trim"], parts["rim"]
    front, rear = (AXLES_M[0], WHEEL_M), (AXLES_M[1], WHEEL_M)
    crank, seat_low, seat_top = CRANK_AXLE_M, (-0.20, 0.70), (-0.25, 0.86)
    head_low, head_top = (0.34, 0.68), (0.30, 0.82)
    _line(paint, [crank, seat_low], 0.017)
    _line(paint, [crank, head_low], 0.019)
    _line(paint, [(-0.185, 0.64), head_top], 0.017)
    _line(paint, [head_low, head_top], 0.021)
    if saddle:
        _line(rim, [seat_low, seat_top], 0.013)
    _line(rim, [head_top, (0.285, 0.94)], 0.013)
    for y in (0.055, -0.055):
        add_tube(paint, [(head_low[0], 0.6 * y, head_low[1]), (0.40, y, 0.58), (front[0], y, front[1])], 0.012, 5)
        add_tube(paint, [(crank[0], 0.5 * y, crank[1]), (rear[0], y, rear[1])], 0.009, 5)
        add_tube(paint, [(seat_low[0], 0.4 * y, seat_low[1] - 0.02), (rear[0], y, rear[1])], 0.008, 5)
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
    if saddle:
        _add_saddle(parts)
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


def _add_saddle(parts: Parts) -> None:
    x, z = SADDLE_M
    add_ellipsoid(parts["trim"], (x, 0.0, z), (0.13, 0.075, SADDLE_HALF_M), rings=5, sides=10)


def _add_pedal(trim: Mesh, x: float, y: float, z: float) -> None:
    """Add a pedal outside the end of a crank."""
    out = 0.08 if y > 0 else -0.08
    low, high = min(y, y + out), max(y, y + out)
    add_box(trim, (x - 0.04, low, z - PEDAL_HALF_M), (x + 0.04, high, z + PEDAL_HALF_M))


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
