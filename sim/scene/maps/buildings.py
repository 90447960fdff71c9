"""Buildings: blocks of flats with shops, balconies and flat or tiled roofs, and family houses with pitched roofs.

A building is solid as boxes (and a roof prism) that are not drawn, in group 3; what is drawn are the meshes of
`facade.Facades`, which recede from these boxes by at most 0.2 m and protrude from them by at most 0.2 m. Balconies,
canopies and roof units have boxes of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

from signals._kernel import det_atan2
from signals.rotation import product
from signals.units import QUARTER_TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.facade import Facades, Opening, Pitched, Side, sides_of
from sim.scene.maps.facade_layout import OFFICE_WINDOW_M, WINDOW_M
from sim.scene.maps.map_builder import Body, MapBuilder, pitch_quat, yaw_quat
from sim.scene.maps.meshes import extrude_xz, gabled
from sim.scene.random_generator import RandomGenerator

BAY_M = 3.0  # width of a window's part of the wall, height of a storey
_STYLES = ("sand", "red", "white", "office")
_RENDER_RGB = {
    "white": (1.0, 1.0, 1.0), "cream": (0.98, 0.94, 0.84), "sand": (0.95, 0.86, 0.69), "rose": (0.94, 0.82, 0.75),
    "grey": (0.86, 0.87, 0.87), "green": (0.85, 0.89, 0.81), "blue": (0.80, 0.86, 0.91),
}  # fmt: skip
_RENDER_WIDTH_M, _BRICK_WIDTH_M = 12.0, 6.0


def building_materials(builder: MapBuilder) -> None:
    for name in ("wall_render", "wall_brick", "wall_panel", "panes", "trim", "roof_tiles", "roof_felt", "door"):
        builder.texture(name, textures.png(name))
    # Materials of meshes that have texture coordinates, so without a tile size.
    for name, rgb in _RENDER_RGB.items():
        builder.material(f"render_{name}", surfaces.PLASTER, rgb=rgb, texture="wall_render", specular=0.0)
    builder.material("brick_red", surfaces.BRICK, texture="wall_brick", specular=0.0)
    builder.material("brick_brown", surfaces.BRICK, rgb=(0.88, 0.86, 0.84), texture="wall_brick", specular=0.0)
    builder.material("panel_grey", surfaces.CONCRETE, texture="wall_panel", specular=0.0)
    builder.material("window_glass", surfaces.GLASS, texture="panes", specular=0.9, shininess=0.9)
    builder.material("trim", surfaces.WOOD, texture="trim", specular=0.1)
    builder.material("roof_tiles_mesh", surfaces.ROOF_TILE, texture="roof_tiles", specular=0.0)
    builder.material("roof_slate", surfaces.STONE, rgb=(0.72, 0.86, 1.0), texture="roof_tiles", specular=0.1)
    builder.material("roof_felt", surfaces.ASPHALT, texture="roof_felt", tile_m=6.0, specular=0.0)
    builder.material("door_green", surfaces.WOOD, rgb=(0.14, 0.25, 0.20), texture="door", specular=0.2)
    builder.material("door_red", surfaces.WOOD, rgb=(0.40, 0.12, 0.11), texture="door", specular=0.2)
    builder.material("door_blue", surfaces.WOOD, rgb=(0.14, 0.22, 0.36), texture="door", specular=0.2)
    builder.material("step_stone", surfaces.STONE, rgb=(0.55, 0.54, 0.52), specular=0.0)
    builder.material("proxy", surfaces.CONCRETE)


def flats_material(builder: MapBuilder, kind: str, tint: str, *, recessed: bool) -> str:
    """Add the material of the walls of flats, with holes for the windows if `recessed`; return its name."""
    texture = f"flats_{kind}_holes" if recessed else f"flats_{kind}"
    builder.texture(texture, textures.png(texture), holes=recessed)
    surface = {"office": surfaces.CONCRETE, "brick": surfaces.BRICK, "render": surfaces.PLASTER}[kind]
    rgb = _RENDER_RGB[tint] if tint else (1.0, 1.0, 1.0)
    return builder.material(f"{texture}_{tint}", surface, rgb=rgb, texture=texture, specular=0.0)


def flats_glass(builder: MapBuilder, kind: str) -> str:
    texture = "office_windows" if kind == "office" else "flats_windows"
    builder.texture(texture, textures.png(texture))
    return builder.material(texture, surfaces.GLASS, texture=texture, specular=0.9, shininess=0.9)


def _details(body: Body, x: float, y: float) -> RandomGenerator:
    """Return the generator of a building's looks; another building, or the same elsewhere, has other numbers."""
    return RandomGenerator(0, f"facade.{body.name}.{x!r}.{y!r}")


