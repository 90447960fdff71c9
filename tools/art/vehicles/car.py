"""Cars and vans: meshes by material, and their shapes for contact."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

from signals.samples import Vec3
from sim.scene.maps.meshes import Mesh
from tools.art.vehicles.body_shape import Greenhouse, LowerBody, arch_points, skin_patch
from tools.art.vehicles.car_shape import CarShape
from tools.art.vehicles.driver import add_cabin
from tools.art.vehicles.lofts import add_box, add_ellipsoid, add_sheet, add_tube, mix
from tools.art.vehicles.parts import BEAD, MATERIALS, Parts, Proxy, add_plate, axle_proxies
from tools.art.vehicles.wheels import add_wheel

_TYRE_M = 0.21  # width
_VAN_M = 1.9  # cars are lower


def car_parts(shape: CarShape, *, spokes: int = 5, driver: bool = False, wheels: bool = True) -> Parts:
    """Return the meshes by material. With a driver the front side windows are open."""
    parts = {name: Mesh.empty() for name in (*MATERIALS, BEAD)}
    body = LowerBody(shape)
    cabin = Greenhouse(shape, body)
    body.add_to(parts["paint"])
    cabin.add_to(parts["paint"], open_front=driver)
    cabin.add_panes(parts["glass"], parts["trim"], open_front=driver)
    _add_underside(parts["trim"], body)
    for x, y, z in wheel_centres(shape) if wheels else ():
        side = 1.0 if y > 0.0 else -1.0
        add_wheel(parts["tyre"], parts["rim"], (x, y, z), shape.wheel_m, _TYRE_M, spokes, side)
    _add_face(parts, body)
    _add_rear(parts, body)
    _add_seams(parts, body)
    _add_lids(parts["trim"], body)
    _add_roof(parts, cabin)
    if shape.height_m > _VAN_M:
        _add_van_sides(parts["trim"], body)
        _add_van_panels(parts, body, cabin)
    _add_mirrors(parts, body, shape)
    if shape.rails:
        _add_rails(parts["trim"], shape)
    if driver:
        add_cabin(parts, shape, body)
    return parts


def wheel_centres(shape: CarShape) -> list[Vec3]:
    """Return the middles of the wheels' outer faces: front left, front right, rear left, rear right."""
    y = 0.5 * shape.width_m - 0.035
    return [(x, side * y, shape.wheel_m) for x in shape.wheels_x_m for side in (1.0, -1.0)]


@cache
def wheel_parts(shape: CarShape, spokes: int, side: float) -> Parts:
    """Return tyre and rim of one wheel of the left (`side` 1) or right side, about the middle of its outer face."""
    parts = {"tyre": Mesh.empty(), "rim": Mesh.empty()}
    add_wheel(parts["tyre"], parts["rim"], (0.0, 0.0, 0.0), shape.wheel_m, _TYRE_M, spokes, side)
    return parts


def _mirrored(mesh: Mesh, rows: list[list[tuple[float, float, float]]]) -> None:
    """Add a sheet of the left side, whose columns run from front to rear, and its mirror image."""
    add_sheet(mesh, rows)
    add_sheet(mesh, [[(x, -y, z) for x, y, z in row] for row in rows], flipped=True)


def _add_underside(trim: Mesh, body: LowerBody) -> None:
    """Add the floor, the insides of the arches and the lips round them."""
    s = body.shape
    half_w = 0.5 * s.width_m
    add_box(
        trim, (-0.5 * s.length_m + 0.25, -half_w + 0.14, s.clearance_m - 0.05),
        (0.5 * s.length_m - 0.30, half_w - 0.14, s.clearance_m + 0.02),
    )  # fmt: skip
    for x in s.wheels_x_m:
        # A dark box between the wheels closes the view through the arches.
        r = body.arch_m()
        add_box(trim, (x - r, -half_w + 0.28, 0.6 * s.clearance_m), (x + r, half_w - 0.28, s.wheel_m + r - 0.02))
        inner = arch_points(body, x, r - 0.012)
        outer = arch_points(body, x, r + (0.06 if s.cladding else 0.0))
        for side in (1.0, -1.0):
            # Inside of the arch, seen from below.
            rows = [[(px, side * (half_w - depth), pz) for px, pz in inner] for depth in (0.012, 0.29)]
            add_sheet(trim, rows, flipped=side < 0)
            # The lip follows the skin.
            edge = [body.point(body.at_x(px), pz, 0.006) for px, pz in outer]
            lip = [
                [(px, side * half_w - side * 0.012, pz) for px, pz in inner],
                [(p[0], side * p[1], p[2]) for p in edge],
            ]
            if s.cladding:
                add_sheet(trim, lip, flipped=side < 0)
    if s.cladding:
        front, rear = s.wheels_x_m
        reach = body.arch_m() + 0.06
        stations = [body.at_x(mix(front - reach, rear + reach, k / 3)) for k in range(4)]
        low, high = [s.clearance_m + 0.005] * 4, [s.clearance_m + 0.13] * 4
        _mirrored(trim, skin_patch(body, stations, low, high, 0.006))


