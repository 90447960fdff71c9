"""Draw the objects that a seed adds to a world, and add them to its map.

Each object has its own random generator, so one more object changes the others only by taking up space. An object for
which `_TRIES` tries find no free ground is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from signals.units import DEG_PER_RAD, TURN_RAD
from sim.randomize.free_ground import Float64, FreeGround
from sim.scene.added_object import OBJECT, AddedObject
from sim.scene.appearance import ObjectKind, ObjectLimits
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.objects.animals import add_bird, add_dog
from sim.scene.maps.objects.belongings import add_backpack, add_parasol, add_potted_plant
from sim.scene.maps.plants.materials import plant_materials
from sim.scene.maps.vehicles.kinds import add_vehicle
from sim.scene.random_generator import RandomGenerator, feature_rng
from sim.scene.scene_map import SceneMap

_TRIES = 60
_LOOKS = 10**6
_POINT_SPACING_M = 0.7  # of the checked points of a place


class _Kind(NamedTuple):
    """One kind of object: its class, the body's name without number, its length and width, and what adds it."""

    class_name: str
    body: str
    size_m: tuple[float, float]
    add: Callable[[MapBuilder, RandomGenerator, Vec3, float], object]


def _add_vehicle(kind: str, builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, heading_rad: float) -> None:
    add_vehicle(builder, rng, kind, (at_m[0], at_m[1], heading_rad), ground_m=at_m[2])


def _add_plant(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, _heading_rad: float) -> None:
    plant_materials(builder)
    add_potted_plant(builder, rng, at_m)


def _add_parasol(builder: MapBuilder, rng: RandomGenerator, at_m: Vec3, _heading_rad: float) -> None:
    add_parasol(builder, rng, at_m)


_KINDS: dict[ObjectKind, _Kind] = {
    "backpack": _Kind("backpack", "backpack", (0.4, 0.4), add_backpack),
    "bicycle": _Kind("bicycle", "bicycle", (1.8, 0.6), partial(_add_vehicle, "bicycle")),
    "bird": _Kind("bird", "bird", (0.4, 0.4), add_bird),
    "dog": _Kind("dog", "dog", (1.3, 0.4), add_dog),
    "motorcycle": _Kind("motorcycle", "motorcycle", (2.2, 0.8), partial(_add_vehicle, "motorcycle")),
    "parasol": _Kind("umbrella", "umbrella", (2.7, 2.7), _add_parasol),
    "potted_plant": _Kind("potted_plant", "potted_plant", (0.7, 0.7), _add_plant),
    "hatchback": _Kind("vehicle", "car", (4.3, 2.0), partial(_add_vehicle, "hatchback")),
    "sedan": _Kind("vehicle", "car", (4.9, 2.0), partial(_add_vehicle, "sedan")),
    "estate": _Kind("vehicle", "car", (4.9, 2.0), partial(_add_vehicle, "estate")),
    "suv": _Kind("vehicle", "car", (4.9, 2.1), partial(_add_vehicle, "suv")),
    "van": _Kind("vehicle", "van", (5.6, 2.2), partial(_add_vehicle, "van")),
    "lorry": _Kind("vehicle", "lorry", (8.5, 2.7), partial(_add_vehicle, "lorry")),
    "bus": _Kind("vehicle", "bus", (12.2, 2.7), partial(_add_vehicle, "bus")),
}


def draw_objects(limits: ObjectLimits, seed: int, ground: FreeGround) -> tuple[AddedObject, ...]:
    """Return the objects that found free ground, in the order drawn; mark their places as taken in `ground`."""
    low, high = limits.count
    count = low + feature_rng(seed, "objects", "count").index(high - low + 1)
    found: list[AddedObject] = []
    for i in range(count):
        rng = feature_rng(seed, "objects", i)
        kind, look = rng.pick(limits.kinds), rng.index(_LOOKS)
        place = _free_place(limits, rng, ground, _KINDS[kind].size_m)
        if place is not None:
            at_m, heading_rad = place
            same = sum(_KINDS[other.kind].body == _KINDS[kind].body for other in found)
            name = f"{OBJECT}{_KINDS[kind].body}_{same:03d}"
            found.append(AddedObject(name, kind, _KINDS[kind].class_name, at_m, heading_rad * DEG_PER_RAD, look))
    return tuple(found)


def _free_place(
    limits: ObjectLimits, rng: RandomGenerator, ground: FreeGround, size_m: tuple[float, float]
) -> tuple[Vec3, float] | None:
    """Return a place (position in W, heading) with free ground under a rectangle of `size_m`, and take it."""
    along, across = (_spaced(extent_m) for extent_m in size_m)
    a, b = (grid.ravel() for grid in np.meshgrid(along, across))
    for _ in range(_TRIES):
        x, y = (rng.between(-limits.within_m, limits.within_m) for _ in range(2))
        heading_rad = rng.between(0.0, TURN_RAD)
        c, s = det_cos(heading_rad), det_sin(heading_rad)
        points = np.stack([x + c * a - s * b, y + s * a + c * b], axis=1)
        if (points[:, 0] * points[:, 0] + points[:, 1] * points[:, 1]).min() < limits.clear_m * limits.clear_m:
            continue
        z = ground.height_m(points)
        if z is not None:
            ground.take(points)
            return (x, y, z), heading_rad
    return None


def _spaced(extent_m: float) -> Float64:
    """Return points over an extent about 0, at its ends and no farther apart than `_POINT_SPACING_M`."""
    return np.linspace(-0.5 * extent_m, 0.5 * extent_m, math.ceil(extent_m / _POINT_SPACING_M) + 1)


def map_with(objects: tuple[AddedObject, ...], base: SceneMap) -> SceneMap:
    """Return the map `base` with these objects added at its end, so that everything else keeps its number."""
    builder = MapBuilder("objects", assets=OBJECT)
    for added in objects:
        rng = RandomGenerator(added.look, added.kind)
        _KINDS[added.kind].add(builder, rng, added.at_m, added.heading_deg / DEG_PER_RAD)
    return builder.added_to(base)