def _proxy(body: Body, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], part: str) -> None:
    """Add a solid box that is not drawn."""
    half = (0.5 * (x[1] - x[0]), 0.5 * (y[1] - y[0]), 0.5 * (z[1] - z[0]))
    middle = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]), 0.5 * (z[0] + z[1]))
    body.proxy("box", half, material="proxy", pos=middle, part=part)


def _proxy_before(
    body: Body, side: Side, x: tuple[float, float], z: tuple[float, float], out_m: float, part: str
) -> None:
    """Add a solid box that is not drawn, from a wall outwards."""
    a, b = side.at(x[0], z[0], 0.0), side.at(x[1], z[1], out_m)
    xs, ys = sorted((a[0], b[0])), sorted((a[1], b[1]))
    _proxy(body, (xs[0], xs[1]), (ys[0], ys[1]), z, part)


def add_block(
    builder: MapBuilder,
    rng: RandomGenerator,
    place: tuple[float, float, float],
    size: tuple[int, int, int],
    *,
    recessed: bool,
    street: int | None = 2,
    gates: tuple[int, ...] = (),
) -> None:
    """Add a block of flats with a flat or a tiled roof.

    `place`: x, y and heading. `size`: bays, bays in depth and storeys, 3 m each.

    `recessed`: its windows are recessed and glazed, else a part of the walls' texture: for buildings in the distance.
    `street`: its side (facade.sides_of) with entrances and shops, None: none. `gates`: bays of the -y side whose ground
    floor has no window, because a gate stands before it.
    """
    (x, y, heading_rad), (bays, deep, storeys) = place, size
    body = builder.body("building", (x, y, 0.0), yaw_quat(heading_rad))
    half = (0.5 * BAY_M * bays, 0.5 * BAY_M * deep, 0.5 * BAY_M * storeys)
    style = rng.pick(_STYLES)
    flat = rng.chance(0.5)
    look = _details(body, x, y)
    top = 2.0 * half[2]
    _proxy(body, (-half[0], half[0]), (-half[1], half[1]), (0.0, top), "walls")
    shops = street is not None and look.chance(0.6)
    facades = Facades(_BRICK_WIDTH_M if style == "red" else _RENDER_WIDTH_M)
    for number, side in enumerate(sides_of(half[0], half[1], BAY_M * look.index(4))):
        count = bays if number % 2 == 0 else deep
        _block_side(
            facades, body, look, side, (count, storeys), style,
            ground=GroundFloor(number == street, shops and number == street, gates if number == 0 else ()),
            recessed=recessed,
        )  # fmt: skip
    if flat:
        _flat_roof(facades, body, look, half, top)
    else:
        _block_roof(builder, facades, body, half, top)
    kind = "office" if style == "office" else "brick" if style == "red" else "render"
    tint = {"sand": look.pick(("cream", "sand", "rose")), "white": look.pick(("white", "grey", "green"))}.get(style, "")
    wall = {"office": "panel_grey", "brick": "brick_red", "render": f"render_{tint}"}[kind]
    front = flats_material(builder, kind, tint, recessed=recessed)
    glass = flats_glass(builder, kind) if recessed else ""
    facades.add_to(
        builder, body, {"front": front, "wall": wall, "glass": glass, "trim": "trim", "roof": "roof_tiles_mesh"}
    )


@dataclass(frozen=True)
class GroundFloor:
    """Ground floor of one side of a block of flats."""

    faces_street: bool  # it has an entrance
    shops: bool
    gates: tuple[int, ...]  # bays without a window


