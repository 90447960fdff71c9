"""Meshes of traffic lights and stop signs."""

from __future__ import annotations

from signals._kernel import det_cos, det_sin
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.objects.street_signs import HEAD_M
from tools.art.vehicles.lofts import add_box, add_indexed_grid, add_sheet, add_vertex


def signal() -> dict[str, Mesh]:
    """Return the head of a traffic light and the board behind it."""
    head, board = Mesh.empty(), Mesh.empty()
    z = HEAD_M
    add_box(board, (0.02, -0.27, z - 0.09), (0.04, 0.27, z + 1.02))
    add_box(head, (0.0, -0.24, z - 0.06), (0.05, 0.24, z + 0.99))
    add_box(head, (0.04, -0.16, z), (0.20, 0.16, z + 0.93))
    for k in range(3):
        _add_visor(head, 0.20, z + 0.155 + 0.31 * k)
    return {"head": head, "board": board}


def _add_visor(mesh: Mesh, x: float, z: float) -> None:
    """Add the hood over a lens: three quarters of a short tube."""
    rows = []
    for out, deep in ((0.0, 0.0), (0.17, 0.0)):
        row = []
        for k in range(10):
            angle = TURN_RAD * (-0.11 + 0.72 * k / 9)
            r = 0.118 - deep
            row.append((x + out, r * det_cos(angle), z + r * det_sin(angle)))
        rows.append(row)
    add_sheet(mesh, rows)
    add_sheet(mesh, rows, flipped=True)


def stop_sign() -> dict[str, Mesh]:
    """Return face and back of a stop sign."""
    face, back = Mesh.empty(), Mesh.empty()
    corners = []
    for k in range(8):
        angle = TURN_RAD * (k + 0.5) / 8
        corners.append((0.405 * det_cos(angle), 0.405 * det_sin(angle)))
    face.add_polygon(
        [(0.0, a, 2.25 + b) for a, b in corners], [(0.5 + 0.5 * a / 0.375, 0.5 + 0.5 * b / 0.375) for a, b in corners]
    )
    rows = [[add_vertex(back, (x_m, a, 2.25 + b)) for a, b in reversed(corners)] for x_m in (0.0, -0.012)]
    back.add_polygon([(-0.012, a, 2.25 + b) for a, b in reversed(corners)], [(0.0, 0.0)] * 8)
    add_indexed_grid(back, rows, closed=True)
    return {"face": face, "back": back}
