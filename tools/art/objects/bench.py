"""Meshes of a bench, 1.6 m wide: x along it, y to its front."""

from __future__ import annotations

from sim.scene.maps.meshes import Mesh
from sim.scene.maps.street_furniture import SEAT_M
from tools.art.vehicles.lofts import add_box, add_tube


def bench() -> dict[str, Mesh]:
    """Return the slats and the iron of a bench."""
    return {"slats": _bench_slats(), "iron": _bench_iron()}


def _bench_slats() -> Mesh:
    """Return four slats of the seat and three of the back, which leans by 0.17 rad."""
    mesh = Mesh.empty()
    for k in range(4):
        y = -0.19 + 0.125 * k
        add_box(mesh, (-0.8, y - 0.05, SEAT_M - 0.035), (0.8, y + 0.05, SEAT_M))
    for k in range(3):
        z = SEAT_M + 0.14 + 0.15 * k
        y = -0.235 - 0.172 * (z - SEAT_M - 0.14)
        add_box(mesh, (-0.8, y - 0.018, z - 0.055), (0.8, y + 0.018, z + 0.055))
    return mesh


def _bench_iron() -> Mesh:
    """Return both frames: legs, back post and arm rest."""
    mesh = Mesh.empty()
    for x in (-0.66, 0.66):
        add_tube(mesh, [(x, 0.20, 0.0), (x, 0.17, 0.24), (x, 0.19, SEAT_M - 0.05), (x, 0.20, SEAT_M + 0.20)], 0.024, 6)
        back = [(x, -0.27, 0.0), (x, -0.20, 0.24), (x, -0.21, SEAT_M - 0.05), (x, -0.30, SEAT_M + 0.50)]
        add_tube(mesh, back, 0.024, 6)
        add_tube(mesh, [(x, -0.21, SEAT_M - 0.05), (x, 0.19, SEAT_M - 0.05)], 0.022, 6)
        add_tube(mesh, [(x, -0.26, SEAT_M + 0.22), (x, 0.05, SEAT_M + 0.24), (x, 0.22, SEAT_M + 0.20)], 0.024, 6)
    return mesh