def _block_side(
    facades: Facades, body: Body, look: RandomGenerator, side: Side, size: tuple[int, int], style: str, *,
    ground: GroundFloor, recessed: bool,
) -> None:  # fmt: skip
    """Add one side of a block: windows by bay and storey, ground floor, cornice, balconies, pipes."""
    bays, storeys = size
    width, sill, head = OFFICE_WINDOW_M if style == "office" else WINDOW_M
    window = Opening(0.5 * (BAY_M - width), 0.5 * (BAY_M + width), sill, head)
    top = BAY_M * storeys
    entrance = bays // 2 if ground.faces_street and bays > 2 else -1
    middles = [BAY_M * (bay + 0.5) for bay in range(bays)]

    def front(x: tuple[float, float], z: tuple[float, float]) -> None:
        if recessed:
            facades.pierced(side, x, z, window)
        else:
            facades.flat(side, x, z)

    plain = [bay for bay in range(bays) if ground.shops or bay == entrance or bay in ground.gates]
    if not plain:
        front((0.0, side.length_m), (0.0, top))
    else:
        if storeys > 1:
            front((0.0, side.length_m), (BAY_M, top))
        edge = 0
        for bay in (*plain, bays):
            if bay > edge:
                front((BAY_M * edge, BAY_M * bay), (0.0, BAY_M))
            edge = bay + 1
        if ground.shops:
            _shop_fronts(facades, look, side, bays, entrance)
        for bay in plain:
            cell = (BAY_M * bay, BAY_M * (bay + 1))
            if bay in ground.gates:
                facades.wall(side, cell, (0.0, BAY_M))
            elif bay == entrance:
                x = middles[bay]
                opening = Opening(x - 0.7, x + 0.7, 0.0, 2.45, 0.2)
                facades.storey(side, cell, (0.0, BAY_M), [opening])
                facades.door(side, opening)
                facades.band(side, (x - 0.95, x + 0.95), (2.5, 2.6), 0.2, "dark")
    facades.band(side, (-0.14, side.length_m + 0.14), (top - 0.25, top), 0.14, "stone", faces="fb")
    if ground.faces_street and style in ("sand", "white") and look.chance(0.75):
        for bay in range(1, bays - 1, 4):
            for level in range(1, storeys):
                stone = "cream" if style == "sand" else "stone"
                _balcony(facades, body, side, middles[bay], BAY_M * level, stone, part=f"balcony_{level}_{bay}")
    facades.downpipe(side, side.length_m - 0.35, top - 0.2)


def _balcony(facades: Facades, body: Body, side: Side, x: float, floor: float, stone: str, *, part: str) -> None:
    """Add a balcony 1.1 m deep: a slab, and a front and sides of panels."""
    a, b, out = x - 1.15, x + 1.15, 1.1
    facades.box("wall", side, (a, b), (floor - 0.15, floor + 1.0), (0.0, out), row=stone, faces="fblr")
    facades.box("wall", side, (a, b), (floor, floor + 0.02), (0.0, out), row="plinth", faces="t")
    _proxy_before(body, side, (a, b), (floor - 0.15, floor + 1.0), out, part)


def _shop_fronts(facades: Facades, look: RandomGenerator, side: Side, bays: int, entrance: int) -> None:
    """Add the ground floor with shops at both sides of the entrance: windows, sign boards, awnings rolled in."""
    for first, last in ((0, entrance), (entrance + 1, bays)) if entrance >= 0 else ((0, bays),):
        if last <= first:
            continue
        a, b = BAY_M * first + 0.25, BAY_M * last - 0.25
        facades.wall(side, (BAY_M * first, a), (0.0, 2.5))
        facades.wall(side, (b, BAY_M * last), (0.0, 2.5))
        facades.wall(side, (BAY_M * first, BAY_M * last), (2.5, BAY_M))
        facades.shops(side, (a, b), look.index(2))
        facades.box("trim", side, (a, b), (2.52, 2.94), (0.0, 0.09), row="anthracite", faces="fb")
        if look.chance(0.5):
            awning = look.pick(("awning_red", "awning_green"))
            facades.box("trim", side, (a + 0.3, b - 0.3), (2.2, 2.5), (0.0, 0.19), row=awning, faces="fblr")
        for bay in range(first, last, 2):
            name = look.pick(("sign_bakery", "sign_pharmacy", "sign_books"))
            x = BAY_M * min(bay + 1.0, 0.5 * (bay + last))
            facades.box("trim", side, (x - 1.25, x + 1.25), (2.55, 2.91), (0.09, 0.12), row=name, faces="f", once=True)


