"""Trees, bushes and hedges.

A crown is a few ellipsoids, or one lumpy mesh of a small set that all trees share. Trunk and crown are solid: a vehicle
cannot fly through a crown.
"""

from __future__ import annotations

from signals.units import TURN_RAD
from sim.scene.maps import surfaces, textures
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.meshes import blob, revolve
from sim.scene.random_generator import RandomGenerator

_LEAF_RGB = {
    "linden": (0.42, 0.60, 0.22), "oak": (0.30, 0.47, 0.17), "birch": (0.58, 0.68, 0.30), "fir": (0.19, 0.36, 0.21),
    "maple": (0.74, 0.50, 0.20),
}  # fmt: skip
_CROWN_SHAPES = 4


def plant_materials(builder: MapBuilder) -> None:
    """Add bark and leaves: a cube texture for ellipsoids, a flat texture for meshes."""
    builder.texture("bark", textures.png("bark"), cube=True)
    builder.texture("leaves_cube", textures.png("leaves"), cube=True)
    builder.texture("leaves", textures.png("leaves"))
    builder.material("bark", surfaces.BARK, texture="bark", specular=0.0)
    builder.material("bark_birch", surfaces.BARK, rgb=(0.86, 0.85, 0.80), specular=0.0)
    for name, rgb in _LEAF_RGB.items():
        builder.material(f"leaves_{name}", surfaces.LEAVES, rgb=rgb, texture="leaves_cube", specular=0.0)
        builder.material(f"crown_{name}", surfaces.LEAVES, rgb=rgb, texture="leaves", specular=0.0)


def _crown_mesh(builder: MapBuilder, shape: int, radius_m: float) -> str:
    """Add one of the shared lumpy crowns, in half-metre steps of radius; return its name."""
    steps = max(2, round(radius_m / 0.5))
    name = f"crown_{shape}_{steps}"
    if not builder.has_mesh(name):
        rng = RandomGenerator(shape, "crown")
        lumps = [[rng.between(0.80, 1.16) for _ in range(18)] for _ in range(11)]
        mesh = blob(lambda ring, side: lumps[ring][side], rings=11, sides=18)
        scale = 0.5 * steps
        mesh.vertices = [(scale * x, scale * y, 0.85 * scale * z) for x, y, z in mesh.vertices]
        mesh.uvs = [(1.5 * u, 2.0 * v) for u, v in mesh.uvs]
        builder.mesh(name, mesh)
    return name


def _fir_mesh(builder: MapBuilder, height_m: float) -> str:
    """Add the crown of a fir, tiers of branches as a saw-toothed cone; return its name."""
    steps = round(height_m)
    name = f"fir_{steps}"
    if not builder.has_mesh(name):
        rng = RandomGenerator(steps, "fir")
        tiers = 5
        profile = [(0.12, 0.0)]
        for i in range(tiers):
            low, high = i / tiers, (i + 1) / tiers
            wide = 0.26 * height_m * (1.0 - 0.86 * low)
            profile.append((wide, low * height_m + 0.06 * height_m))
            profile.append((max(0.34 * wide, 0.05), high * height_m))
        lumps = [[rng.between(0.88, 1.12) for _ in range(14)] for _ in profile]
        mesh = revolve(profile, 14, wobble=lambda ring, side: lumps[ring][side])
        mesh.uvs = [(2.0 * u, 4.0 * v) for u, v in mesh.uvs]
        builder.mesh(name, mesh)
    return name


def add_tree(builder: MapBuilder, rng: RandomGenerator, x: float, y: float, *, size: float = 1.0) -> None:
    """Add a tree of 5 to 11 m: fir, birch, or one of two kinds of broadleaf crown. 2 to 5 geoms."""
    body = builder.body("tree", (x, y, 0.0), yaw_quat(rng.between(0.0, TURN_RAD)))
    kind = rng.unit()
    if kind < 0.2:
        height = size * rng.between(5.0, 9.0)
        body.geom("cylinder", (0.16, 0.5), material="bark", pos=(0.0, 0.0, 0.5), part="trunk")
        body.geom("mesh", asset=_fir_mesh(builder, height), material="crown_fir", pos=(0.0, 0.0, 0.7), part="crown")
        return
    leaf = rng.pick(("linden", "oak", "linden", "oak", "maple")) if kind < 0.85 else "birch"
    bark = "bark" if kind < 0.85 else "bark_birch"
    trunk = size * rng.between(2.2, 3.4)
    radius = size * rng.between(0.14, 0.24)
    crown = size * rng.between(1.7, 2.6)
    tip = (0.1 * rng.between(-1, 1), 0, trunk + 0.6 * crown)
    body.rod(radius, (0, 0, 0, *tip), material=bark, part="trunk")
    if kind < 0.45:
        mesh = _crown_mesh(builder, rng.index(_CROWN_SHAPES), crown)
        body.geom("mesh", asset=mesh, material=f"crown_{leaf}", pos=(0.0, 0.0, trunk + 0.75 * crown), part="crown")
        return
    lobes = 3 if kind < 0.85 else 2
    for i in range(lobes):
        angle = TURN_RAD * (i + rng.unit() * 0.5) / lobes
        off = yaw_quat(2.0 * angle)  # (cos, 0, 0, sin) of the angle
        out = 0.42 * crown if lobes == 3 else 0.15 * crown
        rise = trunk + crown * (0.55 + 0.38 * i)
        wide = crown * rng.between(0.74, 0.92) * (1.0 if lobes == 3 else 0.75)
        tall = wide * (rng.between(0.72, 0.86) if lobes == 3 else 1.25)
        body.geom(
            "ellipsoid", (wide, wide * rng.between(0.85, 1.0), tall), material=f"leaves_{leaf}",
            pos=(out * off[0], out * off[3], rise), quat=yaw_quat(rng.between(0.0, TURN_RAD)), part=f"crown_{i}",
        )  # fmt: skip


def add_bush(builder: MapBuilder, rng: RandomGenerator, x: float, y: float) -> None:
    body = builder.body("bush", (x, y, 0.0), yaw_quat(rng.between(0.0, TURN_RAD)))
    r = rng.between(0.45, 0.8)
    leaf = rng.pick(("linden", "oak", "birch"))
    body.geom("ellipsoid", (r, 0.85 * r, 0.8 * r), pos=(0.0, 0.0, 0.55 * r), material=f"leaves_{leaf}", part="leaves")
