"""Meshes of birds, standing still."""

from __future__ import annotations

from signals.samples import Vec3
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.objects.animals import BIRD_SCALE
from tools.art.vehicles.lofts import add_ellipsoid, add_tube


def bird(kind: str) -> dict[str, Mesh]:
    """Return a bird of 0.33 to 0.45 m; `kind`: of BIRD_SCALE."""
    s = BIRD_SCALE[kind]

    def scaled(points: list[Vec3]) -> list[Vec3]:
        return [(x * s, y * s, z * s) for x, y, z in points]

    trunk, wings, legs = Mesh.empty(), Mesh.empty(), Mesh.empty()
    # Trunk from the tail to the breast, neck and head.
    spine = scaled(
        [(-0.115, 0.0, 0.105), (-0.06, 0.0, 0.125), (0.0, 0.0, 0.145), (0.06, 0.0, 0.165), (0.09, 0.0, 0.195)]
    )
    add_tube(trunk, spine, [r * s for r in (0.02, 0.048, 0.064, 0.058, 0.034)], 10)
    add_tube(
        trunk,
        scaled([(0.07, 0.0, 0.18), (0.095, 0.0, 0.225), (0.10, 0.0, 0.245)]),
        [r * s for r in (0.042, 0.028, 0.026)],
        8,
    )
    add_ellipsoid(trunk, (0.105 * s, 0.0, 0.258 * s), (0.034 * s, 0.027 * s, 0.028 * s), rings=6, sides=8)
    for y in (0.048, -0.048):
        add_tube(
            wings,
            scaled([(0.055, y, 0.175), (-0.01, 1.15 * y, 0.155), (-0.09, 0.75 * y, 0.12), (-0.165, 0.3 * y, 0.105)]),
            [r * s for r in (0.012, 0.030, 0.022, 0.006)],
            6,
        )
        add_tube(legs, scaled([(0.0, 0.45 * y, 0.10), (0.004, 0.5 * y, 0.012)]), 0.005 * s, 4)
        add_tube(legs, scaled([(-0.02, 0.5 * y, 0.006), (0.035, 0.5 * y, 0.006)]), 0.006 * s, 4)
        add_ellipsoid(wings, (0.118 * s, 0.42 * y * s, 0.264 * s), (0.006 * s, 0.005 * s, 0.006 * s), rings=4, sides=6)
    add_tube(wings, scaled([(-0.09, 0.0, 0.112), (-0.20, 0.0, 0.092)]), [0.028 * s, 0.022 * s], 6)
    add_tube(legs, scaled([(0.128, 0.0, 0.256), (0.165, 0.0, 0.248)]), [0.010 * s, 0.002], 5)
    return {"plumage": trunk, "wings": wings, "legs": legs}
