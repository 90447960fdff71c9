"""Buildings: blocks of flats with a facade texture, and family houses with brick walls and a pitched roof."""

from __future__ import annotations

from math import pi, sqrt

from signals._kernel import det_atan2
from signals.rotation import product
from sim.scene.maps import surfaces, textures
from sim.scene.maps.map_builder import Body, MapBuilder, pitch_quat, yaw_quat
from sim.scene.maps.meshes import box_with_tiles, extrude_xz, gabled
from sim.scene.random_generator import RandomGenerator

BAY_M = 3.0  # width of a window, height of a storey: the tile of every facade
_FACADES = ("facade_sand", "facade_red", "facade_white", "facade_office")


def building_materials(builder: MapBuilder) -> None:
    for name in (*_FACADES, "roof_tiles", "brick", "plaster"):
        builder.texture(name, textures.png(name))
    for name in _FACADES:
        builder.material(name, surfaces.CONCRETE, texture=name, specular=0.2)
    # Materials of meshes that have texture coordinates, so without a tile size.
    builder.material("brick_mesh", surfaces.BRICK, texture="brick", specular=0.0)
    builder.material("plaster_white", surfaces.PLASTER, texture="plaster", specular=0.0)
    builder.material("plaster_ochre", surfaces.PLASTER, rgb=(0.90, 0.76, 0.52), texture="plaster", specular=0.0)
    builder.material("plaster_blue", surfaces.PLASTER, rgb=(0.66, 0.76, 0.82), texture="plaster", specular=0.0)
    builder.material("roof_tiles", surfaces.ROOF_TILE, texture="roof_tiles", tile_m=2.4, specular=0.0)
    builder.material(
        "roof_slate", surfaces.STONE, rgb=(0.45, 0.47, 0.52), texture="roof_tiles", tile_m=2.4, specular=0.0
    )
    builder.material("roof_tiles_mesh", surfaces.ROOF_TILE, texture="roof_tiles", specular=0.0)
    builder.material("roof_felt", surfaces.ASPHALT, rgb=(0.40, 0.40, 0.41), specular=0.0)
    builder.material("window_glass", surfaces.GLASS, rgb=(0.20, 0.27, 0.34), specular=0.8, shininess=0.8)
    builder.material("window_frame", surfaces.WOOD, rgb=(0.90, 0.89, 0.86))
    builder.material("door_green", surfaces.WOOD, rgb=(0.12, 0.27, 0.20))
    builder.material("door_red", surfaces.WOOD, rgb=(0.50, 0.10, 0.09))
    builder.material("door_blue", surfaces.WOOD, rgb=(0.12, 0.22, 0.42))
    builder.material("step_stone", surfaces.STONE, rgb=(0.62, 0.61, 0.58), specular=0.0)


def add_block(
    builder: MapBuilder,
    rng: RandomGenerator,
    x: float,
    y: float,
    heading_rad: float,
    bays: int,
    deep: int,
    storeys: int,
) -> None:
    """Add a block of flats of `bays` x `deep` x `storeys` bays of 3 m, with a flat or a tiled roof: 2 geoms."""
    body = builder.body("building", (x, y, 0.0), yaw_quat(heading_rad))
    half = (0.5 * BAY_M * bays, 0.5 * BAY_M * deep, 0.5 * BAY_M * storeys)
    mesh = builder.mesh(f"block_{bays}_{deep}_{storeys}", box_with_tiles(half, (BAY_M, BAY_M)))
    body.geom("mesh", asset=mesh, material=rng.pick(_FACADES), pos=(0.0, 0.0, half[2]), part="walls")
    top = 2.0 * half[2]
    if rng.chance(0.5):
        body.geom(
            "box", (half[0] + 0.3, half[1] + 0.3, 0.25), material="roof_felt", pos=(0.0, 0.0, top + 0.25), part="roof"
        )
        return
    rise = 2.6
    hx, hy = half[1] + 0.5, half[0] + 0.3
    roof = builder.mesh(
        f"blockroof_{bays}_{deep}",
        extrude_xz([(-hx, 0.0), (hx, 0.0), (hx, 0.15), (0.0, rise), (-hx, 0.15)], hy, tile_m=2.4),
    )
    ridge_along_x = yaw_quat(1.5707963267948966)
    body.geom("mesh", asset=roof, material="roof_tiles_mesh", pos=(0.0, 0.0, top), quat=ridge_along_x, part="roof")


