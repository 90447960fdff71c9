"""Draw the people that a seed adds to a world, and add them to its map.

Each person has their own random generator, so one more person changes the others only by taking up space. A walker
walks round an oblong of 3 to 14 m by 0.8 to 5 m at a random speed, starting anywhere on it. A person for whom `_TRIES`
tries find no free ground is left out.
"""

from __future__ import annotations

import numpy as np

from signals._kernel import det_atan2, det_cos, det_sin
from signals.samples import Vec3
from signals.units import DEG_PER_RAD, TURN_RAD
from sim.randomize.free_ground import Float64, FreeGround
from sim.scene.added_person import PERSON, AddedPerson, Oblong
from sim.scene.appearance import PeopleLimits
from sim.scene.maps.clothes import Colours
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.people import PersonTraits, add_still_person, add_walker
from sim.scene.maps.walk_path import WalkPath
from sim.scene.random_generator import RandomGenerator, feature_rng
from sim.scene.scene_map import SceneMap

_TRIES = 60
_POINT_SPACING_M = 0.35  # of the checked points of a path
_FAIR: Vec3 = (0.89, 0.70, 0.58)
_DARK: Vec3 = (0.30, 0.19, 0.14)
_HAIRS: tuple[Vec3, ...] = ((0.09, 0.07, 0.06), (0.28, 0.18, 0.10), (0.66, 0.52, 0.30), (0.60, 0.60, 0.60))


def colour_of(hue: float, saturation: float, value: float) -> Vec3:
    """Return the sRGB colour [0, 1] of an HSV colour; hue 0 to 1 runs from red over green and blue to red."""
    sector = (hue % 1.0) * 6.0

    def channel(n: float) -> float:
        k = (n + sector) % 6.0
        return value - value * saturation * max(0.0, min(k, 4.0 - k, 1.0))

    return channel(5.0), channel(3.0), channel(1.0)


def draw_people(limits: PeopleLimits, seed: int, ground: FreeGround) -> tuple[AddedPerson, ...]:
    """Return the people for whom free ground was found, in the order drawn; mark their paths as taken in `ground`."""
    low, high = limits.count
    count = low + feature_rng(seed, "people", "count").index(high - low + 1)
    found = []
    for i in range(count):
        person = _draw_person(limits, feature_rng(seed, "people", i), ground, f"{PERSON}{i:02d}")
        if person is not None:
            found.append(person)
    return tuple(found)


def _draw_person(limits: PeopleLimits, rng: RandomGenerator, ground: FreeGround, name: str) -> AddedPerson | None:
    height_m = rng.between(*limits.height_m)
    walks, speed_mps = rng.chance(limits.walking_share), rng.between(*limits.speed_mps)
    shirt = colour_of(rng.unit(), rng.between(0.0, 0.85), rng.between(0.12, 0.9))
    trousers = colour_of(rng.unit(), rng.between(0.0, 0.5), rng.between(0.1, 0.6))
    dark = rng.unit()
    skin = (
        _FAIR[0] + dark * (_DARK[0] - _FAIR[0]),
        _FAIR[1] + dark * (_DARK[1] - _FAIR[1]),
        _FAIR[2] + dark * (_DARK[2] - _FAIR[2]),
    )
    hair = rng.pick(_HAIRS)
    for _ in range(_TRIES):
        x, y = (rng.between(-limits.within_m, limits.within_m) for _ in range(2))
        heading_rad = rng.between(0.0, TURN_RAD)
        way = Oblong((x, y), heading_rad, rng.between(3.0, 14.0), rng.between(0.8, 5.0), rng.unit())
        points, heading = np.array([[x, y]]), heading_rad
        if walks:
            path = _path_round(way, speed_mps)
            points = _points_of(path)
            x, y, cosine, sine, *_ = path.place(path.progress(0)[1])
            heading = det_atan2(sine, cosine)
        if (points[:, 0] * points[:, 0] + points[:, 1] * points[:, 1]).min() < limits.clear_m * limits.clear_m:
            continue
        z = ground.height_m(points)
        if z is None:
            continue
        ground.take(points)
        return AddedPerson(
            name,
            (x, y, z),
            heading * DEG_PER_RAD,
            height_m,
            speed_mps=speed_mps if walks else 0.0,
            way=way if walks else None,
            shirt_rgb=shirt,
            trousers_rgb=trousers,
            skin_rgb=skin,
            hair_rgb=hair,
        )
    return None


def _path_round(way: Oblong, speed_mps: float) -> WalkPath:
    """Return the closed path round an oblong, in W."""
    c, s = det_cos(way.heading_rad), det_sin(way.heading_rad)
    x, y = way.corner_m
    corners = ((0.0, 0.0), (way.length_m, 0.0), (way.length_m, way.width_m), (0.0, way.width_m))
    vertices = [(x + c * a - s * b, y + s * a + c * b) for a, b in corners]
    return WalkPath(vertices, speed_mps, corner_m=min(1.5, 0.5 * way.width_m), start_lap=way.start_lap)


def _points_of(path: WalkPath) -> Float64:
    count = int(path.lap_m / _POINT_SPACING_M) + 1
    return np.array([path.place(path.lap_m * i / count)[:2] for i in range(count)])


def map_with(people: tuple[AddedPerson, ...], base: SceneMap) -> SceneMap:
    """Return the map `base` with these people added at its end, so that everything else keeps its number."""
    builder = MapBuilder("people", assets=PERSON)
    for person in people:
        _add(builder, person)
    return builder.added_to(base)


def _add(builder: MapBuilder, person: AddedPerson) -> None:
    rng = RandomGenerator(0, person.name)  # draws only clothes and the pose of the arms
    colours = Colours(person.shirt_rgb, person.trousers_rgb, person.skin_rgb, person.hair_rgb)
    traits = PersonTraits(height_m=person.height_m, name=person.name, colours=colours)
    if person.way is None:
        add_still_person(builder, rng, person.at_m, person.heading_deg / DEG_PER_RAD, traits=traits)
    else:
        path = _path_round(person.way, person.speed_mps)
        add_walker(builder, rng, path, ground_m=person.at_m[2], traits=traits)
