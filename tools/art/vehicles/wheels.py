"""Wheels: a tyre and a rim with spokes, revolved about y."""

from __future__ import annotations

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh
from tools.art.vehicles.lofts import add_indexed_grid, add_lathe, add_vertex

_SIDES = 18


def add_wheel(
    tyre: Mesh, rim: Mesh, centre: Vec3, radius_m: float, width_m: float, spokes: int, outward: float
) -> None:
    """Add a wheel whose outer face looks along `outward` y; `centre` is the middle of the outer face."""
    r = radius_m
    w = width_m
    tyre_profile = [
        (0.0, -w), (0.95 * r, -0.97 * w), (r, -0.75 * w), (r, -0.22 * w), (0.90 * r, 0.0), (0.69 * r, -0.004),
        (0.66 * r, -0.05), (0.0, -0.055),
    ]  # fmt: skip
    add_lathe(tyre, centre, tyre_profile, _SIDES, outward=outward)
    add_lathe(rim, centre, [(0.60 * r, -0.03), (0.62 * r, 0.0), (0.695 * r, 0.002)], _SIDES, outward=outward)
    add_lathe(rim, centre, [(0.20 * r, -0.03), (0.0, -0.002)], 8, outward=outward)
    for k in range(spokes):
        angle = TURN_RAD * k / spokes + 0.3
        _add_spoke(rim, centre, r, angle, 0.55 * TURN_RAD / 2 / spokes, outward)


def add_steel_wheel(
    tyre: Mesh, rim: Mesh, trim: Mesh, centre: Vec3, radius_m: float, width_m: float, outward: float
) -> None:
    """Add a lorry's wheel: a dished steel disc with a dark ring of hand holes and nuts round the hub."""
    r, w = radius_m, width_m
    tyre_profile = [
        (0.0, -w), (0.96 * r, -0.98 * w), (r, -0.80 * w), (r, -0.10 * w), (0.95 * r, 0.0), (0.68 * r, -0.01),
        (0.62 * r, -0.07), (0.0, -0.075),
    ]  # fmt: skip
    add_lathe(tyre, centre, tyre_profile, _SIDES, outward=outward)
    disc = [(0.64 * r, -0.005), (0.60 * r, -0.01), (0.55 * r, -0.062), (0.36 * r, -0.05), (0.31 * r, -0.02)]
    add_lathe(rim, centre, [*disc, (0.20 * r, -0.012), (0.17 * r, 0.02), (0.0, 0.024)], _SIDES, outward=outward)
    add_lathe(trim, centre, [(0.52 * r, -0.054), (0.41 * r, -0.046)], _SIDES, outward=outward)
    add_lathe(trim, centre, [(0.285 * r, -0.012), (0.235 * r, -0.009)], _SIDES, outward=outward)


def _add_spoke(rim: Mesh, centre: Vec3, r: float, angle_rad: float, half_rad: float, outward: float) -> None:
    rows = []
    for radius, share, y in ((0.12, 1.7, -0.012), (0.62, 0.80, -0.006)):
        row = []
        for turn, deep in ((-share, -0.03), (-0.8 * share, 0.0), (0.8 * share, 0.0), (share, -0.03)):
            a = angle_rad + turn * half_rad * (0.36 / radius if radius > 0.36 else 1.0)
            p = (
                centre[0] + radius * r * det_cos(a),
                centre[1] + outward * (y + deep),
                centre[2] + radius * r * det_sin(a),
            )
            row.append(add_vertex(rim, p))
        rows.append(row if outward < 0.0 else row[::-1])
    add_indexed_grid(rim, rows)
