"""Walls with real openings, solid as boxes and drawn as one mesh per building.

A wall is horizontal bands (below, between and above the rows of windows) and, in each row, the piers between its
windows: storeys + 1 bands and storeys * (windows + 1) piers. Each box has its local x along the wall, y up and z
across. The boxes are not drawn; the meshes lie on their faces, with sills and lintels up to 6 cm before them, frames in
some openings, spalled plaster and chips of rubble at the foot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from signals._kernel import det_cos, det_sin
from signals.rotation import product
from signals.samples import Vec3
from signals.units import QUARTER_TURN_RAD
from sim.scene.maps.map_builder import Body, MapBuilder, roll_quat, yaw_quat
from sim.scene.maps.meshes import Mesh, Vec2
from sim.scene.random_generator import RandomGenerator

_UPRIGHT = roll_quat(QUARTER_TURN_RAD)


@dataclass(frozen=True)
class Openings:
    """Windows of one wall in rows, with an optional door."""

    rows: tuple[tuple[float, float], ...]  # sill and head of each row, upwards [m]
    count: int  # windows in a row
    width_m: float
    door: int = -1  # this window of the lowest row reaches down to the ground; -1: none


@dataclass(frozen=True)
class WallSize:
    """Size of a wall [m]."""

    length_m: float
    height_m: float
    thickness_m: float


@dataclass
class Looks:
    """Meshes of a building's walls under construction, and the generator of their details."""

    rng: RandomGenerator
    tile_m: float  # period of the texture of the walls
    spalls: bool  # plaster that has come off in places
    wall: Mesh = field(default_factory=Mesh.empty)
    slab: Mesh = field(default_factory=Mesh.empty)
    frame: Mesh = field(default_factory=Mesh.empty)
    spall: Mesh = field(default_factory=Mesh.empty)


@dataclass(frozen=True)
class Shell:
    """A building's outer walls, floor slabs and roof, about the origin of its body."""

    half_x_m: float
    half_y_m: float
    height_m: float
    thickness_m: float
    floors_m: Sequence[float] = ()  # heights of the slabs inside


def add_wall(
    body: Body,
    start: tuple[float, float],
    heading_rad: float,
    size: WallSize,
    openings: Openings,
    looks: Looks,
    *,
    outward: float,
    part: str,
) -> None:
    """Add a wall from `start` along `heading_rad`, its middle plane on that line.

    `outward`: 1 if the outer face is at the right of that direction, -1 if at the left.
    """
    length_m, height_m, thickness_m = size.length_m, size.height_m, size.thickness_m
    quat = product(yaw_quat(heading_rad), _UPRIGHT)
    c, s = det_cos(heading_rad), det_sin(heading_rad)
    serial = 0

    def at(x: float, z: float, across: float) -> tuple[float, float, float]:
        return (start[0] + x * c + across * s, start[1] + x * s - across * c, z)

    def face(mesh: Mesh, corners: Sequence[tuple[float, float, float]], uvs: Sequence[Vec2]) -> None:
        mesh.add_polygon([at(*corner) for corner in corners], uvs)

    def front(mesh: Mesh, x: Vec2, z: Vec2, across: float, tile_m: float) -> None:
        (a, b), (low, high) = x, z
        corners = [(a, low, across), (b, low, across), (b, high, across), (a, high, across)]
        face(mesh, corners, [(p / tile_m, q / tile_m) for p, q, _ in corners])

    half = 0.5 * thickness_m

    def box(a: float, b: float, low: float, high: float) -> None:
        nonlocal serial
        if b - a < 0.02 or high - low < 0.02:
            return
        for across in (-half, half):
            front(looks.wall, (a, b), (low, high), across, looks.tile_m)
        middle = 0.5 * (a + b)
        pos = (start[0] + middle * c, start[1] + middle * s, 0.5 * (low + high))
        size = (0.5 * (b - a), 0.5 * (high - low), 0.5 * thickness_m)
        body.proxy("box", size, pos=pos, quat=quat, material="slab", part=f"{part}_{serial}")
        serial += 1

    holes = _holes(length_m, openings)
    below = 0.0
    for row, (sill, head) in enumerate(openings.rows if holes else ()):
        if row == 0 and 0 <= openings.door < len(holes):
            a, b = holes[openings.door]
            box(0.0, a, 0.0, sill)
            box(b, length_m, 0.0, sill)
        else:
            box(0.0, length_m, below, sill)
        edge = 0.0
        for a, b in holes:
            box(edge, a, sill, head)
            edge = b
        box(edge, length_m, sill, head)
        below = head
    box(0.0, length_m, below, height_m)
    for x in (0.0, length_m):
        corners = [(x, 0.0, -half), (x, 0.0, half), (x, height_m, half), (x, height_m, -half)]
        face(looks.wall, corners, [(p / looks.tile_m, q / looks.tile_m) for _, q, p in corners])
    for row, (sill, head) in enumerate(openings.rows if holes else ()):
        for number, (a, b) in enumerate(holes):
            low = 0.0 if row == 0 and number == openings.door else sill
            _reveal(looks, face, (a, b), (low, head), half)
            _trim(looks, face, front, (a, b), (low, head), half, outward)
    if looks.spalls:
        for _ in range(int(length_m / 3.5)):
            _spall(looks, face, length_m, height_m, holes, openings, outward * (half + 0.004))
    for _ in range(int(length_m / 4.0)):
        _chip(looks, at, looks.rng.between(0.3, length_m - 0.3), outward * (half + looks.rng.between(0.08, 0.4)))


Face = Callable[[Mesh, Sequence[tuple[float, float, float]], Sequence[Vec2]], None]
Front = Callable[[Mesh, Vec2, Vec2, float, float], None]
_UNIT = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


