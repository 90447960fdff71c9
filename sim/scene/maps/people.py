"""People on a map: walking, standing, sitting. Height, hair and clothes come from the random generator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from signals.rotation import NO_TURN, product
from signals.samples import Quat, Vec3
from sim._kernels import resting_arm, resting_leg
from sim.scene.maps import surfaces
from sim.scene.maps.figure import LIMBS, Figure, LimbShape
from sim.scene.maps.map_builder import Body, MapBuilder, pitch_quat, roll_quat, yaw_quat
from sim.scene.maps.scene_map import Float64
from sim.scene.maps.walk_path import WalkPath
from sim.scene.maps.walker import Walker
from sim.scene.random_generator import RandomGenerator

Row = list[float]  # one limb: x, y, z, cos and sin of half its pitch, ... (sim/native/gait.hpp)

_QUARTER_TURN_RAD = 1.5707963267948966
_ALONG_Y = roll_quat(_QUARTER_TURN_RAD)
_ALONG_X = pitch_quat(_QUARTER_TURN_RAD)

_SHIRTS = {
    "white": (0.88, 0.88, 0.86), "navy": (0.12, 0.17, 0.33), "red": (0.70, 0.14, 0.13), "green": (0.17, 0.38, 0.22),
    "mustard": (0.80, 0.60, 0.18), "sky": (0.42, 0.62, 0.80), "black": (0.10, 0.10, 0.11), "rose": (0.80, 0.50, 0.55),
    "orange": (0.88, 0.42, 0.10),
}  # fmt: skip
_TROUSERS = {
    "denim": (0.20, 0.28, 0.45), "charcoal": (0.16, 0.16, 0.18), "khaki": (0.55, 0.48, 0.34),
    "brown": (0.33, 0.23, 0.16),
}  # fmt: skip
_SOLDIER = {"olive": (0.30, 0.32, 0.18), "camo": (0.38, 0.36, 0.24)}
_SKINS = {"a": (0.87, 0.68, 0.56), "b": (0.74, 0.54, 0.40), "c": (0.50, 0.34, 0.24), "d": (0.34, 0.22, 0.16)}
_HAIRS = {
    "dark": (0.09, 0.07, 0.06),
    "brown": (0.28, 0.18, 0.10),
    "fair": (0.66, 0.52, 0.30),
    "grey": (0.60, 0.60, 0.60),
}


@dataclass(frozen=True)
class PersonTraits:
    """Traits of a person; height and materials are random unless they are given."""

    soldier: bool = False  # in uniform
    height_m: float | None = None
    name: str | None = None  # None: numbered in the order of adding
    materials: Mapping[str, str] | None = None  # of each part of the body


def _draw_materials(builder: MapBuilder, rng: RandomGenerator, *, soldier: bool) -> dict[str, str]:
    """Return the material of each part of a person."""

    def draw_material(prefix: str, options: dict[str, Vec3], surface: surfaces.Surface) -> str:
        colour = rng.pick(tuple(options))
        return builder.material(f"{prefix}_{colour}", surface, rgb=options[colour])

    return {
        "shirt": draw_material("cloth", _SOLDIER if soldier else _SHIRTS, surfaces.CLOTH),
        "trousers": draw_material("cloth", _SOLDIER if soldier else _TROUSERS, surfaces.CLOTH),
        "skin": draw_material("skin", _SKINS, surfaces.SKIN),
        "hair": (
            draw_material("cloth", _SOLDIER, surfaces.CLOTH)
            if soldier
            else draw_material("hair", _HAIRS, surfaces.HAIR)
        ),
        "shoe": builder.material("shoe_black", surfaces.RUBBER, rgb=(0.08, 0.08, 0.08)),
    }


def _shape_geom(body: Body, shape: LimbShape, material: str, pos: Vec3, quat: Quat, part: str) -> None:
    turn = _ALONG_Y if shape.lateral else _ALONG_X if shape.forward else NO_TURN
    body.geom(shape.kind, shape.size, material=material, pos=pos, quat=product(quat, turn), part=part)


def _next_name(builder: MapBuilder) -> str:
    return builder.next_name("person", digits=2)


def add_walker(
    builder: MapBuilder,
    rng: RandomGenerator,
    path: WalkPath,
    *,
    ground_m: float = 0.0,
    traits: PersonTraits = PersonTraits(),
) -> Walker:
    """Add a walking person as an actor of the map. `ground_m`: height of the ground under `path`."""
    figure = Figure(traits.height_m or rng.between(1.55, 1.93))
    materials = traits.materials or _draw_materials(builder, rng, soldier=traits.soldier)
    walker = Walker(traits.name or _next_name(builder), figure, path, ground_m=ground_m)
    n = len(LIMBS)
    p, q, v, w = np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3))
    walker.pose(0, p, q, v, w)
    for i, limb in enumerate(LIMBS):
        body = builder.limb(walker.bodies[i], _vec(p, i), (*(float(x) for x in q[i]),))  # type: ignore[arg-type]
        for shape in figure.shapes():
            if shape.limb == limb:
                _shape_geom(body, shape, materials[shape.material], shape.pos, NO_TURN, shape.part)
    builder.classify("person", "person_*")
    builder.actor(walker)
    return walker


def _vec(rows: Float64, i: int) -> Vec3:
    return float(rows[i, 0]), float(rows[i, 1]), float(rows[i, 2])


def _trunk_rows(figure: Figure, hip_z: float) -> list[Row]:
    heights = (0.0, figure.torso_above_hip_m, figure.head_above_hip_m)
    return [[0.0, 0.0, hip_z + height, 1.0, 0.0] for height in heights]


def _standing(figure: Figure, rng: RandomGenerator) -> list[Row]:
    hip_z = figure.ankle_m + 0.992 * figure.leg_m
    rows = _trunk_rows(figure, hip_z)
    shoulder_z = hip_z + figure.shoulder_above_hip_m
    for side in (figure.shoulder_half_m, -figure.shoulder_half_m):
        bend = rng.between(0.1, 0.4) if rng.chance(0.6) else 1.6  # this arm down, or its hand at the ear
        rows += resting_arm(figure.lengths_m, side, shoulder_z, -0.1, -0.1 - bend)
    for side in (figure.hip_half_m, -figure.hip_half_m):
        ahead = rng.between(-0.03, 0.05)
        rows += resting_leg(figure.lengths_m, side, hip_z, ahead, figure.ankle_m)
    return rows


def _sitting(figure: Figure, seat_m: float) -> list[Row]:
    hip_z = seat_m + 0.07 * figure.height_m
    rows = _trunk_rows(figure, hip_z)
    shoulder_z = hip_z + figure.shoulder_above_hip_m
    for side in (figure.shoulder_half_m, -figure.shoulder_half_m):
        rows += resting_arm(figure.lengths_m, side, shoulder_z, -0.35, -1.25)
    for side in (figure.hip_half_m, -figure.hip_half_m):
        ahead = 0.93 * figure.thigh_m
        rows += resting_leg(figure.lengths_m, side, hip_z, ahead, figure.ankle_m)
    return rows


def add_still_person(
    builder: MapBuilder,
    rng: RandomGenerator,
    at_m: Vec3,
    heading_rad: float,
    *,
    seat_m: float = 0.0,
    traits: PersonTraits = PersonTraits(),
) -> None:
    """Add a person as one static body: standing at `at_m`, or sitting there on a seat of height `seat_m` (not 0)."""
    figure = Figure(traits.height_m or rng.between(1.55, 1.93))
    materials = traits.materials or _draw_materials(builder, rng, soldier=traits.soldier)
    rows = _sitting(figure, seat_m) if seat_m else _standing(figure, rng)
    builder.classify("person", "person_*")
    body = builder.named_body(traits.name or _next_name(builder), at_m, yaw_quat(heading_rad))
    for limb, row in zip(LIMBS, rows, strict=True):
        pitch: Quat = (row[3], 0.0, row[4], 0.0)
        for shape in figure.shapes():
            if shape.limb != limb:
                continue
            # Rotates about y by the limb's pitch: x' = x cos + z sin, z' = z cos - x sin.
            c, s = row[3] * row[3] - row[4] * row[4], 2.0 * row[3] * row[4]
            px, py, pz = shape.pos
            pos = (row[0] + px * c + pz * s, row[1] + py, row[2] + pz * c - px * s)
            _shape_geom(body, shape, materials[shape.material], pos, pitch, f"{limb}_{shape.part}")
