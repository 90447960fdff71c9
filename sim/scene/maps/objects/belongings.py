"""Backpacks, parasols with tables, potted plants."""

from __future__ import annotations

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps import surfaces
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.meshes import Mesh, revolve
from sim.scene.maps.plants.trees import add_bough
from sim.scene.maps.vehicles.blocks import add_block
from sim.scene.maps.vehicles.lofts import add_sheet, add_tube
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
_PANELS = 8
_PLANT_M = 0.35  # radius of a potted shrub
_CANOPY_M, _EDGE_M, _TOP_M = 1.35, 2.05, 2.55  # radius, height of the rim and of the tip


def add_backpack(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, heading_rad: float) -> None:
    """Add a backpack of 0.50 m that stands on its base."""
    colour = rng.pick(tuple(_FABRICS))
    builder.material(f"fabric_{colour}", surfaces.CLOTH, rgb=_FABRICS[colour], specular=0.03)
    builder.material("fabric_dark", surfaces.CLOTH, rgb=(0.07, 0.07, 0.08), specular=0.03)
    builder.material("zip", surfaces.METAL, rgb=(0.6, 0.6, 0.6), specular=0.4)
    if not builder.has_mesh("backpack_bag"):
        for part, mesh in _backpack().items():
            builder.mesh(f"backpack_{part}", mesh)
    body = builder.body("backpack", at_m, yaw_quat(heading_rad))
    for part, material in (("bag", f"fabric_{colour}"), ("straps", "fabric_dark"), ("zips", "zip")):
        body.geom("mesh", asset=f"backpack_{part}", material=material, solid=False, part=part)
    body.proxy("box", (0.09, 0.14, 0.22), pos=(0.0, 0.0, 0.23), material="fabric_dark", part="proxy")


def _backpack() -> dict[str, Mesh]:
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


def add_parasol(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3) -> None:
    """Add a parasol of 2.7 m across and 2.6 m high, in panels of two colours."""
    colour = rng.pick(tuple(_CANOPIES))
    builder.material(f"canopy_{colour}", surfaces.CLOTH, rgb=_CANOPIES[colour], specular=0.02)
    builder.material("canopy_white", surfaces.CLOTH, rgb=(0.90, 0.88, 0.82), specular=0.02)
    builder.material("parasol_pole", surfaces.WOOD, rgb=(0.50, 0.34, 0.20), specular=0.1)
    builder.material("parasol_foot", surfaces.CONCRETE, rgb=(0.35, 0.35, 0.35))
    if not builder.has_mesh("canopy_0"):
        panels = [Mesh.empty(), Mesh.empty()]
        ribs = Mesh.empty()
        for k in range(_PANELS):
            _add_panel(panels[k % 2], k)
            angle = TURN_RAD * k / _PANELS
            c, s = det_cos(angle), det_sin(angle)
            add_tube(ribs, [(0.03 * c, 0.03 * s, 1.95), (0.66 * c, 0.66 * s, 2.26)], 0.009, 4)
        add_tube(ribs, [(0.0, 0.0, 0.0), (0.0, 0.0, _TOP_M + 0.06)], 0.022, 8)
        for i, mesh in enumerate(panels):
            builder.mesh(f"canopy_{i}", mesh)
        builder.mesh("parasol_ribs", ribs)
    body = builder.body("umbrella", at_m)
    body.geom("mesh", asset="canopy_0", material=f"canopy_{colour}", solid=False, part="panels")
    body.geom("mesh", asset="canopy_1", material="canopy_white", solid=False, part="white")
    body.geom("mesh", asset="parasol_ribs", material="parasol_pole", solid=False, part="ribs")
    body.geom("cylinder", (0.26, 0.05), pos=(0.0, 0.0, 0.05), material="parasol_foot", part="foot")
    body.proxy("cylinder", (0.022, 1.28), pos=(0.0, 0.0, 1.28), material="parasol_pole", part="proxy")
    for i, (radius, low, high) in enumerate(((1.25, 2.0, 2.14), (0.80, 2.14, 2.36), (0.35, 2.36, 2.52))):
        body.proxy(
            "cylinder", (radius, 0.5 * (high - low)), pos=(0.0, 0.0, 0.5 * (low + high)), material="parasol_pole",
            part=f"proxy_{i}",
        )  # fmt: skip


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


def add_potted_plant(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3) -> None:
    """Add a shrub in a pot of fired clay, 0.9 m high."""
    builder.material("terracotta", surfaces.ROOF_TILE, rgb=(0.62, 0.30, 0.18), specular=0.05)
    variant = rng.index(2)
    if not builder.has_mesh("pot"):
        pot = revolve([(0.12, 0.0), (0.165, 0.27), (0.185, 0.27), (0.19, 0.33), (0.165, 0.335), (0.155, 0.30)], 18)
        builder.mesh("pot", pot)
    body = builder.body("potted_plant", at_m, yaw_quat(rng.between(0.0, TURN_RAD)))
    body.geom("mesh", asset="pot", material="terracotta", solid=False, part="pot")
    add_bough(builder, body, "shrub", "bush", (variant, _PLANT_M, 0.0), (0.0, 0.0, 0.60), 0, step_m=0.1)
    body.proxy("cylinder", (0.15, 0.165), pos=(0.0, 0.0, 0.165), material="terracotta", part="proxy")