def _add_face(parts: Parts, body: LowerBody) -> None:
    """Add grille, intake, head lamps, fog lamps and the front plate."""
    s = body.shape
    low, high, half = s.grille
    ys = [0.0, 0.4 * half, 0.8 * half, half]
    stations = [body.front_at_y(y) for y in ys]
    _mirrored(parts["trim"], skin_patch(body, stations, [low, low, low, low + 0.02], [high] * 4, 0.008, 3))
    for share in (0.12, 0.5, 0.88):  # bars of the grille
        z = mix(low, high, share)
        _mirrored(parts["rim"], skin_patch(body, stations[:3], [z - 0.008] * 3, [z + 0.008] * 3, 0.016))
    # Intake below the bumper.
    z0, z1 = s.clearance_m + 0.07, s.clearance_m + 0.18
    wide = [body.front_at_y(y) for y in (0.0, 0.25, 0.5, 0.62)]
    _mirrored(parts["trim"], skin_patch(body, wide, [z0] * 4, [z1, z1, z1, z1 - 0.03], 0.03, 4))
    lower, upper, inner = s.lamp_front
    begin = body.front_at_y(inner)
    end = body.at_x(0.5 * s.length_m - 0.05 - 0.72 * s.corner_front[0])
    for name, out, shrink in (("trim", 0.006, 0.0), ("head_lamp", 0.012, 0.014)):
        columns = [mix(begin, end, k / 5) for k in range(6)]
        lows = [mix(lower, upper - 0.05, (k / 5) * (k / 5)) + shrink for k in range(6)]
        highs = [mix(upper - 0.02, upper + 0.03, k / 5) - shrink for k in range(6)]
        if shrink:
            columns[0], columns[-1] = mix(begin, end, 0.04), mix(begin, end, 0.95)
        _mirrored(parts[name], skin_patch(body, columns, lows, highs, out, 3))
    # Two round lenses within each lamp, dark glass in a bright ring; the outer one stands higher, as the lamp does.
    mid, reach = 0.5 * (lower + upper) - 0.008, 0.36 * (upper - lower)
    for share, rise in ((0.24, 0.0), (0.56, 0.016)):
        middle, half = mix(begin, end, share), 0.13 * (end - begin)
        for name, out, size in (("rim", 0.016, 1.0), ("glass", 0.019, 0.76)):
            across = [middle + size * half * t for t in (-1.0, -0.6, 0.6, 1.0)]
            tall = [size * reach * t for t in (0.35, 0.9, 0.9, 0.35)]
            lows, highs = [mid + rise - z for z in tall], [mid + rise + z for z in tall]
            _mirrored(parts[name], skin_patch(body, across, lows, highs, out))
    fog = [body.front_at_y(y) for y in (0.66, 0.74)]
    _mirrored(parts["head_lamp"], skin_patch(body, fog, [z0 + 0.03] * 2, [z0 + 0.10] * 2, 0.018, 3))
    add_plate(parts["plate"], body.point(0.0, mix(z1, low, 0.5), 0.02), 1.0)


def _add_rear(parts: Parts, body: LowerBody) -> None:
    """Add tail lamps, plate and the dark lower edge of the bumper."""
    s = body.shape
    lower, upper, inner = s.lamp_rear
    begin = body.at_x(-0.5 * s.length_m + 0.05 + (0.45 if s.tall_lamps else 0.6) * s.corner_rear[0])
    end = body.rear_at_y(inner)
    # Each lamp in a dark frame, so that red lamps show on red paint.
    for name, out, rim in (("trim", 0.006, 0.014), ("tail_lamp", 0.012, 0.0)):
        columns = [mix(begin, end, (k / 4 - 0.5) * (1.0 + 4.0 * rim) + 0.5) for k in range(5)]
        lows = [lower + 0.03 - rim, *([lower - rim] * 3), lower + 0.02 - rim]
        _mirrored(parts[name], skin_patch(body, columns, lows, [upper + rim] * 5, out, 3))
    white = [mix(begin, end, t) for t in (0.55, 0.85)]
    _mirrored(parts["head_lamp"], skin_patch(body, white, [lower + 0.02] * 2, [lower + 0.055] * 2, 0.016))
    z0, z1 = s.clearance_m + 0.01, s.clearance_m + 0.13
    dark = [body.rear_at_y(y) for y in (0.66, 0.4, 0.0)]
    _mirrored(parts["trim"], skin_patch(body, dark, [z0] * 3, [z1] * 3, 0.012, 4))
    niche = [body.rear_at_y(y) for y in (0.33, 0.0)]
    z = s.plate_rear_m
    _mirrored(parts["trim"], skin_patch(body, niche, [z - 0.085] * 2, [z + 0.085] * 2, 0.005))
    last = len(body.stations) - 1.0
    add_plate(parts["plate"], body.point(last, z, 0.015), -1.0)
    # Seam between bumper and boot lid.
    seam = [body.rear_at_y(y) for y in (0.74, 0.4, 0.0)]
    z = mix(s.clearance_m, body.shoulder_m(-0.5 * s.length_m), 0.50)
    _mirrored(parts["trim"], skin_patch(body, seam, [z - 0.005] * 3, [z + 0.005] * 3, 0.004))


