"""Walls with real openings, made of boxes.

A wall is horizontal bands (below, between and above the rows of windows) and, in each row, the piers between its
windows: storeys + 1 bands and storeys * (windows + 1) piers. Each box has its local x along the wall, y up and z
across, which puts a flat texture upright.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from signals._kernel import det_cos, det_sin
from signals.rotation import product
from sim.scene.maps.map_builder import Body, roll_quat, yaw_quat

_UPRIGHT = roll_quat(1.5707963267948966)


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
    *,
    material: str,
    part: str,
) -> None:
    """Add a wall from `start` along `heading_rad`, its middle plane on that line."""
    length_m, height_m, thickness_m = size.length_m, size.height_m, size.thickness_m
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
    """Return begin and end of each window of a row, evenly spaced, with piers of at least 0.6 m."""
    count = min(openings.count, int((length_m - 0.6) / (openings.width_m + 0.6)))
    if count <= 0:
        return []
    pitch = length_m / count
    return [(pitch * (i + 0.5) - openings.width_m / 2, pitch * (i + 0.5) + openings.width_m / 2) for i in range(count)]


def add_shell(body: Body, shell: Shell, sides: Sequence[Openings], *, material: str, slab_material: str) -> None:
    """Add four walls (`sides`: -y, +x, +y, -x), the floor slabs inside, and a roof."""
    x, y, t, height_m = shell.half_x_m, shell.half_y_m, shell.thickness_m, shell.height_m
    quarter = 1.5707963267948966
    # The walls along x include the corners.
    along_x, along_y = WallSize(2 * x, height_m, t), WallSize(2 * (y - t), height_m, t)
    add_wall(body, (-x, -y + t / 2), 0.0, along_x, sides[0], material=material, part="south")
    add_wall(body, (x - t / 2, -y + t), quarter, along_y, sides[1], material=material, part="east")
    add_wall(body, (-x, y - t / 2), 0.0, along_x, sides[2], material=material, part="north")
    add_wall(body, (-x + t / 2, -y + t), quarter, along_y, sides[3], material=material, part="west")
    for i, level in enumerate(shell.floors_m):
        body.geom("box", (x - t, y - t, 0.1), pos=(0.0, 0.0, level), material=slab_material, part=f"floor_{i}")
    body.geom("box", (x + 0.15, y + 0.15, 0.12), pos=(0.0, 0.0, height_m + 0.12), material=slab_material, part="roof")
