"""Birds and dogs, standing still."""

from __future__ import annotations

from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps import surfaces
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.vehicles.lofts import add_ellipsoid, add_tube
from sim.scene.random_generator import RandomGenerator

_FURS = {"golden": (0.62, 0.42, 0.20), "black": (0.07, 0.06, 0.06), "brown": (0.33, 0.19, 0.10)}
_FEATHERS = {
    "pigeon": ((0.42, 0.44, 0.50), (0.16, 0.17, 0.20)),
    "gull": ((0.90, 0.90, 0.90), (0.50, 0.52, 0.55)),
    "crow": ((0.06, 0.06, 0.07), (0.04, 0.04, 0.05)),
}
_BIRD_SCALE = {"pigeon": 1.0, "gull": 1.35, "crow": 1.3}


def add_birds(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3) -> None:
    """Add a group of three birds around a place."""
    for _ in range(3):
        at = (at_m[0] + rng.between(-0.7, 0.7), at_m[1] + rng.between(-0.7, 0.7), at_m[2])
        add_bird(builder, rng, at, rng.between(0.0, TURN_RAD))


def add_bird(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, heading_rad: float) -> None:
    """Add a bird of 0.33 to 0.45 m that stands at `at_m`: pigeon, gull or crow."""
    kind = rng.pick(tuple(_FEATHERS))
    light, dark = _FEATHERS[kind]
    builder.material(f"plumage_{kind}", surfaces.CLOTH, rgb=light, specular=0.05)
    builder.material(f"wing_{kind}", surfaces.CLOTH, rgb=dark, specular=0.05)
    builder.material("bird_leg", surfaces.SKIN, rgb=(0.72, 0.35, 0.20))
    s = _BIRD_SCALE[kind]

    def scaled(points: list[Vec3]) -> list[Vec3]:
        return [(x * s, y * s, z * s) for x, y, z in points]

    body = builder.body("bird", at_m, yaw_quat(heading_rad))
    if not builder.has_mesh(f"bird_plumage_{kind}"):
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
                scaled(
                    [(0.055, y, 0.175), (-0.01, 1.15 * y, 0.155), (-0.09, 0.75 * y, 0.12), (-0.165, 0.3 * y, 0.105)]
                ),
                [r * s for r in (0.012, 0.030, 0.022, 0.006)],
                6,
            )
            add_tube(legs, scaled([(0.0, 0.45 * y, 0.10), (0.004, 0.5 * y, 0.012)]), 0.005 * s, 4)
            add_tube(legs, scaled([(-0.02, 0.5 * y, 0.006), (0.035, 0.5 * y, 0.006)]), 0.006 * s, 4)
            add_ellipsoid(
                wings, (0.118 * s, 0.42 * y * s, 0.264 * s), (0.006 * s, 0.005 * s, 0.006 * s), rings=4, sides=6
            )
        add_tube(wings, scaled([(-0.09, 0.0, 0.112), (-0.20, 0.0, 0.092)]), [0.028 * s, 0.022 * s], 6)
        add_tube(legs, scaled([(0.128, 0.0, 0.256), (0.165, 0.0, 0.248)]), [0.010 * s, 0.002], 5)
        for part, mesh in (("plumage", trunk), ("wings", wings), ("legs", legs)):
            builder.mesh(f"bird_{part}_{kind}", mesh)
    for part, material in (("plumage", f"plumage_{kind}"), ("wings", f"wing_{kind}"), ("legs", "bird_leg")):
        body.geom("mesh", asset=f"bird_{part}_{kind}", material=material, solid=False, part=part)
    body.proxy("sphere", (0.055 * s,), pos=(0.0, 0.0, 0.145 * s), material=f"plumage_{kind}", part="proxy")


def add_dog(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, heading_rad: float) -> None:
    """Add a dog that stands: 0.58 m at the shoulder, 0.95 m long without its tail."""
    coat = rng.pick(tuple(_FURS))
    builder.material(f"fur_{coat}", surfaces.CLOTH, rgb=_FURS[coat], specular=0.03)
    builder.material("dog_dark", surfaces.SKIN, rgb=(0.03, 0.03, 0.03), specular=0.2)
    builder.material("dog_collar", surfaces.CLOTH, rgb=(0.62, 0.06, 0.06))
    if not builder.has_mesh("dog_fur"):
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
        for part, mesh in (("fur", fur), ("dark", dark), ("collar", collar)):
            builder.mesh(f"dog_{part}", mesh)
    body = builder.body("dog", at_m, yaw_quat(heading_rad))
    for part, material in (("fur", f"fur_{coat}"), ("dark", "dog_dark"), ("collar", "dog_collar")):
        body.geom("mesh", asset=f"dog_{part}", material=material, solid=False, part=part)
    for i, (size, pos) in enumerate(
        (((0.34, 0.09, 0.09), (-0.04, 0.0, 0.46)), ((0.10, 0.06, 0.06), (0.46, 0.0, 0.72)))
    ):
        body.proxy("box", size, pos=pos, material="dog_dark", part=f"proxy_{i}")
