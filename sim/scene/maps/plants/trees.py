"""Trees and bushes: trunk, boughs and solid shapes.

The boughs of a tree are meshes that all trees share, in steps of size; each stands where a lobe of the solid crown is.
"""

from __future__ import annotations

from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.map_builder import Body, MapBuilder, numbers, yaw_quat
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.models import model
from sim.scene.maps.plants.bark import tube
from sim.scene.maps.plants.hedges import hedge_body
from sim.scene.maps.plants.materials import bark_material, foliage_material, inside_material, leaf_material
from sim.scene.maps.plants.solids import crown_hull, fir_hull
from sim.scene.maps.plants.species import SPECIES
from sim.scene.random_generator import RandomGenerator

_CROWN_SHAPES = 4
_VARIANTS = 2
_CONIFERS = 3  # variants of firs and of pines
_STEP_M = 0.2  # of a bough's size


def add_tree(
    builder: MapBuilder, rng: RandomGenerator, x: float, y: float, *, size: float = 1.0, ground_m: float = 0.0
) -> None:
    """Add a tree of 5 to 11 m: fir, pine, birch, linden, oak or maple."""
    body = builder.body("tree", (x, y, ground_m), yaw_quat(rng.between(0.0, TURN_RAD)))
    kind = rng.unit()
    if kind < 0.2:
        height = size * rng.between(5.0, 9.0)
        _solid(body, "cylinder", (0.16, 0.5), pos=(0.0, 0.0, 0.5), part="trunk_solid")
        _solid(body, "mesh", asset=fir_hull(builder, height), pos=(0.0, 0.0, 0.7), part="crown_solid")
        add_conifer(builder, body, "pine" if kind < 0.07 else "fir", height, int(300.0 * kind) % _CONIFERS)
        return
    leaf = rng.pick(("linden", "oak", "linden", "oak", "maple")) if kind < 0.85 else "birch"
    trunk = size * rng.between(2.2, 3.4)
    radius = size * rng.between(0.14, 0.24)
    crown = size * rng.between(1.7, 2.6)
    tip = (0.1 * rng.between(-1, 1), 0, trunk + 0.6 * crown)
    body.rod(radius, (0, 0, 0, *tip), material="plant_solid", part="trunk_solid", drawn=False)
    limbs: list[tuple[Vec3, Vec3]] = []
    if kind < 0.45:
        shape = rng.index(_CROWN_SHAPES)
        pos = (0.0, 0.0, trunk + 0.75 * crown)
        _solid(body, "mesh", asset=crown_hull(builder, shape, crown), pos=pos, part="crown_solid")
        wide = 0.5 * max(2, round(crown / 0.5))
        add_bough(builder, body, leaf, "whole", (shape % _VARIANTS, wide, 0.0), pos, 0)
        top = trunk + 0.6 * crown
    else:
        lobes = 3 if kind < 0.85 else 2
        for i in range(lobes):
            angle = TURN_RAD * (i + rng.unit() * 0.5) / lobes
            off = yaw_quat(2.0 * angle)  # (cos, 0, 0, sin) of the angle
            out = 0.42 * crown if lobes == 3 else 0.15 * crown
            rise = trunk + crown * (0.55 + 0.38 * i)
            wide = crown * rng.between(0.74, 0.92) * (1.0 if lobes == 3 else 0.75)
            tall = wide * (rng.between(0.72, 0.86) if lobes == 3 else 1.25)
            pos = (out * off[0], out * off[3], rise)
            half = (wide, wide * rng.between(0.85, 1.0), tall)
            turn = yaw_quat(rng.between(0.0, TURN_RAD))
            _solid(body, "ellipsoid", half, pos=pos, quat=turn, part=f"crown_solid_{i}")
            limbs.append(((0.0, 0.0, rise - 0.85 * wide), pos))
            variant = (i + int(64.0 * kind)) % _VARIANTS
            add_bough(builder, body, leaf, f"{'lobe' if lobes == 3 else 'tall'}_{i}", (variant, wide, angle), pos, i)
        top = trunk + crown * (0.75 if lobes == 3 else 0.5)
    wood = _trunk(radius, (tip[0], tip[1], top), thin=0.3)
    if SPECIES[leaf].leaves(builder.season) is not None:
        for foot, end in limbs:
            _add_limb(wood, foot, end, 0.42 * radius)
    asset = builder.mesh(f"{body.name}_trunk", wood)
    body.geom("mesh", asset=asset, material=bark_material(builder, leaf), solid=False, part="trunk")


def add_bush(builder: MapBuilder, rng: RandomGenerator, x: float, y: float) -> None:
    """Add a bush of 0.6 to 1.1 m."""
    body = builder.body("bush", (x, y, 0.0), yaw_quat(rng.between(0.0, TURN_RAD)))
    r = rng.between(0.45, 0.8)
    kind = rng.pick((0, 1, 2))
    pos = (0.0, 0.0, 0.55 * r)
    _solid(body, "ellipsoid", (r, 0.85 * r, 0.8 * r), pos=pos, part="leaves_solid")
    add_bough(builder, body, "shrub", "bush", (kind, r, 0.0), pos, 0, step_m=0.1)


