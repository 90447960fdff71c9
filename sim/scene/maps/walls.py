"""Walls with real openings, put together from boxes.

A wall is horizontal bands (below, between and above the rows of windows) and, in each row, the piers between its
windows: storeys + 1 bands and storeys * (windows + 1) piers. Each box lies with its local x along the wall, y up and z
across, so that a flat texture stands upright on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hil.signals._kernel import det_cos, det_sin
from hil.signals.rotation import product
from sim.scene.maps.map_builder import Body, roll_quat, yaw_quat

_UPRIGHT = roll_quat(1.5707963267948966)


@dataclass(frozen=True)
class Openings:
    """Rows of windows and perhaps a door, for one wall."""

    rows: tuple[tuple[float, float], ...]  # sill and head of each row, upwards [m]
    count: int  # windows in a row
    width_m: float
    door: int = -1  # this window of the lowest row reaches down to the ground; -1: none


def add_wall(
    body: Body,
    start: tuple[float, float],
    heading_rad: float,
    length_m: float,
    height_m: float,
    thickness_m: float,
    openings: Openings,
    *,
    material: str,
    part: str,
) -> None:
    """A wall from `start` along `heading`, its middle plane on that line."""
    quat = product(yaw_quat(heading_rad), _UPRIGHT)
    c, s = det_cos(heading_rad), det_sin(heading_rad)
    serial = 0

    def box(a: float, b: float, low: float, high: float) -> None:
        nonlocal serial
        if b - a < 0.02 or high - low < 0.02:
            return
        middle = 0.5 * (a + b)
        pos = (start[0] + middle * c, start[1] + middle * s, 0.5 * (low + high))
        size = (0.5 * (b - a), 0.5 * (high - low), 0.5 * thickness_m)
        body.geom("box", size, pos=pos, quat=quat, material=material, part=f"{part}_{serial}")
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


def _holes(length_m: float, openings: Openings) -> list[tuple[float, float]]:
    """Begin and end of each window of a row, evenly spread, at least 0.6 m of pier between them."""
    count = min(openings.count, int((length_m - 0.6) / (openings.width_m + 0.6)))
    if count <= 0:
        return []
    pitch = length_m / count
    return [(pitch * (i + 0.5) - openings.width_m / 2, pitch * (i + 0.5) + openings.width_m / 2) for i in range(count)]


def add_shell(
    body: Body,
    half_x_m: float,
    half_y_m: float,
    height_m: float,
    thickness_m: float,
    sides: Sequence[Openings],
    *,
    material: str,
    slab_material: str,
    floors_m: Sequence[float] = (),
) -> None:
    """Four walls about the body's origin (sides: -y, +x, +y, -x), floor slabs inside at `floors_m`, and a roof."""
    x, y, t = half_x_m, half_y_m, thickness_m
    quarter = 1.5707963267948966
    # Walls along x take the corners.
    add_wall(body, (-x, -y + t / 2), 0.0, 2 * x, height_m, t, sides[0], material=material, part="south")
    add_wall(body, (x - t / 2, -y + t), quarter, 2 * (y - t), height_m, t, sides[1], material=material, part="east")
    add_wall(body, (-x, y - t / 2), 0.0, 2 * x, height_m, t, sides[2], material=material, part="north")
    add_wall(body, (-x + t / 2, -y + t), quarter, 2 * (y - t), height_m, t, sides[3], material=material, part="west")
    for i, level in enumerate(floors_m):
        body.geom("box", (x - t, y - t, 0.1), pos=(0.0, 0.0, level), material=slab_material, part=f"floor_{i}")
    body.geom("box", (x + 0.15, y + 0.15, 0.12), pos=(0.0, 0.0, height_m + 0.12), material=slab_material, part="roof")
