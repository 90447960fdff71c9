"""Parts of a vehicle: meshes by material, and the solid shapes for contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from signals.samples import Vec3
from sim.scene.maps.meshes import Mesh

Parts = dict[str, Mesh]
# The materials; empty meshes are left out of a map.
MATERIALS = (
    "paint",
    "box",
    "glass",
    "trim",
    "tyre",
    "rim",
    "head_lamp",
    "tail_lamp",
    "lit",
    "plate",
    "skin",
    "cloth",
    "hair",
)
# Beads pressed into painted sheet. They become a part of the paint's mesh.
BEAD = "bead"


@dataclass(frozen=True)
class Proxy:
    """Solid shape that is not drawn: a box, a cylinder across y, or the convex hull of a mesh."""

    kind: str
    size: tuple[float, ...] = ()
    pos: Vec3 = (0.0, 0.0, 0.0)
    hull: Mesh | None = None


def axle_proxies(axles_x_m: Sequence[float], wheel_m: float, half_width_m: float, half_tyre_m: float) -> list[Proxy]:
    """Return the wheels of both sides; `half_width_m`: from the middle to their outer faces."""
    y = half_width_m - half_tyre_m
    return [
        Proxy("cylinder", (wheel_m, half_tyre_m), (x, side * y, wheel_m)) for x in axles_x_m for side in (1.0, -1.0)
    ]


def add_plate(plate: Mesh, at: Vec3, facing: float) -> None:
    """Add a number plate of 0.52 x 0.11 m that looks along `facing` x."""
    x, y, z = at
    corners = [
        (x, y - 0.26 * facing, z - 0.056), (x, y + 0.26 * facing, z - 0.056), (x, y + 0.26 * facing, z + 0.056),
        (x, y - 0.26 * facing, z + 0.056),
    ]  # fmt: skip
    plate.add_polygon(corners, [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
