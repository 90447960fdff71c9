"""Objects of a training village: concrete shells of houses, towers and halls, containers, sandbags, barrels."""

from __future__ import annotations

from signals.units import QUARTER_TURN_RAD, TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import Body, MapBuilder, roll_quat, yaw_quat
from sim.scene.maps.meshes import box_with_tiles, extrude_xz
from sim.scene.maps.walls import Looks, Openings, Shell, add_shell
from sim.scene.random_generator import RandomGenerator

STOREY_M = 3.2
_UPRIGHT = roll_quat(QUARTER_TURN_RAD)
_WALL_M = 0.25
_WALLS = ("blockwork", "concrete_wall", "render_sand", "render_grey")
_CONTAINER = (3.03, 1.22, 1.295)  # half edges of a 20 foot container
_CONTAINER_RGB = {
    "rust": (0.52, 0.24, 0.15), "blue": (0.16, 0.30, 0.48), "olive": (0.30, 0.33, 0.19), "grey": (0.52, 0.54, 0.55),
}  # fmt: skip


def military_materials(builder: MapBuilder) -> None:
    for name in ("blockwork", "concrete", "plaster", "sheet_metal", "sandbags", "wood"):
        builder.texture(name, textures.png(name))
    builder.material("blockwork", surfaces.CONCRETE, texture="blockwork", tile_m=3.2, specular=0.0)
    builder.material(
        "concrete_dark", surfaces.CONCRETE, rgb=(0.72, 0.71, 0.70), texture="concrete", tile_m=5.0, specular=0.0
    )
    # Materials of meshes that have texture coordinates, so without a tile size.
    builder.material("blockwork_mesh", surfaces.CONCRETE, texture="blockwork", specular=0.0)
    builder.material("concrete_wall_mesh", surfaces.CONCRETE, texture="concrete", specular=0.0)
    builder.material("render_sand_mesh", surfaces.PLASTER, rgb=(0.83, 0.75, 0.61), texture="plaster", specular=0.0)
    builder.material("render_grey_mesh", surfaces.PLASTER, rgb=(0.71, 0.71, 0.69), texture="plaster", specular=0.0)
    builder.texture("spall", textures.png("spall"), holes=True)
    builder.material("spall", surfaces.CONCRETE, texture="spall", specular=0.0)
    builder.material("frame_wood", surfaces.WOOD, rgb=(0.75, 0.74, 0.72), texture="wood", specular=0.0)
    builder.material("slab", surfaces.CONCRETE, rgb=(0.53, 0.52, 0.50), specular=0.0)
    builder.material("sandbags", surfaces.SANDBAG, texture="sandbags", specular=0.0)
    builder.material("crate", surfaces.WOOD, texture="wood", tile_m=0.8, specular=0.0)
    builder.material("steel_dark", surfaces.PAINTED_METAL, rgb=(0.28, 0.29, 0.30), specular=0.3)
    builder.material("rust", surfaces.PAINTED_METAL, rgb=(0.46, 0.26, 0.17), specular=0.1)
    for name, rgb in _CONTAINER_RGB.items():
        builder.material(f"container_{name}", surfaces.PAINTED_METAL, rgb=rgb, texture="sheet_metal", specular=0.2)
        builder.material(f"barrel_{name}", surfaces.PAINTED_METAL, rgb=rgb, specular=0.3)


_TILES_M = {"blockwork": 3.2, "concrete_wall": 5.0, "render_sand": 3.0, "render_grey": 3.0}


def _looks(body: Body, x: float, y: float, material: str) -> Looks:
    rng = RandomGenerator(0, f"shell.{body.name}.{x!r}.{y!r}")
    return Looks(rng, _TILES_M[material], spalls=material.startswith("render"))


def _rows(storeys: int) -> tuple[tuple[float, float], ...]:
    return tuple((STOREY_M * i + 1.0, STOREY_M * i + 2.2) for i in range(storeys))