def _add_seams(parts: Parts, body: LowerBody) -> None:
    """Add the gaps round doors and bonnet, and the door handles."""
    s = body.shape
    half = 0.006
    bottom = s.clearance_m + 0.10
    for x in s.doors_x_m:
        top = body.shoulder_m(x) - 0.03
        stations = [body.at_x(x + half), body.at_x(x - half)]
        low = max(bottom, body.low_m(x) + 0.02)
        _mirrored(parts["trim"], skin_patch(body, stations, [low] * 2, [top] * 2, 0.004, 6))
    front, rear = s.doors_x_m[0], s.doors_x_m[-1]
    count = 6
    stations = [body.at_x(mix(front, rear, k / (count - 1))) for k in range(count)]
    lows = [max(bottom, body.low_m(mix(front, rear, k / (count - 1))) + 0.02) for k in range(count)]
    _mirrored(parts["trim"], skin_patch(body, stations, [z - half for z in lows], [z + half for z in lows], 0.004))
    for x in s.doors_x_m[1:]:
        z = body.shoulder_m(x) - 0.14
        p = body.point(body.at_x(x + 0.17), z, 0.0)
        for side in (1.0, -1.0):
            add_box(
                parts["trim"], (p[0] - 0.09, min(side * (p[1] + 0.028), side * p[1]), z - 0.014),
                (p[0] + 0.09, max(side * (p[1] + 0.028), side * p[1]), z + 0.014),
            )  # fmt: skip


def _add_lids(trim: Mesh, body: LowerBody) -> None:
    """Add the gaps beside and before the bonnet, and those of a boot lid if the car has one."""
    s = body.shape
    cowl, nose = s.columns[3].base[0] + 0.10, 0.5 * s.length_m - 0.05 - 0.62 * s.corner_front[0]
    xs = [mix(cowl, nose, k / 4) for k in range(5)]
    for side in (1.0, -1.0):
        edges = (side * 0.83, side * 0.845)
        rows = [[body.lid_point(x, share, 0.004) for x in xs] for share in edges]
        add_sheet(trim, rows, flipped=side > 0)
    ends = [(nose, nose - 0.012)]
    tail = s.columns[-1].base[0]
    if tail + 0.5 * s.length_m > 0.35:
        ends.append((tail - 0.06, tail - 0.072))
    for front, rear in ends:
        shares = [-0.83, -0.4, 0.0, 0.4, 0.83]
        add_sheet(trim, [[body.lid_point(x, share, 0.004) for share in shares] for x in (front, rear)], flipped=True)


def _add_roof(parts: Parts, cabin: Greenhouse) -> None:
    """Add the gaps along the roof's edges, the beads of a van's roof, wipers and an aerial."""
    trim = parts["trim"]
    s = cabin.shape
    first, last = s.roof[-1][0] - 0.06, s.roof[0][0] + 0.04
    xs = cabin.roof_line_m(first, last)
    lines = [("trim", 0.90, 0.935, 0.014), ("trim", -0.935, -0.90, 0.014)]
    if s.height_m > _VAN_M:
        lines += [(BEAD, share - 0.03, share + 0.03, 0.010) for share in (-0.6, -0.2, 0.2, 0.6)]
    for name, low, high, out in lines:
        rows = [[cabin.roof_point(x, share, out) for x in xs] for share in (low, high)]
        add_sheet(parts[name], rows, flipped=True)
    for begin, end in ((-0.1, -1.25), (0.85, -0.15)):
        line = []
        for k in range(3):
            column = mix(begin, end, k / 2)
            x, y, z = cabin.point(min(abs(column), 1.8), 0.075 + 0.03 * k, 0.02)
            line.append((x, y if column < 0.0 else -y, z))
        add_tube(trim, line, 0.009, 4)
    x = s.roof[0][0] + 0.18
    add_tube(trim, [cabin.roof_point(x, 0.0, -0.01), (x - 0.07, 0.0, s.height_m + 0.03)], (0.02, 0.008), 4)