def _flat_roof(
    facades: Facades, body: Body, look: RandomGenerator, half: tuple[float, float, float], top: float
) -> None:
    """Add a roof with felt, an edge beam with a metal coping, and one to three roof units."""
    hx, hy = half[0] + 0.3, half[1] + 0.3
    body.geom("box", (hx, hy, 0.25), material="roof_felt", pos=(0.0, 0.0, top + 0.25), part="roof")
    for side in sides_of(hx, hy):
        facades.band(side, (-0.01, side.length_m + 0.01), (top - 0.01, top + 0.51), 0.012, "cream", faces="fb")
        facades.box(
            "wall",
            side,
            (-0.04, side.length_m + 0.04),
            (top + 0.44, top + 0.56),
            (-0.25, 0.04),
            row="dark",
            faces="ftb",
        )
    for i in range(1 + look.index(3)):
        x, y = look.between(-0.7, 0.7) * half[0], look.between(-0.5, 0.5) * half[1]
        a, b, high = look.between(0.5, 1.4), look.between(0.5, 1.1), look.between(0.7, 1.9)
        z = top + 0.5
        for side in sides_of(a, b):
            moved = Side((side.origin[0] + x, side.origin[1] + y), side.along, side.length_m)
            if i == 0:
                facades.wall(moved, (0.0, side.length_m), (z, z + high))
            else:
                facades.box("wall", moved, (0.0, side.length_m), (z, z + high), (-b, 0.0), row="dark", faces="f")
        lid = Side((x - a, y - b), (1.0, 0.0), 2.0 * a)
        facades.box(
            "wall",
            lid,
            (-0.05, 2.0 * a + 0.05),
            (z + high, z + high + 0.08),
            (-2.0 * b - 0.05, 0.05),
            row="dark",
            faces="ftlr",
        )
        _proxy(body, (x - a, x + a), (y - b, y + b), (z, z + high + 0.08), f"unit_{i}")


def _block_roof(
    builder: MapBuilder, facades: Facades, body: Body, half: tuple[float, float, float], top: float
) -> None:
    """Add a tiled roof with its ridge along x."""
    rise, edge = 2.6, 0.15
    hx, hy = half[1] + 0.5, half[0] + 0.3
    name = f"blockroof_{round(200 * half[0])}_{round(200 * half[1])}"
    mesh = builder.mesh(name, extrude_xz([(-hx, 0.0), (hx, 0.0), (hx, edge), (0.0, rise), (-hx, edge)], hy))
    turned = yaw_quat(QUARTER_TURN_RAD)
    body.proxy("mesh", asset=mesh, material="proxy", pos=(0.0, 0.0, top), quat=turned, part="roof")
    facades.pitched_roof(Pitched(hy, half[1], hx, top + rise, top + edge, top, top), ridge_along_x=True)
    for number, side in enumerate(sides_of(half[0], half[1])):
        if number % 2 == 1:
            at_wall = edge + (rise - edge) * (1.0 - half[1] / hx) - 0.05
            wide = side.length_m
            facades.gable(side, [(0.0, top), (wide, top), (wide, top + at_wall), (0.0, top + at_wall)], top)
            _gable_peak(facades, side, top + at_wall, top + rise - 0.05)


