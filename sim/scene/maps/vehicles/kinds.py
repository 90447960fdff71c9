"""Kinds of vehicles with their variants, and one vehicle of a kind at a place."""

from __future__ import annotations

import re
from dataclasses import dataclass

from signals.rotation import NO_TURN
from signals.samples import Vec3
from signals.units import QUARTER_TURN_RAD
from sim.scene import surfaces
from sim.scene.maps.map_builder import Body, MapBuilder, roll_quat, yaw_quat
from sim.scene.maps.model import Model
from sim.scene.maps.models import model
from sim.scene.maps.vehicles.paints import BOXES, PLATES, draw_paint, paint_material, vehicle_materials
from sim.scene.random_generator import RandomGenerator

# Materials of our vehicles: meshes with these names look alike on all.
MATERIALS = frozenset({
    "paint", "box", "glass", "trim", "tyre", "rim", "head_lamp", "tail_lamp", "lit", "plate", "skin", "cloth", "hair",
})  # fmt: skip
_SHIRTS = {"white": (0.85, 0.85, 0.83), "navy": (0.12, 0.17, 0.33), "rust": (0.55, 0.25, 0.14)}


@dataclass(frozen=True)
class Variant:
    """One shape of a kind: `name` of its model in assets/models/vehicles."""

    name: str
    body: str  # prefix of the names of its bodies
    class_name: str


def _cars(kind: str) -> list[Variant]:
    """Return two shapes of a kind, each without and with a driver."""
    body = "van" if kind == "van" else "car"
    return [Variant(f"{kind}_{end}", body, "vehicle") for end in ("a", "a_driver", "b", "b_driver")]


# Shares of the kinds among parked cars.
STREET_MIX = ("sedan", "sedan", "hatchback", "hatchback", "hatchback", "estate", "estate", "suv", "suv", "van")
MILITARY_MIX = ("suv", "suv", "suv", "estate", "sedan", "van")
_FLEET_PAINTS = {
    "bus": ("white", "red", "yellow", "blue"),
    "lorry": ("white", "red", "blue", "green", "orange"),
    "van": ("white", "white", "white", "silver", "grey", "blue", "red"),
}

KINDS: dict[str, list[Variant]] = {
    **{kind: _cars(kind) for kind in ("sedan", "hatchback", "estate", "suv", "van")},
    "bus": [Variant("bus", "bus", "vehicle")],
    "bicycle": [Variant("bicycle", "bicycle", "bicycle")],
    "motorcycle": [Variant("motorcycle", "motorcycle", "motorcycle")],
    "lorry": [Variant("lorry", "lorry", "vehicle")],
}


def add_vehicle(
    builder: MapBuilder,
    rng: RandomGenerator,
    kind: str,
    place: tuple[float, float, float],
    *,
    paint: str = "",
    driver: float = 0.15,
    ground_m: float = 0.0,
) -> str:
    """Add a vehicle as one static body and return the body's name.

    `place`: x, y and heading. `driver`: probability that somebody sits in it.
    """
    x, y, heading_rad = place
    variants = KINDS[kind]
    shape, seated = rng.index(2), rng.unit() < driver
    drawn = rng.pick(_FLEET_PAINTS[kind]) if kind in _FLEET_PAINTS else draw_paint(rng)
    plate = rng.index(PLATES)
    variant = variants[(2 * shape + seated) % len(variants)]
    builder.classify(variant.class_name, f"{variant.body}_*")
    name = builder.next_name(variant.body)
    body = builder.named_body(name, (x, y, ground_m), yaw_quat(heading_rad))
    add_parts(builder, body, model(f"vehicles/{variant.name}"), paint or drawn, plate)
    return name


def add_parts(builder: MapBuilder, body: Body, vehicle: Model, paint: str, plate: int) -> None:
    """Add the geoms of a vehicle to a body, without its wheels if they are pieces of their own."""
    vehicle_materials(builder)
    add_drawn(builder, body, vehicle, (paint, plate))
    _, _, name = vehicle.name.rpartition("/")
    name = name if vehicle.is_own else name.removesuffix("_driver")
    for i, contact in enumerate(vehicle.contacts):
        part = f"proxy_{i}"
        if contact.hull is not None:
            asset = builder.mesh(f"{name}_hull_{i}", contact.hull)
            body.proxy("mesh", asset=asset, material="vehicle_trim", part=part)
        else:
            quat = roll_quat(QUARTER_TURN_RAD) if contact.kind == "cylinder" else NO_TURN
            body.proxy(contact.kind, contact.size, pos=contact.pos, quat=quat, material="vehicle_trim", part=part)


def add_drawn(
    builder: MapBuilder,
    body: Body,
    vehicle: Model,
    finish: tuple[str, int],
    *,
    piece: str = "",
    prefix: str = "",
    scale: float = 1.0,
    pos: Vec3 = (0.0, 0.0, 0.0),
) -> None:
    """Add a piece of a vehicle, and nothing solid; without `piece` all but its wheels.

    `finish`: paint and number plate. `prefix`: of the geoms' names in the body.
    """
    _, _, source = vehicle.name.rpartition("/")
    source += f"_{piece}" if piece else ""
    for part, mesh in (vehicle.pieces[piece] if piece else vehicle.by_material(without=("wheel_",))).items():
        label = re.sub(r"[^A-Za-z0-9_]+", "_", part)
        name = f"{source}_{label}" if scale == 1.0 else f"{source}_{round(100 * scale)}_{label}"
        asset = builder.mesh(name, mesh, scale=scale, source=f"{source}_{label}")
        material = _own_material(builder, vehicle, part, label) or part_material(builder, part, *finish)
        body.geom("mesh", asset=asset, material=material, pos=pos, solid=False, part=prefix + label)


def _own_material(builder: MapBuilder, vehicle: Model, part: str, label: str) -> str:
    """Return a material that only the user's own file has; "" for one of ours."""
    look = vehicle.looks.get(part)
    if look is None or part in MATERIALS:
        return ""
    name = f"{vehicle.name.replace('/', '_')}_{label}"
    texture = builder.texture(name, look.png, holes=look.holes) if look.png else ""
    return builder.material(
        name, look.surface, rgb=look.rgb, texture=texture, specular=look.specular, shininess=look.shininess
    )


def part_material(builder: MapBuilder, part: str, paint: str, plate: int) -> str:
    if part == "paint":
        return paint_material(builder, paint)
    if part == "plate":
        return f"vehicle_plate_{plate}"
    if part == "box":
        return f"vehicle_box_{(plate + len(paint)) % BOXES}"
    if part == "cloth":
        shirt = tuple(_SHIRTS)[(plate + len(paint)) % len(_SHIRTS)]
        return builder.material(f"driver_{shirt}", surfaces.CLOTH, rgb=_SHIRTS[shirt], specular=0.0)
    return f"vehicle_{part}"
