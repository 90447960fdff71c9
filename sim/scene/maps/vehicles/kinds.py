"""Kinds of vehicles with their variants, and one vehicle of a kind at a place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from signals.units import QUARTER_TURN_RAD
from sim.scene.maps import surfaces
from sim.scene.maps.map_builder import Body, MapBuilder, roll_quat, yaw_quat
from sim.scene.maps.vehicles.bicycle import bicycle_parts, bicycle_proxies
from sim.scene.maps.vehicles.bus import bus_parts, bus_proxies
from sim.scene.maps.vehicles.car import car_parts, car_proxies
from sim.scene.maps.vehicles.car_shape import SHAPES, varied
from sim.scene.maps.vehicles.lorry import lorry_parts, lorry_proxies
from sim.scene.maps.vehicles.motorcycle import motorcycle_parts, motorcycle_proxies
from sim.scene.maps.vehicles.paints import PLATES, draw_paint, paint_material, reflecting, vehicle_materials
from sim.scene.maps.vehicles.parts import Parts, Proxy
from sim.scene.random_generator import RandomGenerator

_SHIRTS = {"white": (0.85, 0.85, 0.83), "navy": (0.12, 0.17, 0.33), "rust": (0.55, 0.25, 0.14)}


@dataclass(frozen=True)
class Model:
    """One shape of a kind."""

    name: str
    body: str  # prefix of the names of its bodies
    class_name: str
    parts: Callable[[], Parts]
    proxies: Callable[[], list[Proxy]]


def _car_models(kind: str) -> list[Model]:
    models = []
    for suffix, stretch, rise, spokes in (("a", 1.0, 1.0, 5), ("b", 0.965, 1.02, 10)):
        shape = varied(SHAPES[kind], stretch, rise)
        for driver in (False, True):
            models.append(
                Model(
                    f"{kind}_{suffix}{'_driver' if driver else ''}", "van" if kind == "van" else "car", "vehicle",
                    lambda shape=shape, spokes=spokes, driver=driver: car_parts(  # type: ignore[misc]
                        shape, spokes=spokes, driver=driver
                    ),
                    lambda shape=shape: car_proxies(shape),  # type: ignore[misc]
                )
            )  # fmt: skip
    return models


# Shares of the kinds among parked cars.
STREET_MIX = ("sedan", "sedan", "hatchback", "hatchback", "hatchback", "estate", "estate", "suv", "suv", "van")
MILITARY_MIX = ("suv", "suv", "suv", "estate", "sedan", "van")
_FLEET_PAINTS = {
    "bus": ("white", "red", "yellow", "blue"),
    "lorry": ("white", "red", "blue", "green", "orange"),
    "van": ("white", "white", "white", "silver", "grey", "blue", "red"),
}

MODELS: dict[str, list[Model]] = {kind: _car_models(kind) for kind in SHAPES}
MODELS["bus"] = [Model("bus", "bus", "vehicle", bus_parts, bus_proxies)]
MODELS["bicycle"] = [Model("bicycle", "bicycle", "bicycle", bicycle_parts, bicycle_proxies)]
MODELS["motorcycle"] = [Model("motorcycle", "motorcycle", "motorcycle", motorcycle_parts, motorcycle_proxies)]
MODELS["lorry"] = [Model("lorry", "lorry", "vehicle", lorry_parts, lorry_proxies)]


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
    models = MODELS[kind]
    shape, seated = rng.index(2), rng.unit() < driver
    drawn = rng.pick(_FLEET_PAINTS[kind]) if kind in _FLEET_PAINTS else draw_paint(rng)
    plate = rng.index(PLATES)
    model = models[(2 * shape + seated) % len(models)]
    builder.classify(model.class_name, f"{model.body}_*")
    name = builder.next_name(model.body)
    body = builder.named_body(name, (x, y, ground_m), yaw_quat(heading_rad))
    add_parts(builder, body, model, paint or drawn, plate)
    return name


def add_parts(builder: MapBuilder, body: Body, model: Model, paint: str, plate: int) -> None:
    """Add the geoms of a model to a body."""
    vehicle_materials(builder)
    names = _mesh_names(builder, model)
    for part, asset in names.items():
        body.geom("mesh", asset=asset, material=part_material(builder, part, paint, plate), solid=False, part=part)
    for i, proxy in enumerate(_proxies_of(model)):
        part = f"proxy_{i}"
        if proxy.hull is not None:
            asset = builder.mesh(f"{model.name.removesuffix('_driver')}_hull_{i}", proxy.hull)
            body.proxy("mesh", asset=asset, material="vehicle_trim", part=part)
            continue
        quat = roll_quat(QUARTER_TURN_RAD) if proxy.kind == "cylinder" else (1.0, 0.0, 0.0, 0.0)
        body.proxy(
            proxy.kind, proxy.size, pos=proxy.pos, quat=quat, material="vehicle_trim", part=part
        )  # fmt: skip


def _mesh_names(builder: MapBuilder, model: Model) -> dict[str, str]:
    """Return the mesh assets of a model by part."""
    parts = _parts_of(model)
    return {part: builder.mesh(f"{model.name}_{part}", mesh) for part, mesh in parts.items() if mesh.triangles}


@cache
def _parts_of(model: Model) -> Parts:
    """Return the meshes of a model, made once in a process."""
    parts = model.parts()
    return parts | {"paint": reflecting(parts["paint"])}


@cache
def _proxies_of(model: Model) -> list[Proxy]:
    """Return the contact shapes of a model, made once in a process."""
    return model.proxies()


def part_material(builder: MapBuilder, part: str, paint: str, plate: int) -> str:
    if part == "paint":
        return paint_material(builder, paint)
    if part == "plate":
        return f"vehicle_plate_{plate}"
    if part == "cloth":
        shirt = tuple(_SHIRTS)[(plate + len(paint)) % len(_SHIRTS)]
        return builder.material(f"driver_{shirt}", surfaces.CLOTH, rgb=_SHIRTS[shirt], specular=0.0)
    return f"vehicle_{part}"