def _reveal(looks: Looks, face: Face, x: Vec2, z: Vec2, half: float) -> None:
    """Add the four sides of an opening."""
    (a, b), (low, high), tile = x, z, looks.tile_m
    for at_x in (a, b):
        corners = [(at_x, low, -half), (at_x, low, half), (at_x, high, half), (at_x, high, -half)]
        face(looks.wall, corners, [(p / tile, q / tile) for _, q, p in corners])
    for at_z in (low, high):
        corners = [(a, at_z, -half), (b, at_z, -half), (b, at_z, half), (a, at_z, half)]
        face(looks.wall, corners, [(p / tile, q / tile) for p, _, q in corners])


def _trim(looks: Looks, face: Face, front: Front, x: Vec2, z: Vec2, half: float, outward: float) -> None:
    """Add a lintel, a sill, and in some openings what is left of a frame."""
    (a, b), (low, high), out = x, z, outward * half
    front(looks.slab, (a - 0.15, b + 0.15), (high, high + 0.18), out + 0.006 * outward, 1.0)
    if low > 0.0:
        edge = out + 0.06 * outward
        front(looks.slab, (a - 0.06, b + 0.06), (low - 0.08, low + 0.005), edge, 1.0)
        top = low + 0.005
        corners = [(a - 0.06, top, out), (b + 0.06, top, out), (b + 0.06, top, edge), (a - 0.06, top, edge)]
        face(looks.slab, corners, _UNIT)
    if looks.rng.chance(0.4):
        w, across = 0.06, 0.3 * out
        front(looks.frame, (a, a + w), (low, high), across, 0.8)
        front(looks.frame, (b - w, b), (low, high), across, 0.8)
        front(looks.frame, (a + w, b - w), (high - w, high), across, 0.8)
        if low > 0.0 and looks.rng.chance(0.5):
            front(looks.frame, (a + w, b - w), (low, low + w), across, 0.8)


def _spall(
    looks: Looks, face: Face, length_m: float, height_m: float, holes: Sequence[Vec2], openings: Openings, across: float
) -> None:
    """Add a place where the plaster has come off, clear of the openings."""
    size = looks.rng.between(0.35, 0.9)
    x, z = looks.rng.between(size, length_m - size), looks.rng.between(0.3, height_m - 0.3 - size)
    for low, high in openings.rows:
        for a, b in holes:
            if a - size < x < b + size and low - size < z < high + size:
                return
    bottom = max(z - size, 0.02)
    corners = [
        (x - size, bottom, across),
        (x + size, bottom, across),
        (x + size, z + size, across),
        (x - size, z + size, across),
    ]
    face(looks.spall, corners, _UNIT)


def _chip(looks: Looks, at: Callable[[float, float, float], Vec3], x: float, across: float) -> None:
    """Add a chip of rubble at the foot of a wall: a pyramid of at most 0.15 m."""
    size, high = looks.rng.between(0.05, 0.16), looks.rng.between(0.04, 0.15)
    base = [
        (x - size, across - size),
        (x + size, across - 0.7 * size),
        (x + 0.8 * size, across + size),
        (x - 0.9 * size, across + 0.8 * size),
    ]
    tip = at(x + 0.3 * size, high, across)
    for i in range(4):
        (x0, y0), (x1, y1) = base[i], base[(i + 1) % 4]
        looks.slab.add_polygon([at(x0, 0.0, y0), at(x1, 0.0, y1), tip], _UNIT[:3])


def _holes(length_m: float, openings: Openings) -> list[tuple[float, float]]:
    """Return begin and end of each window of a row, evenly spaced, with piers of at least 0.6 m."""
    count = min(openings.count, int((length_m - 0.6) / (openings.width_m + 0.6)))
    if count <= 0:
        return []
    pitch = length_m / count
    return [(pitch * (i + 0.5) - openings.width_m / 2, pitch * (i + 0.5) + openings.width_m / 2) for i in range(count)]


def add_shell(
    builder: MapBuilder,
    body: Body,
    shell: Shell,
    sides: Sequence[Openings],
    looks: Looks,
    *,
    material: str,
    slab_material: str,
) -> None:
    """Add four walls (`sides`: -y, +x, +y, -x), the floor slabs inside, and a roof."""
    x, y, t, height_m = shell.half_x_m, shell.half_y_m, shell.thickness_m, shell.height_m
    quarter = QUARTER_TURN_RAD
    # The walls along x include the corners.
    along_x, along_y = WallSize(2 * x, height_m, t), WallSize(2 * (y - t), height_m, t)
    add_wall(body, (-x, -y + t / 2), 0.0, along_x, sides[0], looks, outward=1.0, part="south")
    add_wall(body, (x - t / 2, -y + t), quarter, along_y, sides[1], looks, outward=1.0, part="east")
    add_wall(body, (-x, y - t / 2), 0.0, along_x, sides[2], looks, outward=-1.0, part="north")
    add_wall(body, (-x + t / 2, -y + t), quarter, along_y, sides[3], looks, outward=-1.0, part="west")
    for i, level in enumerate(shell.floors_m):
        body.geom("box", (x - t, y - t, 0.1), pos=(0.0, 0.0, level), material=slab_material, part=f"floor_{i}")
    body.geom("box", (x + 0.15, y + 0.15, 0.12), pos=(0.0, 0.0, height_m + 0.12), material=slab_material, part="roof")
    for name, mesh, drawn in (
        ("walls", looks.wall, f"{material}_mesh"),
        ("trim", looks.slab, "slab"),
        ("frames", looks.frame, "frame_wood"),
        ("spalls", looks.spall, "spall"),
    ):
        if mesh.triangles:
            asset = builder.mesh(f"{body.name}_{name}", mesh)
            body.geom("mesh", asset=asset, material=drawn, solid=False, part=f"shown_{name}")
