"""Class, instance and surface of every geom of a compiled map.

* Instance: a child body of the world with its descendants, an actor with all its bodies, or one geom of the worldbody.
  Instances are numbered from 1 in the order of the model's geoms; 0 is nothing.
* Class: glob patterns are matched against the names of bodies and of geoms of the worldbody. Descendants have the class
  of their body unless a pattern matches them. The last match counts. Without a match: "ground" for planes and height
  fields, else "object".
* Surface: that of the geom's material; a geom without a material, or with one that has no surface, gets the default.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.scene.scene_map import Actor, Surface
from sim.scene.surfaces import NO_SURFACE

MAX_INSTANCES = 2**16 - 1
MAX_SURFACES = 256  # a surface id is one byte
_VISIBLE_GROUPS = 3  # geoms of lower groups are drawn
_DEFAULT_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # of a geom without a colour of its own


@dataclass(frozen=True)
class Names:
    """Names of a model's bodies, geoms and materials ("" for none), and the tree of its bodies."""

    bodies: list[str]
    geoms: list[str]
    materials: list[str]
    body_of_geom: list[int]
    parent: list[int]
    top: list[int]  # for each body its ancestor among the children of the world; 0 for the world

    @classmethod
    def of(cls, model: mujoco.MjModel) -> Names:
        raw = bytes(model.names)

        def read(addresses: NDArray[np.int32]) -> list[str]:
            return [raw[a : raw.index(b"\0", a)].decode("utf-8", "replace") for a in addresses.tolist()]

        parent = model.body_parentid.tolist()
        top = [0] * model.nbody
        for body in range(1, model.nbody):
            top[body] = top[parent[body]] or body
        return cls(
            read(model.name_bodyadr),
            read(model.name_geomadr),
            read(model.name_matadr),
            model.geom_bodyid.tolist(),
            parent,
            top,
        )


def instances(names: Names, actors: Sequence[Actor]) -> tuple[NDArray[np.uint16], tuple[str, ...]]:
    """Return the instance of each geom, and the instances' names. Raises ValueError beyond the range of a uint16."""
    actor_of = {body: actor.name for actor in actors for body in actor.bodies}
    numbers: dict[tuple[str, object], int] = {}
    instance_names = ["none"]
    ids = np.zeros(len(names.geoms), np.uint16)
    for geom, body in enumerate(names.body_of_geom):
        top = names.top[body]
        key: tuple[str, object]
        if body == 0:
            key, name = ("geom", geom), names.geoms[geom] or f"geom_{geom}"
        elif names.bodies[top] in actor_of:
            name = actor_of[names.bodies[top]]
            key = ("actor", name)
        else:
            key, name = ("body", top), names.bodies[top] or f"body_{top}"
        number = numbers.get(key)
        if number is None:
            number = numbers[key] = len(instance_names)
            if number > MAX_INSTANCES:
                raise ValueError(f"holds more than {MAX_INSTANCES} instances")
            instance_names.append(name)
        ids[geom] = number
    return ids, tuple(instance_names)


def classes(
    model: mujoco.MjModel, names: Names, patterns_by_class: Mapping[str, Sequence[str]], class_ids: Mapping[str, int]
) -> tuple[NDArray[np.uint8], list[tuple[str, int]]]:
    """Return the class of each geom, and (class, index of the pattern) of patterns that match nothing."""
    body_class: list[int | None] = [None] * len(names.bodies)
    ids = np.full(len(names.geoms), class_ids["object"], np.uint8)
    is_ground = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) | (model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD)
    ids[is_ground] = class_ids["ground"]
    geom_own_class: dict[int, int] = {}
    bodies_by_name: dict[str, list[int]] = {}
    for body, name in enumerate(names.bodies):
        if body and name:
            bodies_by_name.setdefault(name, []).append(body)
    geoms_by_name = {name: geom for geom, name in enumerate(names.geoms) if name and names.body_of_geom[geom] == 0}
    unmatched = []
    for name, patterns in patterns_by_class.items():
        for index, pattern in enumerate(patterns):
            bodies = _matching(pattern, bodies_by_name)
            geoms = _matching(pattern, geoms_by_name)
            for body_name in bodies:
                for body in bodies_by_name[body_name]:
                    body_class[body] = class_ids[name]
            for geom_name in geoms:
                geom_own_class[geoms_by_name[geom_name]] = class_ids[name]
            if not bodies and not geoms:
                unmatched.append((name, index))
    for body in range(1, len(body_class)):
        if body_class[body] is None:
            body_class[body] = body_class[names.parent[body]]
    for geom, body in enumerate(names.body_of_geom):
        found = geom_own_class.get(geom) if body == 0 else body_class[body]
        if found is not None:
            ids[geom] = found
    return ids, unmatched


def _matching(pattern: str, names: Mapping[str, object]) -> list[str]:
    if not any(char in pattern for char in "*?["):
        return [pattern] if pattern in names else []
    return [name for name in names if fnmatch.fnmatchcase(name, pattern)]


def surfaces(
    model: mujoco.MjModel, names: Names, surface_by_material: Mapping[str, Surface], default: Surface
) -> tuple[NDArray[np.uint8], tuple[Surface, ...]]:
    """Return the surface id of each geom, and the surfaces by id: 0 of nothing, 1 the default, then the others."""
    table: dict[Surface, int] = {NO_SURFACE: 0, default: 1}
    number = [
        table.setdefault(surface_by_material[name], len(table)) if name in surface_by_material else 1
        for name in names.materials
    ]
    if len(table) > MAX_SURFACES:
        raise ValueError(f"holds more than {MAX_SURFACES} different surfaces")
    geom_surface = np.array([*number, 1], np.uint8)[model.geom_matid]  # material -1 selects the last entry, the default
    return geom_surface, tuple(table)


def has_material_colour(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return True for geoms with the colour of their material: those whose rgba is the default grey (MuJoCo's rule)."""
    has_default_rgba: NDArray[np.bool_] = np.all(model.geom_rgba == _DEFAULT_RGBA, axis=1)
    return (model.geom_matid >= 0) & has_default_rgba


def visible(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return True for geoms that are drawn: of a group below 3, and not fully transparent."""
    alpha = model.geom_rgba[:, 3].copy()
    from_material = has_material_colour(model)
    alpha[from_material] = model.mat_rgba[model.geom_matid[from_material], 3]
    return (model.geom_group < _VISIBLE_GROUPS) & (alpha > 0.0)
