"""The people whom a seed adds to a world: who they are, where they stand or walk, and the world with them in it.

Each rolls dice of his own, so one more changes nobody else, unless by standing in the way. A walker goes round an
oblong of 3 to 14 m by 0.8 to 5 m, at his own pace, beginning anywhere on it; who finds no free place in `_TRIES` is
left out.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hil.signals._kernel import det_atan2, det_cos, det_sin
from hil.signals.samples import Vec3
from hil.signals.units import DEG_PER_RAD, TURN_RAD
from sim.randomize.draw import between, colour_of, dice
from sim.randomize.free_ground import Float64, FreeGround
from sim.randomize.settings import PeopleLimits
from sim.scene.maps import surfaces
from sim.scene.maps.dice import Dice
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.people import add_still_person, add_walker
from sim.scene.maps.scene_map import SceneMap
from sim.scene.maps.walk_path import WalkPath
from sim.scene.world import PERSON

_TRIES = 60
_EVERY_M = 0.35  # of a way is looked at
_FAIR: Vec3 = (0.89, 0.70, 0.58)
_DARK: Vec3 = (0.30, 0.19, 0.14)
_HAIRS: tuple[Vec3, ...] = ((0.09, 0.07, 0.06), (0.28, 0.18, 0.10), (0.66, 0.52, 0.30), (0.60, 0.60, 0.60))


@dataclass(frozen=True)
class Way:
    """An oblong to walk round."""

    corner_m: tuple[float, float]
    heading_rad: float
    length_m: float
    width_m: float
    start_lap: float

    def path(self, speed_mps: float) -> WalkPath:
        c, s = det_cos(self.heading_rad), det_sin(self.heading_rad)
        x, y = self.corner_m
        sides = ((0.0, 0.0), (self.length_m, 0.0), (self.length_m, self.width_m), (0.0, self.width_m))
        vertices = [(x + c * a - s * b, y + s * a + c * b) for a, b in sides]
        return WalkPath(vertices, speed_mps, corner_m=min(1.5, 0.5 * self.width_m), start_lap=self.start_lap)


@dataclass(frozen=True)
class Person:
    """One who is added; colours are codes of sRGB / 255."""

    name: str
    at_m: Vec3  # where he stands, or is at the beginning
    heading_deg: float  # from east to north, at the beginning
    height_m: float
    speed_mps: float  # 0: stands
    way: Way | None
    shirt_rgb: Vec3
    trousers_rgb: Vec3
    skin_rgb: Vec3
    hair_rgb: Vec3

    def as_data(self) -> dict[str, Any]:
        return asdict(self)


def draw_people(limits: PeopleLimits, seed: int, ground: FreeGround) -> tuple[Person, ...]:
    """Those who found a place, in the order in which they were drawn."""
    low, high = limits.count
    count = low + dice(seed, "people", "count").index(high - low + 1)
    found = []
    for i in range(count):
        person = _draw_person(limits, dice(seed, "people", i), ground, f"{PERSON}{i:02d}")
        if person is not None:
            found.append(person)
    return tuple(found)


def _draw_person(limits: PeopleLimits, rolled: Dice, ground: FreeGround, name: str) -> Person | None:
    height_m = between(rolled, limits.height_m)
    walks, speed_mps = rolled.chance(limits.walking_share), between(rolled, limits.speed_mps)
    shirt = colour_of(rolled.unit(), rolled.between(0.0, 0.85), rolled.between(0.12, 0.9))
    trousers = colour_of(rolled.unit(), rolled.between(0.0, 0.5), rolled.between(0.1, 0.6))
    dark = rolled.unit()
    skin = (
        _FAIR[0] + dark * (_DARK[0] - _FAIR[0]),
        _FAIR[1] + dark * (_DARK[1] - _FAIR[1]),
        _FAIR[2] + dark * (_DARK[2] - _FAIR[2]),
    )
    hair = rolled.pick(_HAIRS)
    for _ in range(_TRIES):
        x, y = (rolled.between(-limits.within_m, limits.within_m) for _ in range(2))
        heading_rad = rolled.between(0.0, TURN_RAD)
        way = Way((x, y), heading_rad, rolled.between(3.0, 14.0), rolled.between(0.8, 5.0), rolled.unit())
        points, heading = np.array([[x, y]]), heading_rad
        if walks:
            path = way.path(speed_mps)
            points = _points_of(path)
            x, y, cosine, sine, *_ = path.place(path.progress(0)[1])
            heading = det_atan2(sine, cosine)
        if (points[:, 0] * points[:, 0] + points[:, 1] * points[:, 1]).min() < limits.clear_m * limits.clear_m:
            continue
        z = ground.height_m(points)
        if z is None:
            continue
        ground.take(points)
        return Person(
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


def _points_of(path: WalkPath) -> Float64:
    count = int(path.lap_m / _EVERY_M) + 1
    return np.array([path.place(path.lap_m * i / count)[:2] for i in range(count)])


def map_with(people: tuple[Person, ...], made: SceneMap) -> SceneMap:
    """The map with these people in it. All that was there keeps its number: they come last."""
    builder = MapBuilder("people")
    for person in people:
        _add(builder, person)
    added = builder.build()
    return replace(
        made,
        mjcf=_followed(made.mjcf, builder.sections()),
        surfaces={**made.surfaces, **added.surfaces},
        actors=(*made.actors, *added.actors),
    )


def _add(builder: MapBuilder, person: Person) -> None:
    rolled = Dice(0, person.name)  # how a hand is held; the rest is said
    look = {
        "shirt": builder.material(f"{person.name}_shirt", surfaces.CLOTH, rgb=person.shirt_rgb),
        "trousers": builder.material(f"{person.name}_trousers", surfaces.CLOTH, rgb=person.trousers_rgb),
        "skin": builder.material(f"{person.name}_skin", surfaces.SKIN, rgb=person.skin_rgb),
        "hair": builder.material(f"{person.name}_hair", surfaces.HAIR, rgb=person.hair_rgb),
        "shoe": builder.material(f"{person.name}_shoe", surfaces.RUBBER, rgb=(0.08, 0.08, 0.08)),
    }
    x, y, z = person.at_m
    height_m, name = person.height_m, person.name
    if person.way is None:
        heading_rad = person.heading_deg / DEG_PER_RAD
        add_still_person(builder, rolled, x, y, heading_rad, height_m=height_m, ground_m=z, name=name, look=look)
    else:
        path = person.way.path(person.speed_mps)
        add_walker(builder, rolled, path, height_m=height_m, ground_m=z, name=name, look=look)


def _followed(mjcf: str, sections: str) -> str:
    """Sections at the end of the text, where MJCF allows them a second time; no line of it moves."""
    end = mjcf.rfind("</mujoco>")
    if end < 0:  # one element without content
        return f"{mjcf.rstrip().removesuffix('/>')}>{sections}</mujoco>"
    return mjcf[:end] + sections + mjcf[end:]