def _gable_peak(facades: Facades, side: Side, low: float, high: float) -> None:
    """Add a triangle of wall from `low` up to the ridge, in two layers."""
    wide, middle = side.length_m, 0.5 * (low + high)
    facades.gable(side, [(0.0, low), (wide, low), (0.75 * wide, middle), (0.25 * wide, middle)], low)
    facades.gable(side, [(0.25 * wide, middle), (0.75 * wide, middle), (0.5 * wide, high)], middle)


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
    """Add a family house with the door towards +x of its heading and the ridge along y."""
    wall = rng.pick((2.9, 2.9, 5.4))
    rise = half_x_m * rng.between(0.62, 0.85)
    hx, hy = half_x_m, half_y_m
    material = rng.pick(("brick_red", "brick_brown", "white", "ochre", "blue"))
    body = builder.body("house", (x, y, 0.0), yaw_quat(heading_rad))
    look = _details(body, x, y)
    brick = material.startswith("brick")
    if not brick:
        material = "render_" + look.pick(
            {"white": ("white", "grey"), "ochre": ("sand", "cream", "rose"), "blue": ("blue", "green")}[material]
        )
    name = f"house_{round(hx * 100)}_{round(hy * 100)}_{round(wall * 10)}_{round(rise * 100)}"
    mesh = builder.mesh(name, gabled(hx, hy, wall, rise, tile_m=1.0))
    body.proxy("mesh", asset=mesh, material="proxy", part="walls")
    facades = Facades(_BRICK_WIDTH_M if brick else _RENDER_WIDTH_M)
    roof = rng.pick(("roof_tiles_mesh", "roof_tiles_mesh", "roof_slate"))
    _house_roof(facades, body, (hx, hy), wall, rise)
    stack_y = hy * rng.between(-0.5, 0.5)
    _chimney(facades, body, -0.35 * hx, stack_y, wall + rise)
    door_y = hy * rng.between(-0.35, 0.35)
    door = rng.pick(("door_green", "door_red", "door_blue"))
    body.geom("box", (0.02, 0.5, 1.05), pos=(hx - 0.12, door_y, 1.21), material=door, part="door", solid=False)
    body.geom("box", (0.5, 0.75, 0.08), pos=(hx + 0.5, door_y, 0.08), material="step_stone", part="step")
    _house_walls(facades, look, (hx, hy), wall, rise, door_y, shutters="" if look.chance(0.5) else door)
    facades.add_to(builder, body, {"wall": material, "trim": "trim", "glass": "window_glass", "roof": roof})


def _house_roof(facades: Facades, body: Body, half: tuple[float, float], wall: float, rise: float) -> None:
    """Add two slopes, turned about y by the pitch, with 0.35 m of eaves; solid as slabs."""
    hx, hy = half
    pitch = det_atan2(rise, hx)
    slope = sqrt(hx * hx + rise * rise)
    eaves = 0.35
    reach = 0.5 * (slope + eaves)
    for part, side in (("roof_front", 1.0), ("roof_back", -1.0)):
        cx = side * 0.5 * (hx + eaves * hx / slope)
        cz = wall + 0.5 * (rise - eaves * rise / slope) + 0.08
        tilt = pitch_quat(pitch)
        quat = tilt if side > 0 else product(yaw_quat(pi), tilt)
        body.proxy("box", (reach, hy + 0.3, 0.07), pos=(cx, 0.0, cz), quat=quat, material="proxy", part=part)
    # Heights of the slabs' upper and lower faces, by their distance from the ridge.
    thick = 0.07 * slope / hx
    ex = hx + eaves * hx / slope

    def height(distance: float, offset: float) -> float:
        return wall + rise * (1.0 - distance / hx) + 0.08 + offset

    facades.pitched_roof(
        Pitched(hy + 0.3, hx, ex, height(0.0, thick), height(ex, thick), height(ex, -thick), height(hx, -thick))
    )


def _chimney(facades: Facades, body: Body, x: float, y: float, z: float) -> None:
    """Add a stack of 0.6 x 0.6 m with a cap and two pots; `z`: its middle."""
    _proxy(body, (x - 0.3, x + 0.3), (y - 0.3, y + 0.3), (z - 0.9, z + 0.9), "chimney")
    for side in sides_of(0.3, 0.3):
        moved = Side((side.origin[0] + x, side.origin[1] + y), side.along, side.length_m)
        facades.wall(moved, (0.0, 0.6), (z - 0.9, z + 0.9))
    cap = Side((x - 0.3, y - 0.3), (1.0, 0.0), 0.6)
    facades.box("wall", cap, (-0.05, 0.65), (z + 0.82, z + 0.9), (-0.65, 0.05), row="plinth", faces="ftlr")
    for offset in (0.1, 0.36):
        for pot in sides_of(0.09, 0.09):
            moved = Side((pot.origin[0] + x - 0.3 + offset + 0.07, pot.origin[1] + y), pot.along, 0.18)
            facades.box("wall", moved, (0.0, 0.18), (z + 0.9, z + 1.08), (-0.18, 0.0), row="plinth", faces="ft")


