"""Meshes of backpacks, parasols and pots."""

from __future__ import annotations

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, revolve
from tools.art.vehicles.blocks import add_block
from tools.art.vehicles.lofts import add_sheet, add_tube

_PANELS = 8
_CANOPY_M, _EDGE_M, _TOP_M = 1.35, 2.05, 2.55  # radius, height of the rim and of the tip


def backpack() -> dict[str, Mesh]:
    """Return a bag with a pocket in front, dark straps, base, side pockets and seams, and bright zips and a label."""
    bag, straps, zips = Mesh.empty(), Mesh.empty(), Mesh.empty()
    add_block(
        bag,
        (
            (0.05, -0.10, 0.10, 0.15), (0.12, -0.105, 0.105, 0.16), (0.32, -0.10, 0.095, 0.155),
            (0.42, -0.095, 0.07, 0.14), (0.475, -0.085, 0.03, 0.105), (0.50, -0.07, -0.02, 0.06),
        ),
        0.055,
    )  # fmt: skip
    add_block(
        bag,
        ((0.06, 0.05, 0.155, 0.105), (0.09, 0.05, 0.17, 0.12), (0.22, 0.05, 0.165, 0.12), (0.27, 0.05, 0.13, 0.095)),
        0.04,
    )
    add_block(straps, ((0.0, -0.095, 0.105, 0.14), (0.06, -0.105, 0.115, 0.158)), 0.055)
    add_block(straps, ((0.05, -0.06, 0.05, 0.17), (0.18, -0.065, 0.055, 0.18)), 0.03)
    for side in (1.0, -1.0):
        pad: list[Vec3] = [
            (-0.08, side * 0.05, 0.46), (-0.15, side * 0.08, 0.43), (-0.19, side * 0.11, 0.30),
            (-0.17, side * 0.14, 0.16), (-0.09, side * 0.15, 0.07),
        ]  # fmt: skip
        add_tube(straps, pad, (0.026, 0.034, 0.034, 0.022, 0.014), 6)
    seam: list[Vec3] = [
        (0.09, -0.155, 0.14), (0.085, -0.15, 0.32), (0.062, -0.135, 0.42), (0.022, -0.10, 0.475), (0.0, 0.0, 0.497),
        (0.022, 0.10, 0.475), (0.062, 0.135, 0.42), (0.085, 0.15, 0.32), (0.09, 0.155, 0.14),
    ]  # fmt: skip
    add_tube(straps, seam, 0.011, 4)
    pocket: list[Vec3] = [
        (0.155, -0.118, 0.10), (0.155, -0.116, 0.22), (0.13, -0.09, 0.268), (0.13, 0.09, 0.268), (0.155, 0.116, 0.22),
        (0.155, 0.118, 0.10),
    ]  # fmt: skip
    add_tube(straps, pocket, 0.009, 4)
    loop: list[Vec3] = [(-0.06, 0.05, 0.48), (-0.06, 0.04, 0.55), (-0.06, -0.04, 0.55), (-0.06, -0.05, 0.48)]
    add_tube(straps, loop, 0.015, 5)
    add_tube(zips, [(0.170, -0.09, 0.205), (0.170, 0.09, 0.205)], 0.005, 4)
    add_sheet(zips, [[(0.174, y, z) for y in (-0.035, 0.035)] for z in (0.13, 0.17)])
    return {"bag": bag, "straps": straps, "zips": zips}


def parasol() -> dict[str, Mesh]:
    """Return a parasol of 2.7 m across and 2.6 m high: panels of two colours, and ribs with the pole."""
    panels = [Mesh.empty(), Mesh.empty()]
    ribs = Mesh.empty()
    for k in range(_PANELS):
        _add_panel(panels[k % 2], k)
        angle = TURN_RAD * k / _PANELS
        c, s = det_cos(angle), det_sin(angle)
        add_tube(ribs, [(0.03 * c, 0.03 * s, 1.95), (0.66 * c, 0.66 * s, 2.26)], 0.009, 4)
    add_tube(ribs, [(0.0, 0.0, 0.0), (0.0, 0.0, _TOP_M + 0.06)], 0.022, 8)
    return {"panels": panels[0], "white": panels[1], "ribs": ribs}


def _add_panel(mesh: Mesh, k: int) -> None:
    """Add one gore of the canopy with its valance, seen from both sides."""
    rows = []
    for share, height in ((0.0, _TOP_M), (0.35, 2.46), (0.7, 2.28), (1.0, _EDGE_M), (1.0, _EDGE_M - 0.16)):
        row = []
        for j in range(5):
            angle = TURN_RAD * (k + j / 4) / _PANELS
            # Cloth between two ribs is straight and sags a little.
            chord = 1.0 - 0.045 * (1.0 - (j - 2) * (j - 2) / 4.0)
            dip = 0.05 * (1.0 - (j - 2) * (j - 2) / 4.0) if height < _EDGE_M else 0.0
            r = _CANOPY_M * max(share, 0.02) * chord
            row.append((r * det_cos(angle), r * det_sin(angle), height - dip))
        rows.append(row)
    outer = rows[::-1]
    add_sheet(mesh, outer)
    inner = [[(0.995 * x, 0.995 * y, z - 0.004) for x, y, z in row] for row in outer]
    add_sheet(mesh, inner, flipped=True)


def pot() -> dict[str, Mesh]:
    """Return a pot of fired clay."""
    profile = [(0.12, 0.0), (0.165, 0.27), (0.185, 0.27), (0.19, 0.33), (0.165, 0.335), (0.155, 0.30)]
    return {"pot": revolve(profile, 18)}
