"""Things along kerbs: rows of parked cars, and small objects on the pavement.

Rows: of the places along a kerb, 6.3 m each, as many are taken as asked for, in runs of one to four cars that stand
0.2 to 0.5 m from the kerb and a little askew. Objects: wheelie bins, traffic cones in threes, signs, cabinets and
bollards. Cars and objects have a generator each, so that another number of cars moves no object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import QUARTER_TURN_RAD, TURN_RAD
from sim.scene import surfaces
from sim.scene.maps.layout import Layout
from sim.scene.maps.map_builder import Body, MapBuilder, yaw_quat
from sim.scene.maps.meshes import Mesh, box_with_tiles, ellipse, revolve, ribbon, slab
from sim.scene.maps.vehicles.kinds import STREET_MIX, add_vehicle
from sim.scene.random_generator import RandomGenerator

PLACE_M = 6.3  # length of a place for a car
CAR_M, _ASKEW_RAD = 2.9, 0.03  # clear radius about the middle of a parked car
_HALF_CAR_M, _HALF_VAN_M = 1.15, 1.32  # from the middle to the mirrors, turned askew
_LONGEST_RUN = 4
_BIN_PAINTS = {
    "dark": (0.16, 0.18, 0.18), "green": (0.10, 0.27, 0.15), "brown": (0.30, 0.19, 0.11), "yellow": (0.80, 0.62, 0.10),
    "blue": (0.10, 0.22, 0.45),
}  # fmt: skip
_CONE_M = 0.52
_SIGN_M = 2.22  # height of a sign's middle
_FROM_KERB_M, _CLEAR_M = 0.32, 0.7
_PASS_M = 0.75  # from the middle of an object to the line that somebody walks on


@dataclass(frozen=True)
class Kerb:
    """Straight kerb with the street at its right, seen along `heading_rad` from (x, y); `top_m`: of its pavement."""

    x: float
    y: float
    heading_rad: float
    length_m: float
    top_m: float

    def at(self, along_m: float, left_m: float) -> tuple[float, float]:
        """Return the point `along_m` from the begin, `left_m` onto the pavement (negative: into the street)."""
        c, s = det_cos(self.heading_rad), det_sin(self.heading_rad)
        return self.x + along_m * c - left_m * s, self.y + along_m * s + left_m * c


def park_cars(builder: MapBuilder, rng: RandomGenerator, kerbs: Sequence[Kerb], road: Layout, count: int) -> int:
    """Park up to `count` cars in runs along the kerbs, where the road is free. Return their number."""
    places = [(kerb, k) for kerb in kerbs for k in range(int(kerb.length_m / PLACE_M))]
    parked = 0
    for kerb, first in rng.shuffled(places):
        run = 1 + rng.index(_LONGEST_RUN)
        for k in range(first, first + run):
            along, out = (k + 0.5) * PLACE_M + rng.between(-0.4, 0.4), rng.between(0.0, 0.25)
            turn, kind = rng.between(-_ASKEW_RAD, _ASKEW_RAD), rng.pick(STREET_MIX)
            out += _HALF_VAN_M if kind == "van" else _HALF_CAR_M
            x, y = kerb.at(along, -out)
            if parked == count or (k + 1) * PLACE_M > kerb.length_m or not road.free(x, y, CAR_M):
                break
            road.take_disc(x, y, CAR_M)
            # Traffic keeps right: cars at the right-hand kerb look against the kerb's direction.
            add_vehicle(builder, rng, kind, (x, y, kerb.heading_rad + 2.0 * QUARTER_TURN_RAD + turn))
            parked += 1
    return parked


def add_clutter(
    builder: MapBuilder, rng: RandomGenerator, kerbs: Sequence[Kerb], layout: Layout, count: int, *, ways: Layout
) -> None:
    """Add `count` groups of small objects on the pavements, where they are free and off the `ways` of people."""
    kinds: tuple[Callable[..., None], ...] = (_bins, _bins, _sign, _sign, _cabinet, _cones, _bollards)
    for _ in range(count):
        kerb, kind = rng.pick(kerbs), rng.pick(kinds)
        for _ in range(12):
            along = rng.between(1.5, kerb.length_m - 1.5)
            x, y = kerb.at(along, _FROM_KERB_M)
            if layout.free(x, y, _CLEAR_M) and ways.free(x, y, _PASS_M):
                layout.take_disc(x, y, _CLEAR_M)
                kind(builder, rng, (x, y, kerb.top_m), kerb.heading_rad)
                break


def _bins(builder: MapBuilder, rng: RandomGenerator, at: Vec3, heading_rad: float) -> None:
    """Add one or two wheelie bins of 120 litres, 0.94 m high, with their front to the street."""
    dark = builder.material("bin_wheel", surfaces.RUBBER, rgb=(0.10, 0.10, 0.10), specular=0.05, shininess=0.1)
    for k in range(1 + rng.index(2)):
        colour = rng.pick(tuple(_BIN_PAINTS))
        material = builder.material(
            f"bin_{colour}", surfaces.PLASTIC, rgb=_BIN_PAINTS[colour], specular=0.3, shininess=0.4
        )
        place = _along(at, heading_rad, 0.62 * (k - 0.5))
        body = builder.body("bin", place, yaw_quat(heading_rad + rng.between(-0.12, 0.12)))
        drawn: tuple[tuple[str, Callable[[], Mesh], str], ...] = (
            ("drum", _wheelie, material), ("wheels", _bin_wheels, dark),
        )  # fmt: skip
        _add_drawn(builder, body, "wheelie", drawn)
        body.proxy("box", (0.24, 0.27, 0.465), pos=(0.0, 0.0, 0.475), material=material, part="proxy")


def _sign(builder: MapBuilder, rng: RandomGenerator, at: Vec3, heading_rad: float) -> None:
    """Add a round or a square sign of 0.45 m on a post of 2.5 m, which looks along the street."""
    post = builder.material("sign_post", surfaces.METAL, rgb=(0.42, 0.44, 0.45), specular=0.4, shininess=0.4)
    blue = builder.material("sign_blue", surfaces.SIGN_SHEETING, rgb=(0.08, 0.24, 0.62), specular=0.2, shininess=0.3)
    red = builder.material("sign_red", surfaces.SIGN_SHEETING, rgb=(0.72, 0.08, 0.08), specular=0.2, shininess=0.3)
    white = builder.material("sign_white", surfaces.SIGN_SHEETING, rgb=(0.88, 0.88, 0.87), specular=0.2, shininess=0.3)
    body = builder.body("sign", at, yaw_quat(heading_rad + 2.0 * QUARTER_TURN_RAD * rng.index(2)))
    body.geom("cylinder", (0.03, 1.25), pos=(0.0, 0.0, 1.25), material=post, part="post")
    if rng.chance(0.5):
        _add_drawn(builder, body, "no_stopping", (("field", _disc, blue), ("mark", _ring_and_bar, red)))
    else:
        _add_drawn(builder, body, "parking", (("field", _plate, blue), ("mark", _letter_p, white)))


def _cabinet(builder: MapBuilder, rng: RandomGenerator, at: Vec3, heading_rad: float) -> None:
    """Add a cabinet of a telephone line, 0.9 x 0.35 x 1.2 m."""
    grey = builder.material("cabinet", surfaces.PLASTIC, rgb=(0.52, 0.54, 0.50), specular=0.2, shininess=0.3)
    body = _classed(builder, "cabinet", "furniture", at, heading_rad)
    high = rng.between(0.52, 0.62)
    body.geom("box", (0.45, 0.17, high), pos=(0.0, 0.0, high), material=grey, part="case")
    body.geom("box", (0.47, 0.19, 0.02), pos=(0.0, 0.0, 0.02 + 2.0 * high), material=grey, solid=False, part="cover")


def _cones(builder: MapBuilder, rng: RandomGenerator, at: Vec3, heading_rad: float) -> None:
    """Add three traffic cones of 0.52 m in a row."""
    orange = builder.material("cone_orange", surfaces.PLASTIC, rgb=(0.90, 0.28, 0.05), specular=0.2, shininess=0.3)
    white = builder.material("cone_white", surfaces.SIGN_SHEETING, rgb=(0.90, 0.90, 0.89), specular=0.1)
    for k in range(3):
        body = _classed(builder, "cone", "barrier", _along(at, heading_rad, 0.55 * (k - 1), rng.between(-0.12, 0.12)))
        _add_drawn(builder, body, "traffic_cone", (("cone", _cone, orange), ("band", _cone_band, white)))
        body.proxy("cylinder", (0.09, 0.5 * _CONE_M), pos=(0.0, 0.0, 0.5 * _CONE_M), material=orange, part="proxy")


def _bollards(builder: MapBuilder, rng: RandomGenerator, at: Vec3, heading_rad: float) -> None:
    """Add two bollards of 0.9 m with a white band."""
    dark = builder.material("bollard_dark", surfaces.PAINTED_METAL, rgb=(0.14, 0.15, 0.16), specular=0.4)
    white = builder.material("bollard_white", surfaces.SIGN_SHEETING, rgb=(0.88, 0.88, 0.87), specular=0.2)
    apart = rng.between(0.5, 0.65)
    for along in (-apart, apart):
        body = _classed(builder, "bollard", "pole", _along(at, heading_rad, along))
        body.geom("capsule", (0.055, 0.42), pos=(0.0, 0.0, 0.42), material=dark, part="post")
        body.geom("cylinder", (0.058, 0.05), pos=(0.0, 0.0, 0.70), material=white, solid=False, part="band")


def _classed(builder: MapBuilder, name: str, class_name: str, at: Vec3, heading_rad: float = 0.0) -> Body:
    """Add a body whose class has another name."""
    builder.classify(class_name, f"{name}_*")
    return builder.named_body(builder.next_name(name), at, yaw_quat(heading_rad))


def _along(at: Vec3, heading_rad: float, along_m: float, left_m: float = 0.0) -> Vec3:
    c, s = det_cos(heading_rad), det_sin(heading_rad)
    return at[0] + along_m * c - left_m * s, at[1] + along_m * s + left_m * c, at[2]


def _add_drawn(
    builder: MapBuilder, body: Body, name: str, parts: Sequence[tuple[str, Callable[[], Mesh], str]]
) -> None:
    for part, make, material in parts:
        asset = builder.mesh(f"{name}_{part}", make())
        body.geom("mesh", asset=asset, material=material, solid=False, part=part)


def _add_box(mesh: Mesh, middle: Vec3, half: Vec3) -> None:
    box = box_with_tiles(half, (1.0, 1.0))
    first = len(mesh.vertices)
    mesh.vertices += [(x + middle[0], y + middle[1], z + middle[2]) for x, y, z in box.vertices]
    mesh.uvs += box.uvs
    mesh.triangles += [(a + first, b + first, c + first) for a, b, c in box.triangles]


def _wheelie() -> Mesh:
    """Return a wheelie bin without its wheels: a drum that is wider at its top, lid and grip."""
    mesh = Mesh.empty()
    low = [(-0.18, -0.18), (0.18, -0.18), (0.18, 0.20), (-0.18, 0.20)]
    high = [(-0.24, -0.27), (0.24, -0.27), (0.24, 0.27), (-0.24, 0.27)]
    z0, z1 = 0.03, 0.91
    uvs = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    for i in range(4):
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]
        mesh.add_polygon([(ax, ay, z0), (bx, by, z0), (cx, cy, z1), (dx, dy, z1)], uvs)
    mesh.add_polygon([(x, y, z1) for x, y in high], uvs)
    mesh.add_polygon([(x, y, z0) for x, y in reversed(low)], uvs)
    _add_box(mesh, (0.0, 0.01, 0.93), (0.25, 0.29, 0.025))
    _add_box(mesh, (0.0, 0.31, 0.90), (0.22, 0.02, 0.02))
    return mesh


def _bin_wheels() -> Mesh:
    """Return the wheels of a wheelie bin, as prisms of twelve sides."""
    mesh = Mesh.empty()
    for x in (-0.22, 0.22):
        rim = [(0.22 + y, 0.10 + z) for y, z in ellipse(0.10, 0.10, 12)]
        for side in (-0.03, 0.03):
            ring = rim if side > 0.0 else rim[::-1]
            mesh.add_polygon([(x + side, y, z) for y, z in ring], ring)
        for (ay, az), (by, bz) in zip(rim, [*rim[1:], rim[0]], strict=True):
            face = [(x - 0.03, ay, az), (x - 0.03, by, bz), (x + 0.03, by, bz), (x + 0.03, ay, az)]
            mesh.add_polygon(face[::-1], [(0.0, 0.0)] * 4)
    return mesh


def _cone() -> Mesh:
    mesh = revolve([(0.15, 0.02), (0.025, _CONE_M)], 14)
    _add_box(mesh, (0.0, 0.0, 0.015), (0.18, 0.18, 0.015))
    return mesh


def _cone_band() -> Mesh:
    return revolve([(0.1135, 0.20), (0.0835, 0.32)], 14)


def _disc() -> Mesh:
    return _turned(slab(ellipse(0.19, 0.19, 20), 0.045, 0.057, tile_m=1.0))


def _plate() -> Mesh:
    mesh = Mesh.empty()
    _add_box(mesh, (0.045, 0.0, _SIGN_M), (0.006, 0.23, 0.23))
    return mesh


def _letter_p() -> Mesh:
    mesh = Mesh.empty()
    for y, z, half_y, half_z in (
        (-0.07, 0.0, 0.02, 0.15),
        (0.0, 0.13, 0.07, 0.02),
        (0.0, 0.0, 0.07, 0.02),
        (0.07, 0.065, 0.02, 0.085),
    ):
        _add_box(mesh, (0.053, y, _SIGN_M + z), (0.004, half_y, half_z))
    return mesh


def _ring_and_bar() -> Mesh:
    """Return the red of a no-stopping sign: a ring, and a bar from the upper left to the lower right."""
    mesh = _turned(ribbon(ellipse(0.205, 0.205, 20), 0.025, 0.044, 0.062, tile_m=1.0, closed=True))
    edge, half = 0.14, 0.016
    corners = [
        (-edge - half, edge - half),
        (-edge + half, edge + half),
        (edge + half, -edge + half),
        (edge - half, -edge - half),
    ]
    for x, order in ((0.064, corners[::-1]), (0.058, corners)):
        mesh.add_polygon([(x, y, _SIGN_M + z) for y, z in order], [(0.0, 0.0)] * 4)
    return mesh


def _turned(flat: Mesh) -> Mesh:
    """Return a mesh in the plane of x and y as one that looks along x, at the height of a sign."""
    return Mesh([(z, x, y + _SIGN_M) for x, y, z in flat.vertices], flat.uvs, flat.triangles)


def square_kerbs(half_m: float, margin_m: float, top_m: float, *, street_outside: bool) -> list[Kerb]:
    """Return the four kerbs of a square about the origin without `margin_m` at each end, counter-clockwise.

    `street_outside`: the pavement is inside, so the street is at the right; else kerbs run clockwise.
    """
    kerbs = []
    for quarter in range(4):
        heading = QUARTER_TURN_RAD * quarter
        c, s = det_cos(heading), det_sin(heading)
        along, across = (-half_m + margin_m, -half_m) if street_outside else (half_m - margin_m, -half_m)
        x, y = along * c - across * s, along * s + across * c
        turned = heading if street_outside else heading + TURN_RAD / 2
        kerbs.append(Kerb(x, y, turned, 2.0 * (half_m - margin_m), top_m))
    return kerbs