def _house_walls(
    facades: Facades, look: RandomGenerator, half: tuple[float, float], wall: float, rise: float, door_y: float, *,
    shutters: str,
) -> None:  # fmt: skip
    """Add the four walls: windows at front and back, some in the gable walls, door, lintels, shutters, pipes."""
    hx, hy = half
    storeys = 1 if wall < 4.0 else 2
    sides = sides_of(hx, hy, 0.25 * look.index(12))
    stone = look.pick(("stone", "cream", "dark"))
    count = max(2, round(hy / 1.6))
    for number, side in enumerate(sides):
        for storey in range(storeys):
            floor, ceiling = (0.0, wall) if storeys == 1 else (2.7 * storey, 2.7 * (storey + 1))
            z = 1.55 + 2.6 * storey
            openings = []
            if number % 2 == 1:  # front and back
                front = number == 1
                for i in range(count):
                    y_w = -hy + 1.1 + i * (2.0 * hy - 2.2) / max(1, count - 1)
                    if (storey == 0 and abs(y_w - door_y) < 1.2) or not (front or i % 2 == 0):
                        continue
                    at = y_w + hy if front else hy - y_w
                    openings.append(Opening(at - 0.55, at + 0.55, z - 0.62, z + 0.62, 0.14))
                if front and storey == 0:
                    openings.append(Opening(door_y + hy - 0.5, door_y + hy + 0.5, 0.16, 2.26, 0.16, is_door=True))
                openings.sort(key=lambda opening: opening.x0)
            elif look.chance(0.6):
                at = hx + look.between(-0.3, 0.3) * hx
                openings.append(Opening(at - 0.45, at + 0.45, z - 0.62, z + 0.62, 0.14))
            facades.storey(side, (0.0, side.length_m), (floor, ceiling), openings)
            for opening in openings:
                if opening.is_door:
                    x0, x1 = opening.x0, opening.x1
                    facades.wall(side, (x0, x1), (0.16, 2.26), out=-0.16)
                    facades.box("wall", side, (x0 - 0.25, x1 + 0.25), (2.42, 2.50), (0.0, 0.2), row="dark")
                    facades.band(side, (x0 - 0.1, x0), (0.16, 2.36), 0.025, stone, faces="f")
                    facades.band(side, (x1, x1 + 0.1), (0.16, 2.36), 0.025, stone, faces="f")
                    facades.band(side, (x0 - 0.1, x1 + 0.1), (2.26, 2.36), 0.025, stone, faces="f")
                    continue
                facades.window(side, opening, look)
                facades.sill(side, (opening.x0, opening.x1), opening.z0, opening.depth_m, stone)
                facades.band(
                    side,
                    (opening.x0 - 0.12, opening.x1 + 0.12),
                    (opening.z1, opening.z1 + 0.16),
                    0.02,
                    stone,
                    faces="f",
                )
                if shutters and number == 1:
                    for x0 in (opening.x0 - 0.52, opening.x1 + 0.04):
                        facades.box(
                            "trim",
                            side,
                            (x0, x0 + 0.48),
                            (opening.z0, opening.z1),
                            (0.0, 0.045),
                            row=shutters,
                            faces="flr",
                        )
        if storeys == 2 and wall > 5.4:
            facades.wall(side, (0.0, side.length_m), (5.4, wall))
        if number % 2 == 0:  # gable walls
            _gable_peak(facades, side, wall, wall + rise)
        if number % 2 == 1:
            facades.downpipe(side, 0.2, wall - 0.05)
        facades.band(side, (-0.02, side.length_m + 0.02), (0.0, 0.16), 0.02, "plinth", faces="ft")