def _sides(
    rng: RandomGenerator, rows: tuple[tuple[float, float], ...], counts: tuple[int, int], width_m: float
) -> list[Openings]:
    """Return windows for all four sides, and a door in one of them."""
    door_side = rng.index(4)
    sides = []
    for side in range(4):
        count = counts[side % 2]
        sides.append(Openings(rows, count, width_m, rng.index(max(count, 1)) if side == door_side else -1))
    return sides


def add_shell_house(
    builder: MapBuilder, rng: RandomGenerator, x: float, y: float, half_x_m: float, half_y_m: float, storeys: int
) -> None:
    """Add a house of `storeys` storeys with open windows and a flat roof with a low parapet at its front."""
    body = builder.body("house", (x, y, 0.0))
    height = STOREY_M * storeys
    counts = (max(1, int(half_x_m / 2.2)), max(1, int(half_y_m / 2.2)))
    sides = _sides(rng, _rows(storeys), counts, 1.1)
    floors = [STOREY_M * i for i in range(1, storeys)]
    shell = Shell(half_x_m, half_y_m, height, _WALL_M, floors)
    material = rng.pick(_WALLS)
    add_shell(builder, body, shell, sides, _looks(body, x, y, material), material=material, slab_material="slab")


def add_tall_block(
    builder: MapBuilder, rng: RandomGenerator, x: float, y: float, half_x_m: float, half_y_m: float, storeys: int
) -> None:
    """Add a block of 4 storeys (12.8 m and a roof), an obstacle for a flight at 10 m."""
    body = builder.body("tower", (x, y, 0.0))
    counts = (2 if half_x_m > 4.0 else 1, 2 if half_y_m > 4.0 else 1)
    sides = _sides(rng, _rows(storeys), counts, 1.3)
    height = STOREY_M * storeys
    floors = [STOREY_M * i for i in range(1, storeys)]
    shell = Shell(half_x_m, half_y_m, height, 0.3, floors)
    material = rng.pick(_WALLS)
    add_shell(builder, body, shell, sides, _looks(body, x, y, material), material=material, slab_material="slab")
    # Stairwell on the roof.
    body.geom("box", (1.2, 1.0, 0.9), pos=(0.3 * half_x_m, 0.0, height + 1.1), material="concrete_dark", part="stairs")


def add_hall(
    builder: MapBuilder, rng: RandomGenerator, x: float, y: float, half_x_m: float, half_y_m: float, height_m: float
) -> None:
    """Add a hall with one high row of windows and a gate of 3.6 x 5 m in each long side."""
    body = builder.body("hall", (x, y, 0.0))
    row = ((5.0, 7.4),)
    counts = (max(1, int(half_x_m / 2.6)), max(1, int(half_y_m / 2.6)))
    long_x = half_x_m >= half_y_m
    sides = []
    for side in range(4):
        count = counts[side % 2]
        gate = (side % 2 == 0) == long_x
        sides.append(Openings(row, count, 3.0, rng.index(count) if gate else -1))
    shell = Shell(half_x_m, half_y_m, height_m, 0.35)
    looks = _looks(body, x, y, "concrete_wall")
    add_shell(builder, body, shell, sides, looks, material="concrete_wall", slab_material="steel_dark")


def add_water_tower(builder: MapBuilder, x: float, y: float) -> None:
    """Add a tank 3.6 m wide, between 8.5 and 13.5 m, on four legs."""
    body = builder.body("tower", (x, y, 0.0), yaw_quat(0.3))
    for i, (px, py) in enumerate(((-1.2, -1.2), (1.2, -1.2), (1.2, 1.2), (-1.2, 1.2))):
        leg = (1.25 * px, 1.25 * py, 0.0, px, py, 8.6)
        body.rod(0.14, leg, material="steel_dark", part=f"leg_{i}")
    body.geom("cylinder", (1.8, 2.3), pos=(0.0, 0.0, 10.9), material="rust", part="tank")
    body.geom("ellipsoid", (1.8, 1.8, 0.7), pos=(0.0, 0.0, 13.2), material="rust", part="lid")


