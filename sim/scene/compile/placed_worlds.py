"""World with objects that are moved and added from outside.

An object of the map that is moved becomes an actor: no geom changes. An added object is a scaled copy of a template,
at the end of the map, so that everything else keeps its numbers.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from signals.samples import Vec3
from sim.scene.compile.world_compiler import compile_map, read_only
from sim.scene.map_section import MjcfMap
from sim.scene.maps.map_builder import with_sections
from sim.scene.placed.actor import ObjectActor
from sim.scene.placed.template import Template
from sim.scene.scene_file import SceneFile
from sim.scene.world import World

_SPARE_CACHE_BYTES = 64 << 20


@dataclass(frozen=True)
class Added:
    """Copy of a template, whose one body is that of the actor."""

    actor: ObjectActor
    template: Template
    scale: Vec3


def with_objects(base: World, moved: Sequence[ObjectActor], added: Sequence[Added]) -> World:
    """Return the world with these objects; its scene is one that leads to this world.

    Raises ConfigError if a copy cannot be compiled, or if there are more instances or surfaces than an id can hold.
    """
    if not added:
        scene_map = replace(base.map, actors=(*base.map.actors, *moved))
        # Models of contact are kept by the identity of the world's model.
        return _own_scene(replace(base, map=scene_map, model=copy.copy(base.model)))
    asset, worldbody = ET.Element("asset"), ET.Element("worldbody")
    files, surfaces = dict(base.map.assets), dict(base.map.surfaces)
    known: set[tuple[str, str | None]] = set()

    def add_assets(elements: Sequence[ET.Element]) -> None:
        for element in elements:
            key = (element.tag, element.get("name"))
            if key not in known:
                known.add(key)
                asset.append(element)

    for each in added:
        geoms, meshes, mesh_files = each.template.geoms(each.actor.bodies[0], each.scale)
        materials = each.template.materials
        add_assets(materials.elements)
        add_assets(meshes)
        files |= {**materials.files, **mesh_files}
        surfaces |= materials.surfaces
        body = ET.SubElement(worldbody, "body", name=each.actor.bodies[0], mocap="true")
        body.extend(geoms)
    sections = ET.tostring(asset, encoding="unicode") + ET.tostring(worldbody, encoding="unicode")
    scene_map = replace(
        base.map,
        mjcf=with_sections(base.map.mjcf, sections),
        assets=files,
        surfaces=surfaces,
        actors=(*base.map.actors, *moved, *(each.actor for each in added)),
    )
    class_ids = {name: number for number, name in enumerate(base.class_names)}
    world = compile_map(base.scene, scene_map, dict(zip(base.class_names, base.class_colours, strict=True)))
    geom_class = np.empty(world.model.ngeom, np.uint8)
    geom_class[: base.model.ngeom] = base.geom_class
    row = base.model.ngeom
    for each in added:
        count = len(each.template.parts)
        geom_class[row : row + count] = class_ids.get(each.template.class_name, class_ids["object"])
        row += count
    return _own_scene(
        replace(
            world,
            geom_class=read_only(geom_class),
            added_people=base.added_people,
            added_objects=base.added_objects,
        )
    )


def limit_mesh_cache(spare_bytes: int = _SPARE_CACHE_BYTES) -> None:
    """Let MuJoCo keep compiled meshes of the worlds so far, and so many bytes of others; 500 MB is its own limit.

    Otherwise each scale of each copy stays, about 1 MB for a person or a car.
    """
    if not hasattr(mujoco, "mj_getCache"):  # an older version
        return
    cache = mujoco.mj_getCache()
    mujoco.mj_setCacheCapacity(cache, mujoco.mj_getCacheSize(cache) + spare_bytes)


def _own_scene(world: World) -> World:
    """Return the world with a scene for which `load_world` returns this world."""
    scene = world.scene
    if scene.has_only_boxes:  # its plane and boxes are geoms like others from here on
        scene = scene.model_copy(update={"map": MjcfMap(mjcf="objects")})
    cache = {key: value for key, value in scene.file.cache.items() if key != "world"}
    file = SceneFile(scene.file.path, scene.file.document, cache)
    world = replace(world, scene=scene.from_file(file))
    file.cache["world"] = world
    return world