def _add_van_sides(trim: Mesh, body: LowerBody) -> None:
    """Add the rubbing strips and the rail of the sliding door."""
    s = body.shape
    front, rear = s.wheels_x_m
    reach = body.arch_m() + 0.03
    for begin, end, low, high in (
        (front - reach, rear + reach, s.clearance_m + 0.30, s.clearance_m + 0.40),
        (-0.2, rear - 0.9, 0.86 * s.shoulder[1][1], 0.86 * s.shoulder[1][1] + 0.035),
    ):
        stations = [body.at_x(mix(begin, end, k / 6)) for k in range(7)]
        _mirrored(trim, skin_patch(body, stations, [low] * 7, [high] * 7, 0.010))


def _add_van_panels(parts: Parts, body: LowerBody, cabin: Greenhouse) -> None:
    """Add the gaps of sliding and rear doors above the shoulder, and the panels pressed into the sides."""
    heights = [mix(0.02, 0.90, k / 3) for k in range(4)]
    columns = cabin.shape.columns

    def column_at(x: float) -> float:
        for i in range(4, len(columns) - 2):
            before, after = columns[i].base[0], columns[i + 1].base[0]
            if after <= x <= before:
                return i + (before - x) / (before - after)
        raise ValueError(f"no column of the van at x = {x}")

    def strip(mesh: Mesh, xs: list[float], shares: list[float]) -> None:
        _mirrored(mesh, [[cabin.point(column_at(x), share, 0.010) for x in xs] for share in shares])

    doors = cabin.shape.doors_x_m[1:]
    for x in doors:
        strip(parts["trim"], [x + 0.006, x - 0.006], heights)
    rear = cabin.shape.wheels_x_m[1] - 0.86
    edges = [*doors, rear]
    for front, back in pairwise(edges):
        ends = [mix(front - 0.07, back + 0.07, k / 2) for k in range(3)]
        for share in (0.12, 0.80):
            strip(parts[BEAD], ends, [share, share + 0.03])
        for x in (ends[0], ends[-1] + 0.03):
            strip(parts[BEAD], [x, x - 0.03], [0.15, 0.80])
    last = len(columns) - 1.0
    half = 0.007 / (columns[-2].base[1] * cabin.shape.half_base_m)  # of the last column, which ends in the middle
    _mirrored(parts["trim"], [[cabin.point(c, share, 0.010) for c in (last - half, last)] for share in heights])
    low, high = cabin.shape.clearance_m + 0.35, body.shoulder_m(-0.5 * cabin.shape.length_m)
    middle = [body.rear_at_y(y) for y in (0.007, 0.0)]
    _mirrored(parts["trim"], skin_patch(body, middle, [low] * 2, [high] * 2, 0.006, 5))


def _add_mirrors(parts: Parts, body: LowerBody, shape: CarShape) -> None:
    x = shape.columns[3].base[0] - 0.16
    z = body.shoulder_m(x) + 0.07
    for side in (1.0, -1.0):
        y = side * (shape.half_base_m + 0.13)
        add_ellipsoid(parts["paint"], (x, y, z), (0.075, 0.115, 0.075), rings=5, sides=8)
        rows = [[(x - 0.072, y + side * dy, z + dz) for dy in (-0.085, 0.085)] for dz in (-0.05, 0.05)]
        add_sheet(parts["trim"], rows, flipped=side > 0)
        add_tube(parts["trim"], [(x, side * (shape.half_base_m - 0.06), z - 0.07), (x, y, z - 0.03)], 0.02, 5)


def _add_rails(trim: Mesh, shape: CarShape) -> None:
    first, last = shape.roof[-1][0] - 0.25, shape.roof[0][0] + 0.15
    top = shape.height_m - 0.005
    for side in (1.0, -1.0):
        y = side * (shape.half_roof_m - 0.10)
        add_tube(
            trim, [(first, y, top - 0.07), (first - 0.1, y, top), (last + 0.1, y, top), (last, y, top - 0.08)], 0.016, 5
        )


def car_proxies(shape: CarShape) -> list[Proxy]:
    body = LowerBody(shape)
    half_width = wheel_centres(shape)[0][1]
    return [
        Proxy("hull", hull=body.hull()),
        Proxy("hull", hull=Greenhouse(shape, body).hull()),
        *axle_proxies(shape.wheels_x_m, shape.wheel_m, half_width, 0.105),
    ]
