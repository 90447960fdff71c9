"""Numbers that describe the shape of a car or van, and those of the kinds.

x forward from the middle of the length, y left, z up from the ground; lengths in metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.scene.maps.meshes import Vec2

Knots = tuple[Vec2, ...]


@dataclass(frozen=True)
class Column:
    """Line up the greenhouse: (x, y) at its base and at the roof, y as a share of the half width there.

    `pane`: the material from this column to the next one, "" for the body's paint.
    """

    base: Vec2
    roof: Vec2
    pane: str = ""


@dataclass(frozen=True)
class CarShape:
    """Shape of a car."""

    length_m: float
    width_m: float
    height_m: float
    wheels_x_m: Vec2  # front and rear axle
    wheel_m: float  # radius
    clearance_m: float
    shoulder: Knots  # (x, z) of the edge of bonnet, side windows and boot, from the rear
    front: Knots  # (share of the height up to the shoulder, distance behind the foremost outline)
    rear: Knots
    side: Knots
    corner_front: Vec2  # half axes of the rounded corners, seen from above
    corner_rear: Vec2
    columns: tuple[Column, ...]  # from the middle of the windscreen round the left side to the middle of the rear
    half_base_m: float  # half width of the greenhouse at its base
    half_roof_m: float
    roof: Knots  # (x, z) of the edge of the roof, from the rear
    lamp_front: tuple[float, float, float]  # lower and upper edge [m], y where it begins
    lamp_rear: tuple[float, float, float]
    grille: tuple[float, float, float]  # lower and upper edge [m], half width
    plate_rear_m: float  # height of the middle of the rear plate
    doors_x_m: tuple[float, ...]  # seams of the doors
    cladding: bool = False  # dark sills and arches
    rails: bool = False
    tall_lamps: bool = False  # tail lamps stand upright at the corners


_SIDE: Knots = (
    (0.0, 0.045),
    (0.10, 0.02),
    (0.38, 0.0),
    (0.60, 0.004),
    (0.66, 0.014),
    (0.90, 0.035),
    (0.97, 0.055),
    (1.0, 0.085),
)


def _sedan() -> CarShape:
    return CarShape(
        4.6, 1.82, 1.45, (1.42, -1.28), 0.32, 0.19,
        ((-2.3, 0.99), (-2.1, 1.04), (-1.7, 1.02), (0.4, 0.955), (1.05, 0.93), (2.0, 0.78), (2.3, 0.70)),
        ((0.0, 0.13), (0.16, 0.03), (0.32, 0.0), (0.52, 0.012), (0.70, 0.04), (0.88, 0.10), (1.0, 0.20)),
        ((0.0, 0.12), (0.16, 0.03), (0.42, 0.0), (0.55, 0.02), (0.85, 0.05), (0.95, 0.07), (1.0, 0.11)),
        _SIDE, (0.37, 0.50), (0.42, 0.42),
        (
            Column((1.20, 0.0), (0.28, 0.0), "glass"), Column((1.14, 0.50), (0.25, 0.52), "glass"),
            Column((1.02, 0.90), (0.16, 0.92)), Column((0.98, 0.97), (0.10, 1.0)),
            Column((0.80, 1.0), (0.02, 1.0), "glass"), Column((0.02, 1.0), (-0.10, 1.0)),
            Column((-0.10, 1.0), (-0.18, 1.0), "glass"), Column((-0.98, 1.0), (-0.84, 1.0)),
            Column((-1.04, 1.0), (-0.89, 1.0), "glass"), Column((-1.32, 1.0), (-0.98, 1.0)),
            Column((-1.62, 0.98), (-1.08, 1.0)), Column((-1.70, 0.88), (-1.13, 0.90), "glass"),
            Column((-1.78, 0.45), (-1.18, 0.47), "glass"), Column((-1.80, 0.0), (-1.19, 0.0)),
        ),
        0.80, 0.60, ((-1.2, 1.34), (-0.7, 1.40), (-0.3, 1.41), (0.28, 1.36)),
        (0.60, 0.735, 0.46), (0.76, 0.92, 0.40), (0.46, 0.60, 0.40), 0.64, (0.92, -0.06, -1.06),
    )  # fmt: skip


def _hatchback() -> CarShape:
    return CarShape(
        4.1, 1.78, 1.48, (1.22, -1.30), 0.315, 0.18,
        ((-2.05, 0.98), (-1.9, 1.02), (-1.2, 1.01), (0.4, 0.965), (1.0, 0.94), (1.80, 0.79), (2.05, 0.71)),
        ((0.0, 0.12), (0.16, 0.03), (0.32, 0.0), (0.52, 0.012), (0.70, 0.04), (0.88, 0.10), (1.0, 0.20)),
        ((0.0, 0.13), (0.16, 0.03), (0.42, 0.0), (0.55, 0.03), (0.80, 0.05), (0.95, 0.07), (1.0, 0.10)),
        _SIDE, (0.33, 0.48), (0.25, 0.34),
        (
            Column((1.18, 0.0), (0.30, 0.0), "glass"), Column((1.12, 0.50), (0.27, 0.52), "glass"),
            Column((1.00, 0.90), (0.18, 0.92)), Column((0.96, 0.97), (0.12, 1.0)),
            Column((0.78, 1.0), (0.04, 1.0), "glass"), Column((-0.10, 1.0), (-0.20, 1.0)),
            Column((-0.21, 1.0), (-0.28, 1.0), "glass"), Column((-1.10, 1.0), (-0.98, 1.0)),
            Column((-1.60, 1.0), (-1.34, 1.0)), Column((-1.88, 0.98), (-1.56, 1.0)),
            Column((-1.95, 0.88), (-1.63, 0.90), "glass"), Column((-1.99, 0.45), (-1.68, 0.47), "glass"),
            Column((-2.00, 0.0), (-1.69, 0.0)),
        ),
        0.79, 0.62, ((-1.7, 1.36), (-1.2, 1.42), (-0.4, 1.44), (0.30, 1.40)),
        (0.60, 0.75, 0.44), (0.74, 1.00, 0.50), (0.46, 0.59, 0.38), 0.72, (0.88, -0.16, -1.12), tall_lamps=True,
    )  # fmt: skip


def _estate() -> CarShape:
    return CarShape(
        4.7, 1.83, 1.48, (1.47, -1.27), 0.325, 0.19,
        ((-2.35, 0.98), (-2.2, 1.02), (-1.7, 1.01), (0.4, 0.965), (1.1, 0.94), (2.05, 0.79), (2.35, 0.71)),
        ((0.0, 0.13), (0.16, 0.03), (0.32, 0.0), (0.52, 0.012), (0.70, 0.04), (0.88, 0.10), (1.0, 0.20)),
        ((0.0, 0.13), (0.16, 0.03), (0.42, 0.0), (0.55, 0.03), (0.80, 0.05), (0.95, 0.07), (1.0, 0.10)),
        _SIDE, (0.37, 0.50), (0.42, 0.36),
        (
            Column((1.25, 0.0), (0.36, 0.0), "glass"), Column((1.19, 0.50), (0.33, 0.52), "glass"),
            Column((1.07, 0.90), (0.24, 0.92)), Column((1.03, 0.97), (0.18, 1.0)),
            Column((0.85, 1.0), (0.10, 1.0), "glass"), Column((0.08, 1.0), (-0.02, 1.0)),
            Column((-0.03, 1.0), (-0.10, 1.0), "glass"), Column((-0.95, 1.0), (-0.95, 1.0)),
            Column((-1.03, 1.0), (-1.02, 1.0), "glass"), Column((-2.00, 1.0), (-1.76, 1.0)),
            Column((-2.16, 0.98), (-1.90, 1.0)), Column((-2.24, 0.88), (-1.95, 0.90), "glass"),
            Column((-2.28, 0.45), (-1.99, 0.47), "glass"), Column((-2.29, 0.0), (-2.00, 0.0)),
        ),
        0.80, 0.63, ((-2.0, 1.36), (-1.4, 1.41), (-0.3, 1.44), (0.36, 1.39)),
        (0.60, 0.74, 0.46), (0.74, 0.98, 0.54), (0.46, 0.60, 0.42), 0.72, (0.97, 0.02, -1.0), rails=True,
        tall_lamps=True,
    )  # fmt: skip


def _suv() -> CarShape:
    return CarShape(
        4.6, 1.88, 1.68, (1.42, -1.26), 0.365, 0.24,
        ((-2.3, 1.10), (-2.15, 1.15), (-1.6, 1.14), (0.4, 1.10), (1.0, 1.08), (1.95, 0.98), (2.3, 0.90)),
        ((0.0, 0.14), (0.16, 0.04), (0.34, 0.0), (0.55, 0.012), (0.74, 0.03), (0.90, 0.07), (1.0, 0.16)),
        ((0.0, 0.14), (0.16, 0.03), (0.42, 0.0), (0.55, 0.03), (0.80, 0.05), (0.95, 0.07), (1.0, 0.10)),
        _SIDE, (0.33, 0.46), (0.42, 0.36),
        (
            Column((1.14, 0.0), (0.36, 0.0), "glass"), Column((1.08, 0.50), (0.33, 0.52), "glass"),
            Column((0.96, 0.90), (0.24, 0.92)), Column((0.92, 0.97), (0.18, 1.0)),
            Column((0.76, 1.0), (0.10, 1.0), "glass"), Column((0.02, 1.0), (-0.05, 1.0)),
            Column((-0.09, 1.0), (-0.13, 1.0), "glass"), Column((-1.02, 1.0), (-1.00, 1.0)),
            Column((-1.12, 1.0), (-1.09, 1.0), "glass"), Column((-1.82, 1.0), (-1.62, 1.0)),
            Column((-2.08, 0.98), (-1.86, 1.0)), Column((-2.15, 0.88), (-1.92, 0.90), "glass"),
            Column((-2.20, 0.45), (-1.96, 0.47), "glass"), Column((-2.21, 0.0), (-1.97, 0.0)),
        ),
        0.83, 0.67, ((-2.0, 1.54), (-1.4, 1.60), (-0.3, 1.63), (0.36, 1.58)),
        (0.76, 0.90, 0.48), (0.86, 1.06, 0.52), (0.58, 0.80, 0.44), 0.84, (0.90, -0.04, -1.08), cladding=True,
        rails=True,
    )  # fmt: skip


def _van() -> CarShape:
    return CarShape(
        5.3, 2.0, 2.2, (1.72, -1.48), 0.34, 0.20,
        ((-2.65, 1.18), (-1.0, 1.18), (1.2, 1.16), (1.85, 1.14), (2.35, 1.02), (2.65, 0.92)),
        ((0.0, 0.12), (0.14, 0.03), (0.28, 0.0), (0.50, 0.01), (0.72, 0.03), (0.90, 0.08), (1.0, 0.16)),
        ((0.0, 0.06), (0.14, 0.0), (0.30, 0.0), (0.34, 0.03), (0.9, 0.04), (1.0, 0.05)),
        ((0.0, 0.04), (0.10, 0.015), (0.35, 0.0), (0.60, 0.004), (0.64, 0.014), (0.9, 0.02), (0.97, 0.03), (1.0, 0.05)),
        (0.40, 0.46), (0.12, 0.10),
        (
            Column((2.14, 0.0), (1.22, 0.0), "glass"), Column((2.06, 0.50), (1.18, 0.52), "glass"),
            Column((1.90, 0.90), (1.06, 0.92)), Column((1.84, 0.98), (0.98, 1.0)),
            Column((1.66, 1.0), (0.92, 1.0), "window"), Column((0.74, 1.0), (0.66, 1.0)),
            Column((0.40, 1.0), (0.40, 1.0)), Column((-1.0, 1.0), (-1.0, 1.0)), Column((-2.52, 1.0), (-2.42, 1.0)),
            Column((-2.59, 0.96), (-2.52, 0.98)), Column((-2.60, 0.86), (-2.54, 0.86), "window"),
            Column((-2.605, 0.10), (-2.555, 0.10)), Column((-2.605, 0.0), (-2.555, 0.0)),
        ),
        0.95, 0.80, ((-2.6, 2.06), (-2.2, 2.12), (0.4, 2.13), (0.9, 2.08), (1.22, 2.00)),
        (0.78, 0.98, 0.56), (0.86, 1.24, 0.86), (0.58, 0.78, 0.46), 0.66, (1.72, 0.55, -0.62), cladding=True,
        tall_lamps=True,
    )  # fmt: skip


SHAPES: dict[str, CarShape] = {
    "sedan": _sedan(),
    "hatchback": _hatchback(),
    "estate": _estate(),
    "suv": _suv(),
    "van": _van(),
}


def varied(shape: CarShape, stretch: float, rise: float) -> CarShape:
    """Return the shape with its lengths along x times `stretch` and its heights above the sills times `rise`."""
    low = shape.clearance_m

    def up(z: float) -> float:
        return low + (z - low) * rise

    def knots(line: Knots) -> Knots:
        return tuple((x * stretch, up(z)) for x, z in line)

    columns = tuple(
        replace(c, base=(c.base[0] * stretch, c.base[1]), roof=(c.roof[0] * stretch, c.roof[1])) for c in shape.columns
    )
    return replace(
        shape, length_m=shape.length_m * stretch, height_m=up(shape.height_m),
        wheels_x_m=(shape.wheels_x_m[0] * stretch, shape.wheels_x_m[1] * stretch), shoulder=knots(shape.shoulder),
        columns=columns, roof=knots(shape.roof),
        lamp_front=(up(shape.lamp_front[0]), up(shape.lamp_front[1]), shape.lamp_front[2]),
        lamp_rear=(up(shape.lamp_rear[0]), up(shape.lamp_rear[1]), shape.lamp_rear[2]),
        grille=(up(shape.grille[0]), up(shape.grille[1]), shape.grille[2]), plate_rear_m=up(shape.plate_rear_m),
        doors_x_m=tuple(x * stretch for x in shape.doors_x_m),
    )  # fmt: skip
