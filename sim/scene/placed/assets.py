"""Assets that can be added to any world: simple shapes, and objects of the map generators.

Shapes have an edge or a diameter of 1 m about their middle. The other objects stand on z = 0 and look along +x.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

from sim.scene import surfaces
from sim.scene.compile_process import compile_mjcf
from sim.scene.maps import military
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.meshes import revolve
from sim.scene.maps.objects.animals import add_dog
from sim.scene.maps.objects.belongings import add_backpack, add_parasol, add_potted_plant
from sim.scene.maps.objects.street_signs import add_stop_sign, add_traffic_light
from sim.scene.maps.people import PersonTraits, add_still_person
from sim.scene.maps.plants.materials import plant_materials
from sim.scene.maps.plants.trees import add_bush, add_tree
from sim.scene.maps.street_furniture import add_bench, add_bin, add_street_lamp, furniture_materials
from sim.scene.maps.vehicles.kinds import KINDS, add_vehicle
from sim.scene.placed.template import Template, materials_of, template_of
from sim.scene.random_generator import RandomGenerator

_ORIGIN = (0.0, 0.0, 0.0)
_GREY = (0.62, 0.62, 0.61)
_SIDES = 48


def asset_names() -> list[str]:
    """Return the names of all assets."""
    return [*_SHAPES, *_OBJECTS]


@cache
def asset(name: str) -> Template | None:
    """Return the template of an asset; None if there is none of this name."""
    if name not in _SHAPES and name not in _OBJECTS:
        return None
    builder = MapBuilder(name)
    if name in _SHAPES:
        _SHAPES[name](builder)
        class_name = "object"
    else:
        class_name, add = _OBJECTS[name]
        add(builder)
    scene_map = builder.build()
    model = compile_mjcf(scene_map.mjcf, scene_map.assets)
    return template_of(f"asset:{name}", class_name, model, 0, materials_of(scene_map, f"asset:{name}:"))


def _primitive(kind: str, size: tuple[float, ...], builder: MapBuilder) -> None:
    builder.body("shape").geom(kind, size, material=_plain(builder))


def _cone(builder: MapBuilder) -> None:
    # The rim has vertices of its own on both sides, so that it is a sharp edge.
    mesh = revolve([(0.5, -0.5), (0.5, -0.5), (0.002, 0.5)], _SIDES)
    builder.body("shape").geom("mesh", asset=builder.mesh("cone", mesh), material=_plain(builder))


def _plain(builder: MapBuilder) -> str:
    return builder.material("plain", surfaces.PLASTER, rgb=_GREY, specular=0.1, shininess=0.3)


def _rng(name: str) -> RandomGenerator:
    return RandomGenerator(1, f"asset.{name}")


def _vehicle(kind: str, builder: MapBuilder) -> None:
    add_vehicle(builder, _rng(kind), kind, _ORIGIN, driver=0.0)


def _person(height_m: float, soldier: bool, builder: MapBuilder) -> None:
    traits = PersonTraits(soldier=soldier, height_m=height_m)
    add_still_person(builder, _rng(f"person.{height_m}"), _ORIGIN, 0.0, traits=traits)


def _plant(add: Callable[[MapBuilder, RandomGenerator, float, float], None], builder: MapBuilder) -> None:
    plant_materials(builder)
    add(builder, _rng("plant"), 0.0, 0.0)


def _furniture(add: Callable[..., None], values: tuple[float, ...], builder: MapBuilder) -> None:
    furniture_materials(builder)
    add(builder, 0.0, 0.0, *values)


def _military(add: Callable[[MapBuilder], None], builder: MapBuilder) -> None:
    military.military_materials(builder)
    add(builder)


def _potted_plant(builder: MapBuilder) -> None:
    plant_materials(builder)
    add_potted_plant(builder, _rng("potted_plant"), _ORIGIN)


_HALF = (0.5, 0.5, 0.5)
_SHAPES: dict[str, Callable[[MapBuilder], None]] = {
    "Cube": partial(_primitive, "box", _HALF),
    "Sphere": partial(_primitive, "sphere", (0.5,)),
    "Cylinder": partial(_primitive, "cylinder", (0.5, 0.5)),
    "Cone": _cone,
    # Names of Unreal's cubes, which scripts of AirSim ask for.
    "1M_Cube": partial(_primitive, "box", _HALF),
    "1M_Cube_Chamfer": partial(_primitive, "box", _HALF),
}
_OBJECTS: dict[str, tuple[str, Callable[[MapBuilder], None]]] = {
    **{kind: (kind if kind in ("bicycle", "motorcycle") else "vehicle", partial(_vehicle, kind)) for kind in KINDS},
    "person": ("person", partial(_person, 1.75, False)),
    "child": ("person", partial(_person, 1.25, False)),
    "soldier": ("person", partial(_person, 1.8, True)),
    "dog": ("dog", lambda builder: add_dog(builder, _rng("dog"), _ORIGIN, 0.0)),
    "tree": ("tree", partial(_plant, add_tree)),
    "bush": ("bush", partial(_plant, add_bush)),
    "potted_plant": ("potted_plant", _potted_plant),
    "bench": ("bench", partial(_furniture, add_bench, (0.0,))),
    "bin": ("bin", partial(_furniture, add_bin, ())),
    "street_lamp": ("lamp", partial(_furniture, add_street_lamp, (0.0,))),
    "stop_sign": ("stop_sign", lambda builder: add_stop_sign(builder, 0.0, 0.0, 0.0)),
    "traffic_light": ("traffic_light", lambda builder: add_traffic_light(builder, 0.0, 0.0, 0.0, "red")),
    "backpack": ("backpack", lambda builder: add_backpack(builder, _rng("backpack"), _ORIGIN, 0.0)),
    "parasol": ("furniture", lambda builder: add_parasol(builder, _rng("parasol"), _ORIGIN)),
    "container": (
        "container",
        partial(_military, lambda b: military.add_container(b, _rng("container"), 0.0, 0.0, 0.0, stacked=False)),
    ),
    "barrels": ("barrel", partial(_military, lambda b: military.add_barrels(b, _rng("barrels"), 0.0, 0.0))),
    "crates": ("crate", partial(_military, lambda b: military.add_crates(b, _rng("crates"), 0.0, 0.0))),
    "sandbags": ("sandbags", partial(_military, lambda b: military.add_sandbags(b, 0.0, 0.0, 0.0))),
    "barrier": ("barrier", partial(_military, lambda b: military.add_barrier(b, 0.0, 0.0, 0.0))),
}