def add_house(
    builder: MapBuilder,
    rng: RandomGenerator,
    x: float,
    y: float,
    heading_rad: float,
    *,
    half_x_m: float,
    half_y_m: float,
) -> None:
    """Add a family house with the door towards +x of its heading and the ridge along y: about 20 geoms."""
    wall = rng.pick((2.9, 2.9, 5.4))
    rise = half_x_m * rng.between(0.62, 0.85)
    hx, hy = half_x_m, half_y_m
    material = rng.pick(("brick_mesh", "brick_mesh", "plaster_white", "plaster_ochre", "plaster_blue"))
    tile = 1.0 if material == "brick_mesh" else 3.0
    name = f"house_{round(hx * 100)}_{round(hy * 100)}_{round(wall * 10)}_{round(rise * 100)}_{round(tile)}"
    body = builder.body("house", (x, y, 0.0), yaw_quat(heading_rad))
    mesh = builder.mesh(name, gabled(hx, hy, wall, rise, tile_m=tile))
    body.geom("mesh", asset=mesh, material=material, part="walls")
    # Two slabs of roof, turned about y by the pitch; 0.35 m of eaves.
    pitch = det_atan2(rise, hx)
    slope = sqrt(hx * hx + rise * rise)
    eaves = 0.35
    reach = 0.5 * (slope + eaves)
    roof = rng.pick(("roof_tiles", "roof_tiles", "roof_slate"))
    for part, side in (("roof_front", 1.0), ("roof_back", -1.0)):
        # The slab's local x points down the slope; local y of the texture is then up.
        cx = side * 0.5 * (hx + eaves * hx / slope)
        cz = wall + 0.5 * (rise - eaves * rise / slope) + 0.08
        tilt = pitch_quat(pitch)
        quat = tilt if side > 0 else product(yaw_quat(pi), tilt)
        # A quarter turn about the slab's own z lays texture rows along the eaves.
        quat = product(quat, yaw_quat(1.5707963267948966))
        body.geom("box", (hy + 0.3, reach, 0.07), pos=(cx, 0.0, cz), quat=quat, material=roof, part=part)
    stack_y = hy * rng.between(-0.5, 0.5)
    body.geom(
        "box", (0.3, 0.3, 0.9), pos=(-0.35 * hx, stack_y, wall + rise), material="step_stone", part="chimney"
    )  # fmt: skip
    door_y = hy * rng.between(-0.35, 0.35)
    door = rng.pick(("door_green", "door_red", "door_blue"))
    body.geom("box", (0.04, 0.5, 1.05), pos=(hx + 0.02, door_y, 1.15), material=door, part="door", solid=False)
    body.geom("box", (0.5, 0.75, 0.08), pos=(hx + 0.5, door_y, 0.08), material="step_stone", part="step")
    storeys = 1 if wall < 4.0 else 2
    for storey in range(storeys):
        z = 1.55 + 2.6 * storey
        for i in range(max(2, round(hy / 1.6))):
            y_w = -hy + 1.1 + i * (2.0 * hy - 2.2) / max(1, round(hy / 1.6) - 1)
            if storey == 0 and abs(y_w - door_y) < 1.2:
                continue
            _window(body, hx, y_w, z, f"{storey}{i}f", 1.0)
            if i % 2 == 0:
                _window(body, hx, y_w, z, f"{storey}{i}b", -1.0)


def _window(body: Body, hx: float, y: float, z: float, part: str, side: float) -> None:
    for name, size, out, material in (
        ("frame", (0.03, 0.55, 0.62), 0.01, "window_frame"),
        ("pane", (0.02, 0.47, 0.54), 0.03, "window_glass"),
    ):
        body.geom("box", size, pos=(side * (hx + out), y, z), material=material, part=f"{name}_{part}", solid=False)
