"""Backpacks, parasols with tables, potted plants."""

from __future__ import annotations

from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene import surfaces
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.models import model
from sim.scene.maps.plants.trees import add_bough
from sim.scene.random_generator import RandomGenerator

_FABRICS = {
    "red": (0.50, 0.09, 0.09),
    "blue": (0.12, 0.19, 0.36),
    "black": (0.13, 0.13, 0.14),
    "grey": (0.32, 0.33, 0.36),
}
_CANOPIES = {
    "red": (0.70, 0.08, 0.07),
    "blue": (0.08, 0.24, 0.52),
    "orange": (0.88, 0.40, 0.06),
    "green": (0.08, 0.36, 0.20),
}
_PLANT_M = 0.35  # radius of a potted shrub


def add_backpack(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, heading_rad: float) -> None:
    """Add a backpack of 0.50 m that stands on its base."""
    colour = rng.pick(tuple(_FABRICS))
    builder.material(f"fabric_{colour}", surfaces.CLOTH, rgb=_FABRICS[colour], specular=0.03)
    builder.material("fabric_dark", surfaces.CLOTH, rgb=(0.07, 0.07, 0.08), specular=0.03)
    builder.material("zip", surfaces.METAL, rgb=(0.6, 0.6, 0.6), specular=0.4)
    body = builder.body("backpack", at_m, yaw_quat(heading_rad))
    for part, material in (("bag", f"fabric_{colour}"), ("straps", "fabric_dark"), ("zips", "zip")):
        asset = builder.mesh(f"backpack_{part}", model("objects/backpack").mesh(part))
        body.geom("mesh", asset=asset, material=material, solid=False, part=part)
    body.proxy("box", (0.09, 0.14, 0.22), pos=(0.0, 0.0, 0.23), material="fabric_dark", part="proxy")


def add_parasol(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3) -> None:
    """Add a parasol of 2.7 m across and 2.6 m high, in panels of two colours."""
    colour = rng.pick(tuple(_CANOPIES))
    builder.material(f"canopy_{colour}", surfaces.CLOTH, rgb=_CANOPIES[colour], specular=0.02)
    builder.material("canopy_white", surfaces.CLOTH, rgb=(0.90, 0.88, 0.82), specular=0.02)
    builder.material("parasol_pole", surfaces.WOOD, rgb=(0.50, 0.34, 0.20), specular=0.1)
    builder.material("parasol_foot", surfaces.CONCRETE, rgb=(0.35, 0.35, 0.35))
    body = builder.body("umbrella", at_m)
    for piece, asset, material in (
        ("panels", "canopy_0", f"canopy_{colour}"), ("white", "canopy_1", "canopy_white"),
        ("ribs", "parasol_ribs", "parasol_pole"),
    ):  # fmt: skip
        mesh = builder.mesh(asset, model("objects/parasol").mesh(piece))
        body.geom("mesh", asset=mesh, material=material, solid=False, part=piece)
    body.geom("cylinder", (0.26, 0.05), pos=(0.0, 0.0, 0.05), material="parasol_foot", part="foot")
    body.proxy("cylinder", (0.022, 1.28), pos=(0.0, 0.0, 1.28), material="parasol_pole", part="proxy")
    for i, (radius, low, high) in enumerate(((1.25, 2.0, 2.14), (0.80, 2.14, 2.36), (0.35, 2.36, 2.52))):
        body.proxy(
            "cylinder", (radius, 0.5 * (high - low)), pos=(0.0, 0.0, 0.5 * (low + high)), material="parasol_pole",
            part=f"proxy_{i}",
        )  # fmt: skip


def add_potted_plant(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3) -> None:
    """Add a shrub in a pot of fired clay, 0.9 m high."""
    builder.material("terracotta", surfaces.ROOF_TILE, rgb=(0.62, 0.30, 0.18), specular=0.05)
    variant = rng.index(2)
    body = builder.body("potted_plant", at_m, yaw_quat(rng.between(0.0, TURN_RAD)))
    pot = builder.mesh("pot", model("objects/pot").mesh("pot"))
    body.geom("mesh", asset=pot, material="terracotta", solid=False, part="pot")
    add_bough(builder, body, "shrub", "bush", (variant, _PLANT_M, 0.0), (0.0, 0.0, 0.60), 0, step_m=0.1)
    body.proxy("cylinder", (0.15, 0.165), pos=(0.0, 0.0, 0.165), material="terracotta", part="proxy")