def add_chimney(builder: MapBuilder, x: float, y: float, height_m: float) -> None:
    body = builder.body("tower", (x, y, 0.0))
    body.geom("cylinder", (0.9, height_m / 2), pos=(0.0, 0.0, height_m / 2), material="concrete_dark", part="stack")
    body.geom("cylinder", (1.0, 0.3), pos=(0.0, 0.0, height_m - 0.3), material="steel_dark", part="rim")


def add_container(
    builder: MapBuilder, rng: RandomGenerator, x: float, y: float, heading_rad: float, *, stacked: bool
) -> None:
    """Add a 20 foot container, or two on top of each other."""
    mesh = builder.mesh("container", box_with_tiles(_CONTAINER, (1.8, 2.59)))
    body = builder.body("container", (x, y, 0.0), yaw_quat(heading_rad))
    for i in range(2 if stacked else 1):
        colour = rng.pick(tuple(_CONTAINER_RGB))
        z = _CONTAINER[2] * (2 * i + 1)
        body.geom("mesh", asset=mesh, material=f"container_{colour}", pos=(0.0, 0.0, z), part=f"box_{i}")


def add_barrels(builder: MapBuilder, rng: RandomGenerator, x: float, y: float) -> None:
    """Add a group of three to five drums."""
    body = builder.body("barrel", (x, y, 0.0), yaw_quat(rng.between(0.0, TURN_RAD)))
    spots = ((0.0, 0.0), (0.64, 0.05), (0.3, 0.6), (-0.4, 0.55), (0.95, 0.6))
    for i, (px, py) in enumerate(spots[: 3 + rng.index(3)]):
        colour = rng.pick(tuple(_CONTAINER_RGB))
        body.geom("cylinder", (0.29, 0.44), pos=(px, py, 0.44), material=f"barrel_{colour}", part=f"drum_{i}")


def add_sandbags(builder: MapBuilder, x: float, y: float, heading_rad: float) -> None:
    """Add a breastwork of 4 m with two short wings."""
    front = builder.mesh("sandbags_4", box_with_tiles((2.0, 0.3, 0.5), (1.0, 1.0)))
    wing = builder.mesh("sandbags_1", box_with_tiles((0.3, 0.7, 0.5), (1.0, 1.0)))
    body = builder.body("sandbags", (x, y, 0.0), yaw_quat(heading_rad))
    body.geom("mesh", asset=front, material="sandbags", pos=(0.0, 0.0, 0.5), part="front")
    for name, px in (("left", -1.7), ("right", 1.7)):
        body.geom("mesh", asset=wing, material="sandbags", pos=(px, -0.95, 0.5), part=name)


def add_crates(builder: MapBuilder, rng: RandomGenerator, x: float, y: float) -> None:
    body = builder.body("crate", (x, y, 0.0), yaw_quat(rng.between(0.0, TURN_RAD)))
    for i, (px, py, pz) in enumerate(((0.0, 0.0, 0.45), (1.0, 0.1, 0.45), (0.45, 0.05, 1.35))[: 2 + rng.index(2)]):
        body.geom("box", (0.45, 0.45, 0.45), pos=(px, py, pz), material="crate", part=f"box_{i}")


def add_barrier(builder: MapBuilder, x: float, y: float, heading_rad: float) -> None:
    """Add a concrete road barrier, 3 m long and 0.8 m high."""
    profile = [(-0.3, 0.0), (0.3, 0.0), (0.3, 0.1), (0.1, 0.8), (-0.1, 0.8), (-0.3, 0.1)]
    mesh = builder.mesh("barrier", extrude_xz(profile, 1.5))
    body = builder.body("barrier", (x, y, 0.0), yaw_quat(heading_rad))
    body.geom("mesh", asset=mesh, material="slab")


def add_yard_wall(
    builder: MapBuilder, x: float, y: float, half_length_m: float, heading_rad: float, height_m: float
) -> None:
    """Add a free-standing wall."""
    body = builder.body("wall", (x, y, 0.0), yaw_quat(heading_rad))
    size = (half_length_m, height_m / 2, 0.1)
    body.geom("box", size, pos=(0.0, 0.0, height_m / 2), quat=_UPRIGHT, material="blockwork")
