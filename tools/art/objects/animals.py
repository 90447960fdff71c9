"""Meshes of birds and dogs, standing still."""

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


def dog() -> dict[str, Mesh]:
    """Return a dog of 0.58 m at the shoulder, 0.95 m long without its tail."""
    fur, dark, collar = Mesh.empty(), Mesh.empty(), Mesh.empty()
    spine: list[Vec3] = [
        (-0.40, 0.0, 0.47),
        (-0.33, 0.0, 0.47),
        (-0.15, 0.0, 0.465),
        (0.05, 0.0, 0.45),
        (0.22, 0.0, 0.45),
        (0.31, 0.0, 0.48),
    ]
    add_tube(fur, spine, (0.06, 0.105, 0.105, 0.13, 0.14, 0.08), 12)
    add_tube(fur, [(0.24, 0.0, 0.50), (0.34, 0.0, 0.62), (0.40, 0.0, 0.70)], (0.11, 0.085, 0.08), 10)
    add_ellipsoid(fur, (0.43, 0.0, 0.735), (0.105, 0.085, 0.085), rings=8, sides=12)
    add_tube(fur, [(0.46, 0.0, 0.725), (0.56, 0.0, 0.700), (0.60, 0.0, 0.695)], (0.068, 0.047, 0.040), 8)
    for side in (1.0, -1.0):
        add_tube(
            fur,
            [(0.40, side * 0.065, 0.79), (0.405, side * 0.105, 0.74), (0.42, side * 0.11, 0.66)],
            (0.018, 0.034, 0.018),
            6,
        )
        add_ellipsoid(dark, (0.505, side * 0.042, 0.765), (0.012, 0.012, 0.013), rings=4, sides=6)
        front: list[Vec3] = [
            (0.20, side * 0.09, 0.42),
            (0.19, side * 0.095, 0.22),
            (0.20, side * 0.095, 0.06),
            (0.21, side * 0.095, 0.02),
        ]
        add_tube(fur, front, (0.07, 0.036, 0.028, 0.032), 7)
        rear: list[Vec3] = [
            (-0.32, side * 0.085, 0.42),
            (-0.29, side * 0.10, 0.27),
            (-0.39, side * 0.10, 0.15),
            (-0.36, side * 0.10, 0.02),
        ]
        add_tube(fur, rear, (0.095, 0.055, 0.030, 0.030), 7)
        for x in (0.24, -0.33):
            add_ellipsoid(fur, (x, side * 0.098, 0.022), (0.05, 0.034, 0.024), rings=4, sides=8)
    tail: list[Vec3] = [(-0.39, 0.0, 0.51), (-0.52, 0.0, 0.56), (-0.62, 0.0, 0.66), (-0.66, 0.0, 0.76)]
    add_tube(fur, tail, (0.04, 0.033, 0.027, 0.012), 6)
    add_ellipsoid(dark, (0.625, 0.0, 0.712), (0.02, 0.022, 0.017), rings=4, sides=6)
    add_tube(collar, [(0.318, 0.0, 0.615), (0.342, 0.0, 0.635)], 0.094, 10)
    return {"fur": fur, "dark": dark, "collar": collar}
