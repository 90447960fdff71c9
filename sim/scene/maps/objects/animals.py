"""Birds and dogs, standing still."""

from __future__ import annotations

from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.models import model
from sim.scene.maps.objects.dog_coat import COATS, EARS_UP
from sim.scene.random_generator import RandomGenerator

_FEATHERS = {
    "pigeon": ((0.42, 0.44, 0.50), (0.16, 0.17, 0.20)),
    "gull": ((0.90, 0.90, 0.90), (0.50, 0.52, 0.55)),
    "crow": ((0.06, 0.06, 0.07), (0.04, 0.04, 0.05)),
}
BIRD_SCALE = {"pigeon": 1.0, "gull": 1.35, "crow": 1.3}


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
    s = BIRD_SCALE[kind]

    body = builder.body("bird", at_m, yaw_quat(heading_rad))
    for part, material in (("plumage", f"plumage_{kind}"), ("wings", f"wing_{kind}"), ("legs", "bird_leg")):
        asset = builder.mesh(f"bird_{part}_{kind}", model(f"objects/bird_{kind}").mesh(part))
        body.geom("mesh", asset=asset, material=material, solid=False, part=part)
    body.proxy("sphere", (0.055 * s,), pos=(0.0, 0.0, 0.145 * s), material=f"plumage_{kind}", part="proxy")


def add_dog(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, heading_rad: float) -> None:
    """Add a dog in mid-step: 0.58 m at the shoulder, 0.95 m long without its tail."""
    coat = rng.pick(COATS)
    fur = builder.texture(f"fur_{coat}", textures.png(f"fur_{coat}"))
    builder.material(f"fur_{coat}", surfaces.CLOTH, texture=fur, specular=0.0)
    builder.material("dog_dark", surfaces.SKIN, rgb=(0.07, 0.06, 0.06), specular=0.2)
    builder.material("dog_tongue", surfaces.SKIN, rgb=(0.78, 0.36, 0.38), specular=0.1)
    builder.material("dog_collar", surfaces.CLOTH, rgb=(0.24, 0.12, 0.07))
    body = builder.body("dog", at_m, yaw_quat(heading_rad))
    ears = "ears_up" if coat in EARS_UP else "ears_down"
    for part, material in (
        ("fur", f"fur_{coat}"), (ears, f"fur_{coat}"), ("dark", "dog_dark"), ("tongue", "dog_tongue"),
        ("collar", "dog_collar"),
    ):  # fmt: skip
        asset = builder.mesh(f"dog_{part}", model("objects/dog").mesh(part))
        body.geom("mesh", asset=asset, material=material, solid=False, part=part)
    for i, (size, pos) in enumerate(
        (((0.34, 0.09, 0.09), (-0.04, 0.0, 0.46)), ((0.10, 0.06, 0.06), (0.46, 0.0, 0.72)))
    ):
        body.proxy("box", size, pos=pos, material="dog_dark", part=f"proxy_{i}")