def add_hedge(builder: MapBuilder, x: float, y: float, heading_rad: float, half_m: Vec3) -> None:
    """Add a clipped hedge on the ground; `half_m`: half its length, width and height."""
    body = builder.body("hedge", (x, y, 0.0), yaw_quat(heading_rad))
    pos = (0.0, 0.0, half_m[2])
    _solid(body, "box", half_m, pos=pos, part="solid")
    asset = builder.mesh(f"hedge_{numbers(half_m).replace(' ', '_')}", hedge_body(half_m))
    body.geom("mesh", asset=asset, material=foliage_material(builder, "hedge"), pos=pos, solid=False, part="leaves")


def add_conifer(builder: MapBuilder, body: Body, name: str, height_m: float, variant: int) -> None:
    """Add trunk, branches and needles of a fir or a pine, whose crown of this height begins at 0.7 m."""
    steps = round(height_m)
    source = f"{name}_{variant}"
    made = model(f"plants/{source}")
    pos = (0.0, 0.0, 0.7)
    asset = builder.mesh(f"{source}_{steps}", made.mesh("leaves"), scale=float(steps), source=source)
    body.geom("mesh", asset=asset, material=leaf_material(builder, name), pos=pos, solid=False, part="leaves")
    if "inside" in made.pieces:
        mesh = made.mesh("inside")
        asset = builder.mesh(f"{source}_{steps}_inside", mesh, scale=float(steps), source=f"{source}_inside")
        material = inside_material(builder, name, cube=False)
        body.geom("mesh", asset=asset, material=material, pos=pos, solid=False, part="inside")
    bark = bark_material(builder, name)
    if "wood" in made.pieces:
        mesh = made.mesh("wood")
        asset = builder.mesh(f"{source}_{steps}_wood", mesh, scale=float(steps), source=f"{source}_wood")
        body.geom("mesh", asset=asset, material=bark, pos=pos, solid=False, part="branches")
    trunk = f"{name}_trunk_{steps}"
    if not builder.has_mesh(trunk):
        builder.mesh(trunk, _trunk(0.16, (0.0, 0.0, 0.7 + 0.93 * steps), thin=0.08))
    body.geom("mesh", asset=trunk, material=bark, solid=False, part="trunk")


def _solid(body: Body, kind: str, size: tuple[float, ...] = (), **more: object) -> None:
    body.proxy(kind, size, material="plant_solid", **more)  # type: ignore[arg-type]


def add_bough(
    builder: MapBuilder,
    body: Body,
    name: str,
    form: str,
    made: tuple[int, float, float],
    pos: Vec3,
    number: int,
    *,
    step_m: float = _STEP_M,
) -> None:
    """Add branches and leaves of one bough. `made`: variant, longest half axis [m] and heading [rad]."""
    variant, wide_m, heading_rad = made
    species = SPECIES[name]
    bare = species.leaves(builder.season) is None
    steps = max(2, round(wide_m / step_m))
    quat = yaw_quat(heading_rad)
    source = f"{form}{'_drooping' if species.droop else ''}_{variant}"
    shipped = model(f"plants/{source}")
    asset = builder.mesh(f"{source}_{steps}", shipped.mesh("leaves"), scale=step_m * steps, source=source)
    material = leaf_material(builder, name)
    body.geom("mesh", asset=asset, material=material, pos=pos, quat=quat, solid=False, part=f"leaves_{number}")
    if not bare:
        size, (x, y, z) = shipped.facts["core"] * wide_m, shipped.facts["axes"]
        core = (size * x, size * y, size * z)
        material = inside_material(builder, name)
        body.geom("ellipsoid", core, material=material, pos=pos, quat=quat, solid=False, part=f"inside_{number}")
        return
    source += "_wood"
    asset = builder.mesh(f"{source}_{steps}", shipped.mesh("wood"), scale=step_m * steps, source=source)
    material = bark_material(builder, name)
    body.geom("mesh", asset=asset, material=material, pos=pos, quat=quat, solid=False, part=f"branches_{number}")


def _add_limb(mesh: Mesh, foot: Vec3, end: Vec3, radius_m: float) -> None:
    """Add a limb from the trunk to the middle of a lobe of the crown."""
    inside = (0.7 * end[0], 0.7 * end[1], 0.5 * foot[2] + 0.5 * end[2])
    tube(mesh, [foot, inside], [radius_m, 0.6 * radius_m], 4)


def _trunk(radius_m: float, tip: Vec3, *, thin: float) -> Mesh:
    """Return a trunk from a flared foot to its tip, where it has the share `thin` of its radius."""
    mesh = Mesh.empty()
    shares = (0.0, 0.08, 0.35, 1.0)
    points = [(tip[0] * s * s, tip[1], tip[2] * s - (0.05 if s == 0.0 else 0.0)) for s in shares]
    tube(mesh, points, [radius_m * (1.02 - (1.02 - thin) * s) for s in shares], 6, flare=1.4)
    return mesh
