"""Backpacks, parasols with tables, potted plants."""

from __future__ import annotations

from math import sqrt

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps import surfaces
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.meshes import Mesh, revolve
from sim.scene.maps.vehicles.blocks import add_block
from sim.scene.maps.vehicles.lofts import add_sheet, add_tube
from sim.scene.random_generator import RandomGenerator

_FABRICS = {
    "red": (0.75, 0.09, 0.08),
    "blue": (0.12, 0.32, 0.68),
    "green": (0.20, 0.45, 0.25),
    "grey": (0.32, 0.33, 0.36),
}
_CANOPIES = {
    "red": (0.70, 0.08, 0.07),
    "blue": (0.08, 0.24, 0.52),
    "orange": (0.88, 0.40, 0.06),
    "green": (0.08, 0.36, 0.20),
}
_PANELS = 8
_CANOPY_M, _EDGE_M, _TOP_M = 1.35, 2.05, 2.55  # radius, height of the rim and of the tip


def add_backpack(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, heading_rad: float) -> None:
    """Add a backpack of 0.50 m that stands on its base."""
    colour = rng.pick(tuple(_FABRICS))
    builder.material(f"fabric_{colour}", surfaces.CLOTH, rgb=_FABRICS[colour], specular=0.03)
    builder.material("fabric_dark", surfaces.CLOTH, rgb=(0.07, 0.07, 0.08), specular=0.03)
    builder.material("zip", surfaces.METAL, rgb=(0.6, 0.6, 0.6), specular=0.4)
    if not builder.has_mesh("backpack_bag"):
        bag, straps, zips = Mesh.empty(), Mesh.empty(), Mesh.empty()
        add_block(
            bag,
            (
                (0.0, -0.09, 0.09, 0.14),
                (0.05, -0.10, 0.11, 0.16),
                (0.30, -0.10, 0.10, 0.16),
                (0.42, -0.095, 0.07, 0.145),
                (0.48, -0.09, 0.02, 0.11),
                (0.50, -0.08, -0.02, 0.07),
            ),
            0.055,
        )
        add_block(
            bag,
            ((0.04, 0.06, 0.15, 0.11), (0.07, 0.06, 0.165, 0.125), (0.20, 0.06, 0.16, 0.125), (0.25, 0.06, 0.13, 0.10)),
            0.04,
        )
        for side in (1.0, -1.0):
            add_tube(
                straps,
                [
                    (-0.09, side * 0.07, 0.44),
                    (-0.17, side * 0.09, 0.40),
                    (-0.19, side * 0.10, 0.25),
                    (-0.10, side * 0.12, 0.06),
                ],
                0.022,
                5,
            )
            add_block(straps, ((0.04, -0.06, 0.06, 0.185), (0.16, -0.06, 0.06, 0.185)), 0.05)
        add_tube(
            straps, [(-0.07, 0.05, 0.48), (-0.07, 0.03, 0.54), (-0.07, -0.03, 0.54), (-0.07, -0.05, 0.48)], 0.012, 5
        )
        add_tube(zips, [(0.166, -0.10, 0.195), (0.166, 0.10, 0.195)], 0.006, 4)
        for part, mesh in (("bag", bag), ("straps", straps), ("zips", zips)):
            builder.mesh(f"backpack_{part}", mesh)
    body = builder.body("backpack", at_m, yaw_quat(heading_rad))
    for part, material in (("bag", f"fabric_{colour}"), ("straps", "fabric_dark"), ("zips", "zip")):
        body.geom("mesh", asset=f"backpack_{part}", material=material, solid=False, part=part)
    body.proxy("box", (0.09, 0.14, 0.22), pos=(0.0, 0.0, 0.23), material="fabric_dark", part="proxy")


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
    """Add a plant of 0.9 m with broad leaves, in a pot of fired clay."""
    builder.material("terracotta", surfaces.ROOF_TILE, rgb=(0.62, 0.30, 0.18), specular=0.05)
    builder.material("pot_soil", surfaces.SOIL, rgb=(0.12, 0.08, 0.05), specular=0.0)
    shade = rng.index(2)
    builder.material(
        f"pot_leaf_{shade}", surfaces.LEAVES, rgb=((0.26, 0.50, 0.18), (0.38, 0.60, 0.22))[shade], specular=0.15
    )
    if not builder.has_mesh("pot"):
        pot = revolve([(0.12, 0.0), (0.165, 0.27), (0.185, 0.27), (0.19, 0.33), (0.165, 0.335), (0.155, 0.30)], 18)
        builder.mesh("pot", pot)
        builder.mesh("pot_leaves", _leaves())
    body = builder.body("potted_plant", at_m, yaw_quat(rng.between(0.0, TURN_RAD)))
    body.geom("mesh", asset="pot", material="terracotta", solid=False, part="pot")
    body.geom("cylinder", (0.16, 0.01), pos=(0.0, 0.0, 0.305), material="pot_soil", solid=False, part="soil")
    body.geom("mesh", asset="pot_leaves", material=f"pot_leaf_{shade}", solid=False, part="leaves")
    body.proxy("cylinder", (0.15, 0.165), pos=(0.0, 0.0, 0.165), material="terracotta", part="proxy")


def _leaves() -> Mesh:
    """Return stems that bend outwards, each with one broad leaf."""
    mesh = Mesh.empty()
    count = 34
    for k in range(count):
        # The golden angle spreads the stems; inner ones stand more upright.
        angle = 2.399963229728653 * k
        lean = sqrt((k + 0.5) / count)
        c, s = det_cos(angle), det_sin(angle)
        length = 0.42 - 0.10 * lean
        base_z, reach, rise = 0.34, 0.10 + 0.30 * lean, length * (1.15 - 0.75 * lean)
        rows = []
        for j in range(6):
            t = j / 5
            r = reach * t * (0.6 + 0.4 * t)
            z = base_z + 0.12 * (1.0 - lean) + rise * (1.6 * t - 0.75 * t * t)
            half = 0.078 * (4.0 * t * (1.0 - t) * (0.55 + 0.45 * t) + 0.03)
            rows.append(
                [
                    (r * c - side * half * s, r * s + side * half * c, z - abs(side) * 0.3 * half)
                    for side in (-1.0, 0.0, 1.0)
                ]
            )
        add_sheet(mesh, rows)
        add_sheet(mesh, rows, flipped=True)
    return mesh
